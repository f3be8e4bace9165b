"""Limits that a record shows: of its rates, of the speed, and of the command before it acts."""

import numpy as np
from jaxtyping import Float

from tuning.identification.linear.output_error import TRAINING

AT_REST = 0.02  # of the squared speed
FOLLOWS = 0.5  # correlation of position and command, at least
TOP = 99.0  # percentile of the speed that counts as the largest
MORE = 1.15  # times the largest speed, that a command asks for
OFTEN = 0.02  # of the samples
SPAN = 8  # samples over which a speed is taken
LEVELS = np.linspace(0.2, 0.95, 16)  # of the largest command, at which it may be cut
HELD, EVEN = 3, 0.8  # samples that are one; part of the changes that are so far apart
FAST, MOSTLY = 0.8, 0.5  # of half the rate; of the power
SURE = 0.3  # of what is left without a cut


def limits_of(
    command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"], dt: float
) -> str:
    """A sentence about a limit that keeps a linear model from explaining a record; else empty.

    Args:
        command: of the drive.
        position: [m].
        dt: sample period [s].
    """
    return (
        _at_rest(position, dt)
        or _two_rates(command, position)
        or _aliased(command)
        or _speed_limit(command, position, dt)
        or _command_limit(command, position)
    )


def _at_rest(position: np.ndarray, dt: float) -> str:
    """Of an axis that moves at the beginning alone."""
    speed = np.diff(position)
    power = np.cumsum(speed**2)
    judged = power[-1] - power[int(TRAINING * len(power))]
    if judged > AT_REST * power[-1]:
        return ""
    ends = dt * float(np.searchsorted(power, (1 - AT_REST) * power[-1]))
    return (
        f"the axis moves for the first {ends:.3g} s of {dt * len(position):.3g} s alone, and its "
        f"model is judged by the last {100 * (1 - TRAINING):.0f} %: record moves all along, "
        "or give a step response to jcontour machine --steps"
    )


def _two_rates(command: np.ndarray, position: np.ndarray) -> str:
    """Of signals of which one is held over several samples of the other."""
    held = [_samples_held(signal) for signal in (command, position)]
    if max(held) < HELD or held[0] == held[1]:
        return ""
    return (
        f"the command changes every {held[0]} samples of the log, the position every {held[1]}: "
        "two rates; log both at the slower one, each at the same instant"
    )


def _samples_held(signal: np.ndarray) -> int:
    """Samples between changes of a signal, where most are the same; else 1."""
    gaps = np.diff(np.flatnonzero(np.diff(signal)))
    usual = int(np.median(gaps)) if gaps.size else 1
    return usual if np.mean(gaps == usual) > EVEN else 1


def _aliased(command: np.ndarray) -> str:
    """Of a command that is mostly near half the rate of the log."""
    power = np.abs(np.fft.rfft(command - command.mean())) ** 2
    fast = float(power[int(FAST * len(power)) :].sum() / max(power.sum(), 1e-300))
    if fast < MOSTLY:
        return ""
    return (
        f"{100 * fast:.0f} % of the command's power is near half the rate of the log: it changes "
        "from sample to sample, faster than the log tells (aliasing); record at a higher rate"
    )


def _speed_limit(command: np.ndarray, position: np.ndarray, dt: float) -> str:
    """Of a drive that takes a position, and is asked for more speed than it ever has."""
    u, y = command - command.mean(), position - position.mean()
    size = float(np.linalg.norm(u) * np.linalg.norm(y))
    if not size or float(u @ y) < FOLLOWS * size:
        return ""
    asked = np.abs(np.gradient(command, dt)) * float(u @ y) / float(u @ u)
    largest = float(np.percentile(np.abs(np.gradient(position, dt)), TOP))
    beyond = np.flatnonzero(asked > MORE * largest)
    if len(beyond) < OFTEN * len(asked):
        return ""
    return (
        f"the command asks for up to {1e3 * asked[beyond].max():.3g} mm/s, first after "
        f"{dt * beyond[0]:.3g} s, and the axis goes no faster than {1e3 * largest:.3g} mm/s: its "
        "drive limits the speed, which no linear model has; use what is before, or ask for less"
    )


def _command_limit(command: np.ndarray, position: np.ndarray) -> str:
    """By the speed over spans, v(k+1) = a v(k) + b u(k) + b' u(k-1), of commands that are cut."""
    if len(command) < 10 * SPAN:
        return ""
    speed = position[SPAN:] - position[:-SPAN]
    kernel = np.full(SPAN, 1 / SPAN)

    def left(level: float) -> float:
        u = np.convolve(np.clip(command, -level, level), kernel, "valid")[: len(speed)]
        now, before = slice(SPAN, -SPAN), slice(0, -2 * SPAN)
        columns = np.stack([speed[now], u[2 * SPAN :], u[now], u[before]], axis=1)
        columns = np.append(columns, np.ones((len(columns), 1)), axis=1)
        right = speed[2 * SPAN :]
        found, *_ = np.linalg.lstsq(columns, right, rcond=None)
        return float(np.mean((right - columns @ found) ** 2))

    largest = float(np.abs(command).max())
    cut = [left(largest * part) for part in LEVELS]
    best = int(np.argmin(cut))
    if cut[best] > SURE * left(largest):
        return ""
    return (
        f"the axis answers as if its command were cut at about {largest * LEVELS[best]:.3g}, and "
        f"the log has it up to {largest:.3g}: log what is left of it, or ask for less"
    )
