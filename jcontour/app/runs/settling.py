"""The end of a run: its last point held, until the tool rests.

A controller that lags is still under way when its reference ends, and may pass the end of the part.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.jobs.job import Job, Task
from jcontour.controller import Controller
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import follow, prepared
from jcontour.simulation.evaluation import family_batching

STILL = 1e-7  # [m]: a tool that stays within it rests
FIRST, MOST = 0.25, 2.0  # [s] that are tried, each twice the last; half of it has to be at rest


def with_held_end(job: Task, samples: int) -> Task:
    """The run whose last point is held for so many samples."""
    if isinstance(job, Job):
        return job._replace(settling=samples)
    return job._replace(duration=job.duration + samples * job.dt)


def settling(job: Task, family: Plant, controller: Controller, dt: float) -> int | None:
    """Samples after the end of a run until every tool stays where it is; None where one does not.

    Args:
        job: the run.
        controller: of all plants.
        family: the plants, stacked; without what counts or sticks.
        dt: sample period [s].
    """
    hold = FIRST
    while hold <= 2 * MOST:
        samples = max(2, round(hold / dt))
        output = _outputs(with_held_end(job, samples), family, controller, dt)
        tail = output[:, job.samples - 1 :]
        moving = np.linalg.norm(tail - tail[:, -1:], axis=-1).max(axis=0) > STILL
        if not np.isfinite(tail).all():
            return None
        if not moving[samples // 2 :].any():
            return int(np.append(np.flatnonzero(moving) + 1, 0).max(initial=0))
        hold *= 2
    return None


def _outputs(
    job: Task, family: Plant, controller: Controller, dt: float
) -> Float[np.ndarray, "P T m"]:
    reference = job.reference(dt, controller.preview)
    plan = prepared(controller, reference)

    @eqx.filter_jit
    def outputs(family: Plant) -> Float[Array, "P T m"]:
        def on(plant: Plant) -> Float[Array, "T m"]:
            return follow(plant, controller, plan, reference).output

        return family_batching(family)(on, family)

    return np.asarray(outputs(family))
