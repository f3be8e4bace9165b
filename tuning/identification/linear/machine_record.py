"""A record of a machine, at the rate at which its encoders are read."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

FEWEST = 500  # samples
EVEN = 0.9  # of the gaps between changes, that a slower clock makes; of steps and gaps that are one


@dataclass(frozen=True)
class MachineRecord:
    """Commands and positions of all axes."""

    dt: float  # sample period [s]
    axes: tuple[str, ...]  # names
    command: Float[np.ndarray, "T axes"]  # (T, axes) [command unit]
    position: Float[np.ndarray, "T axes"]  # (T, axes) [m]

    def checked(self) -> "MachineRecord":
        """The record itself.

        Raises:
            ValueError: it is too short, or a signal does not change or is not finite.
        """
        for name, *signals in zip(self.axes, self.command.T, self.position.T, strict=True):
            if len(self.command) < FEWEST:
                count = len(self.command)
                raise ValueError(f"{name}: needs at least {FEWEST} samples, received {count}")
            for what, values in zip(("command", "position"), signals, strict=True):
                if not np.isfinite(values).all():
                    raise ValueError(f"{name}: the {what} holds NaN or inf")
                if np.ptp(values) == 0:
                    raise ValueError(f"{name}: the {what} never changes, so nothing can be seen")
        return self

    def at_own_rate(self) -> tuple["MachineRecord", list[str]]:
        """The record at the rate of its slowest encoder, and what is said of that.

        A position that is held until it is read again answers the mean of the command between.

        Raises:
            ValueError: there are too few updates.
        """
        each = [updates(position) for position in self.position.T]
        rows, name = min(zip(each, self.axes, strict=True), key=lambda one: len(one[0]))
        if len(rows) == len(self.position):
            return self, []
        gaps = np.diff(rows)
        dt = self.dt * float(gaps.mean())
        said = (
            f"{name}: its position changes every {gaps.mean():.3g} rows of the log, at any speed: "
            f"it is read at {1 / dt:.4g} Hz, and used so, with the mean of the command between"
        )
        if len(gaps) < FEWEST:
            raise ValueError(f"{said}; needs at least {FEWEST}, has {len(gaps)}")
        mean = np.add.reduceat(self.command, rows)[:-1] / gaps[:, None]
        return replace(self, dt=dt, command=mean, position=self.position[rows[:-1]]), [said]


def updates(position: Float[np.ndarray, " T"]) -> Int[np.ndarray, " K"]:
    """Rows at which a position is read anew: every row, or those of a clock slower than the log's.

    At any speed such a clock changes it after n rows or a multiple of n. What changes every n rows
    by a single count each is an even motion.
    """
    size = np.abs(np.diff(position))
    changed = np.flatnonzero(size) + 1
    gaps, size = np.diff(changed), size[changed[1:] - 1]
    n = int(np.median(gaps)) if gaps.size else 1
    single = (gaps == n) & (size < 2 * size.min(initial=np.inf))
    if n == 1 or np.mean(gaps % n == 0) < EVEN or np.mean(single) > EVEN:
        return np.arange(len(position))
    times = np.append(np.rint(gaps / n).astype(int), -(-(len(position) - changed[-1]) // n))
    held = [first + n * np.arange(k) for first, k in zip(changed, times, strict=True)]
    return np.concatenate([np.arange(changed[0] % n, changed[0], n), *held])
