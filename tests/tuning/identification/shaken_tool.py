"""Records of a tool on springs that Klipper's TEST_RESONANCES shakes, simulated."""

import numpy as np
from scipy.signal import cont2discrete, lfilter, square

FINE = 4  # steps of the simulation in a sample
GRAVITY = (0.3, -0.5, 9.7)  # with the offset of a sensor [m/s^2]


def shaken(
    modes, rate=1600.0, highest=133.0, per_hz=0.06, noise=0.06, jitter=0.2, seed=0, rest=3.0
):
    """Stamps [s] and accelerations (T, 3) [m/s^2] of x, a tenth of it along y, gravity and noise.

    The command is a square wave of `per_hz` f, whose f rises by 2 Hz a second. Each mode is a mass
    on a spring and a damper, of frequency [Hz], damping and share.
    """
    dt, lasts = 1 / (FINE * rate), (highest - 5) / 2
    time = np.arange(-rest, lasts + rest, dt)
    f = 5 + 2 * time
    wave = square(2 * np.pi * (5 + time) * time + np.pi / 2)  # starts in the middle of a half wave
    command = np.where((time >= 0) & (time < lasts), per_hz * f * wave, 0.0)
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
