"""The gap table: what limits at every sample cost a tuned controller.

Its weights are replayed through the constrained MPC, on the same contours, plants, observer and
scores. Where no limit is active the two runs are equal, so the gap is the limits' doing.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.controller import Controller
from jcontour.host.controller import HostController
from jcontour.host.loop import Fallback, HostRun, Stopped, reported_loop
from jcontour.motion.references import Reference
from jcontour.mpc.tracking.limits import Limits
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import Metrics, score


class Gap(NamedTuple):
    """One contour on one plant."""

    # contour, plant: names
    contour: str
    plant: str
    without: Metrics  # metrics of the tuned controller
    within: Metrics | None  # metrics under the limits; None when the run stopped
    # largest magnitude of every limited signal by component, under the limits
    reached: dict[str, Float[np.ndarray, " d"]]
    stopped: int | None  # step without an answer that ended the run, None when it went through
    failure: str  # why, in one line; empty when it went through
    run: HostRun  # the constrained run, or the part of it before it stopped


def verify(
    tuned: Controller,
    constrained: HostController,
    limits: Limits,
    references: Mapping[str, Reference],
    plants: Mapping[str, Plant],
    fallback: Fallback | None = None,
) -> Iterator[Gap]:
    """Every contour on every plant, one after another as they are done.

    Args:
        tuned: the controller as it was tuned.
        constrained: the same weights under limits.
        limits: those it keeps to.
        references: by name.
        plants: by name; stacked ones have to be taken apart first (`evaluation.member`).
        fallback: what a step without an answer does; the run stops when None.

    Raises:
        ValueError: limits, preview or sample period do not fit.
    """
    for contour, reference in references.items():
        for name, plant in plants.items():
            without = score(simulate(plant, tuned, reference), reference)
            run, stopped = _constrained(plant, constrained, reference, fallback)
            yield Gap(
                contour,
                name,
                without,
                score(run.rollout, reference) if stopped is None else None,
                reached(run.rollout.output, run.rollout.control, reference.dt, limits),
                None if stopped is None else stopped.step,
                "" if stopped is None else str(stopped),
                run,
            )


def reached(
    output: Float[ArrayLike, "T m"], control: Float[ArrayLike, "T p"], dt: float, limits: Limits
) -> dict[str, Float[np.ndarray, " d"]]:
    """Largest magnitude of every limited signal of a run by component; 0 without a sample.

    >>> output, control = np.array([[0.0], [1e-3], [3e-3]]), np.ones((3, 1))
    >>> largest = reached(output, control, 1e-3, Limits.within(speed=1.0))
    >>> largest["speed"].tolist()
    [2.0]
    """
    y, u = np.asarray(output), np.asarray(control)
    signals = {
        "control": u,
        "increment": np.diff(u, axis=0),
        "output": y,
        "speed": np.diff(y, axis=0) / dt,
        "acceleration": np.diff(y, 2, axis=0) / dt**2,
    }
    return {
        name: np.abs(values).max(axis=0, initial=0.0)
        for name, values in signals.items()
        if getattr(limits, name) is not None
    }


def _constrained(
    plant: Plant, controller: HostController, reference: Reference, fallback: Fallback | None
) -> tuple[HostRun, Stopped | None]:
    try:
        return reported_loop(plant, controller, reference, fallback=fallback), None
    except Stopped as stopped:
        return stopped.run, stopped
