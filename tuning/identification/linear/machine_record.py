"""A record of a machine."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

FEWEST = 500  # samples


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
