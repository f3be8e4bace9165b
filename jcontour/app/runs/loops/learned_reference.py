"""What a control loads of a part that was learned: its reference with the best shift."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jcontour.app.files.results.learned_result import StoredLap
from jcontour.app.files.results.verdict import LimitCheck
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.runs.loops.learning import BestLap
from jcontour.motion.references import Reference


def shifted(reference: Reference, best: BestLap) -> Float[np.ndarray, "T m"]:
    """Positions [m] of the reference at every sample, with the correction of a lap."""
    return np.asarray(reference.position[: reference.steps]) + np.asarray(best.correction)


def stored_lap(
    position: Float[np.ndarray, "T m"],
    dt: float,
    best: BestLap,
    limits: MachineLimits,
    axes: Sequence[str],
) -> StoredLap | None:
    """What is said of such positions; None where nothing was learned.

    Args:
        position: of the shifted reference [m].
        dt: sample period [s].
        best: lap of the linear model.
        limits: of the machine.
        axes: names.
    """
    if best.lap == 1:
        return None
    speed = np.abs(np.diff(position, axis=0)).max(axis=0) / dt
    acceleration = np.abs(np.diff(position, 2, axis=0)).max(axis=0) / dt**2
    asked = (
        ("speed", speed, limits.speed, "m/s"),
        ("acceleration", acceleration, limits.acceleration, "m/s^2"),
    )
    shift = np.asarray(best.correction)
    return StoredLap(
        lap=best.lap,
        error_um=1e6 * best.error,
        largest_um=1e6 * float(np.abs(shift).max()),
        first_um=1e6 * float(np.linalg.norm(shift[0])),
        speed=float(speed.max()),
        acceleration=float(acceleration.max()),
        limits=[
            LimitCheck(
                name=f"{name} of {axis} that the reference asks for",
                value=float(most[k]),
                allowed=float(limit[k]),
                unit=unit,
            )
            for name, most, limit, unit in asked
            if limit is not None
            for k, axis in enumerate(axes)
        ],
    )
