"""Machines, scenarios and results for tests of what is said of runs: real ones, with few samples.

Signals are zero until a test writes into them.
"""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jcontour.app.files.results.run_metrics import FamilyMetrics, MachineSummary, RunMetrics
from jcontour.app.files.results.tuned_result import PathMargins, TunedResult
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.jobs.job import Job
from jcontour.app.jobs.replays import Replay, Scenarios
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.machines.uncertainty import Uncertainty
from jcontour.geometry.contours import line
from jcontour.geometry.toolpaths import Toolpath
from jcontour.motion.references import Reference
from jcontour.simulation.metrics import Metrics
from tests import canonical
from tuning.objectives import Outcome
from tuning.tuner import Tuned

Kind = TypeVar("Kind")
LINE = line([0.0, 0.0], [1e-2, 0.0])
NO_LIMITS = MachineLimits()


def partly(kind: type[Kind], **given: Any) -> Kind:
    """An object of which a test reads these attributes alone; of a tuple the others are None.

    Raises:
        AttributeError, TypeError: the type has no attribute of that name.
    """
    if issubclass(kind, tuple):
        return kind(**dict.fromkeys(kind._fields) | given)
    stated = {name for one in kind.__mro__ for name in getattr(one, "__annotations__", ())}
    if unknown := set(given) - stated - {*dir(kind), *kind.__init__.__code__.co_names}:
        raise AttributeError(f"{kind.__name__} has no {', '.join(sorted(unknown))}")
    attributes = {name: staticmethod(one) if callable(one) else one for name, one in given.items()}
    part = type(kind)(kind.__name__, (kind,), attributes)
    part.__abstractmethods__ = frozenset()
    return object.__new__(part)


def machine(limits: MachineLimits = NO_LIMITS, axes: int = 2, **others: Any) -> LinearMachine:
    """The canonical plant as a machine that states these limits."""
    given: dict[str, Any] = {
        "known_delay": 1,
        "uncertainty": Uncertainty(0.1, 1),
        "encoder_resolution": 1e-6,
        "control_noise": 1e-3,
        "name": "mill",
        "control_unit": "A",
    }
    given |= others
    return LinearMachine(
        model=canonical.plant(axes), axes=tuple("XYZ"[:axes]), limits=limits, **given
    )


def job(
    name: str, scored: np.ndarray, at_rest: bool = True, program: Toolpath | None = None
) -> Job:
    """A run with so many samples, and which of them are scored."""
    return Job(name, LINE, np.linspace(0.0, 1e-2, len(scored)), scored, at_rest, "", program)


def scenarios(
    jobs: Sequence[Any],
    position: np.ndarray,
    mask: np.ndarray,
    steps: int | None = None,
    plants: Sequence[str] = ("nominal", "late"),
    training: Sequence[bool] | None = None,
) -> Scenarios:
    """Jobs along positions (contour, sample, axis) [m], on the canonical family."""
    contours, samples, axes = position.shape
    tangent = np.tile(np.eye(axes)[0], (contours, samples, 1))
    arc = np.tile(np.linspace(0.0, 1e-2, samples), (contours, 1))
    entry = np.zeros((contours, axes))
    steps = samples if steps is None else steps
    stacked = [jnp.asarray(one) for one in (position, tangent, arc, mask, entry)]
    first = Reference(*(one[0] for one in stacked), LINE, canonical.DT, steps)
    references = eqx.tree_at(
        lambda r: [r.position, r.tangent, r.arc, r.mask, r.start_increment], first, stacked
    )
    seen = (True,) * contours if training is None else training
    return Scenarios(tuple(jobs), tuple(seen), tuple(plants), references, canonical.family(2))


def metrics(shape: tuple[int, int], **given: Any) -> Metrics:
    """Metrics (contour, plant): zero and not diverged, but for those that are given."""
    numbers = {one.name: np.zeros(shape) for one in fields(Metrics)}
    return Metrics(**{**numbers, "diverged": np.zeros(shape, bool), **given})


def replay(samples: int, shape: tuple[int, int] = (1, 2), **given: Any) -> Replay:
    """Runs (contour, plant) at rest, on two axes."""
    output, control, error = (np.zeros((*shape, samples, 2)) for _ in range(3))
    return Replay(metrics(shape, **given), output, control, error)


def run_metrics(size: float, **given: Any) -> RunMetrics:
    """Stored metrics of a run: every number is `size`, but for those that are given."""
    numbers = dict.fromkeys((one.name for one in fields(RunMetrics)), size)
    return RunMetrics(**{**numbers, "diverged": False, **given})


def family_metrics(size: float, **given: Any) -> FamilyMetrics:
    """The same numbers on the nominal plant and on the worst one."""
    return FamilyMetrics(*2 * [run_metrics(size, **given)])


def margins(**given: Any) -> PathMargins:
    """Margins of a loop that bears half and twice its gain, and three samples of delay."""
    usual: dict[str, Any] = {
        "spectral_radius": 0.9,
        "gain_range": ((0.5, 2.0),),
        "gain_search": (0.05, 20.0),
        "delay_samples": 3,
        "delay_search": 10,
        "probes_per_contour": 48,
        "probes_left_out": 0,
        "contours_without_margins": (),
        "lost_first": None,
    }
    return PathMargins(**usual | given)


def tuned(**given: Any) -> Tuned:
    """What a search found that kept its limits and ended."""
    usual: dict[str, Any] = {
        "weights": {},
        "outcome": Outcome(metrics((2, 2))),
        "feasible": True,
        "violation": -0.1,
        "diverged_points": 0,
        "diverged_starts": 0,
        "history": [],
        "prices": [],
        "stabilised": False,
        "stationary": True,
    }
    return Tuned(**usual | given)


def tuned_result(**given: Any) -> TunedResult:
    """The stored result of a run of `tune` that kept its limits."""
    usual: dict[str, Any] = {
        "machine": MachineSummary("mill", "A", ("X", "Y"), "counts"),
        "controller": "contouring-lq",
        "error": "contour",
        "preview": 10,
        "start": {"alpha": 1.0},
        "weights": {"alpha": 4.0},
        "weight_lines": [],
        "feasible": True,
        "violation": 0.0,
        "verdict": Verdict.of([]),
        "limits": {},
        "evaluated_points": 1,
        "diverged_points": 0,
        "diverged_starts": 0,
        "descents": 1,
        "plants": ["nominal"],
        "margins": margins(),
        "start_margins": margins(),
        "contours": [],
        "training_samples": 5,
        "seconds": 1.0,
        "sample_period": 1e-3,
    }
    return TunedResult(**usual | given)
