"""Records of a tool on springs that Klipper's TEST_RESONANCES shakes, simulated."""

import numpy as np
from scipy.signal import cont2discrete, lfilter

FINE = 4  # steps of the simulation in a sample
GRAVITY = (0.3, -0.5, 9.7)  # with the offset of a sensor [m/s^2]


def shaken(
    modes, rate=1600.0, highest=133.0, per_hz=0.06, noise=0.06, jitter=0.2, seed=0, rest=3.0
):
    """Stamps [s] and accelerations (T, 3) [m/s^2] of x, a tenth of it along y, gravity and noise.

    The command is a square wave of `per_hz` f, whose f rises by 2 Hz a second. Each mode is a mass
    on a spring and a damper, of frequency [Hz], damping and share.
    """
    f, sign, ends, levels = 5.0, 1.0, [0.0], []
    while f <= highest:
        for level in (sign, -sign):
            ends.append(ends[-1] + 0.25 / f)
            levels.append(level * per_hz * f)
        f, sign = f + 2 * 2 * 0.25 / f, -sign
    dt = 1 / (FINE * rate)
    time = np.arange(-rest, ends[-1] + rest, dt)
    at = np.searchsorted(ends, time, side="right") - 1
    command = np.where((at >= 0) & (at < len(levels)), np.take(levels, at, mode="clip"), 0.0)
    moved = np.zeros(len(time))
    for hertz, zeta, share in modes:
        w = 2 * np.pi * hertz
        above, below, _ = cont2discrete(([2 * zeta * w, w**2], [1, 2 * zeta * w, w**2]), dt)
        moved += share * lfilter(above[0], below, command)
    random = np.random.default_rng(seed)
    count = len(time) // FINE - 2
    stamps = time[FINE] + (np.arange(count) + jitter * random.uniform(-0.5, 0.5, count)) / rate
    seen = np.interp(stamps, time, moved)[:, None] * [1.0, 0.1, 0.0] + GRAVITY
    return stamps + 812.3, seen + noise * random.standard_normal((count, 3))
