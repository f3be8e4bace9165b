"""Speed at which a drive that follows a position ends, where its command asks for more."""

import numpy as np
from jaxtyping import Float

FOLLOWS = 0.5  # correlation of position and command, at least
TOP = 99.0  # percentile of the speed that counts as the largest
MORE = 1.15  # times the largest speed, that a command asks for
OFTEN = 0.02  # of the samples


def speed_limit(
    command: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"], dt: float
) -> str:
    """A sentence where the command asks for more speed than the axis ever has; else empty.

    Args:
        command: of a drive that takes a position.
        position: [m].
        dt: sample period [s].
    """
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
