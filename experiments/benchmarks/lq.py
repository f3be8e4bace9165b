"""`jcontour bench lq`: runs per second of the receding-horizon LQ contouring controller.

A run is what `evaluate` does: gains of all steps, closed loop, metrics against the contour. Every
member of a batch has weights of its own, so that nothing is computed once for all. The derivative
is that of the RMS errors with respect to alpha, beta and rho, or to these and a profile over the
horizon.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.benchmarks.plain_loops import compiled_loop, numpy_loop
from experiments.benchmarks.timings import seconds, timed
from experiments.tables import Column, Table
from jcontour import LinearPlant, Reference, evaluate, stack_plants, stack_references
from jcontour import _kernels as kernels
from jcontour._devices import on_gpu
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import digits
from jcontour.controllers import BlockwiseLQ, ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line
from jcontour.linear.continuous_axes import (
    ContinuousAxis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from jcontour.linear.plant import Pattern, steady_motion
from jcontour.motion import along
from jcontour.plants import bridgeport
from jcontour.simulation.evaluation import member, platform_batching
from jcontour.simulation.metrics import Metrics

STEPS, PREVIEW = 500, 10  # a quarter of a second at the paper's 2 kHz, and its usual horizon
RADIUS, ADVANCE = 0.02, 4e-5  # [m], [m per sample]: 80 mm/s
RESONANCES, DAMPING = (250.0, 500.0, 900.0), 0.05  # [rad/s], of the structures of larger machines
SIZES = ((2, 2), (4, 4), (3, 3, 3), (4, 4, 4), (8, 8), (5, 5, 6))  # states of every axis
DOUBLE, SINGLE = np.dtype("float64"), np.dtype("float32")
HORIZONS = (  # how they move on, and previews
    ("by samples", ContouringLQ, (10, 25, 200)),
    ("by blocks", BlockwiseLQ, (200, 1000)),
)


@dataclass(frozen=True)
class Rate:
    """Speed and cost of runs of one machine; None where no slopes are measured."""

    name: str  # type of all numbers, states of the axes, or the preview
    by: str  # formulation that is chosen, kernels or XLA
    batch: int  # runs at once
    forward: float  # runs per second
    compiling: float  # [s]
    memory: int  # [bytes]
    gradient: float | None = None  # runs per second with the gradient of three weights
    profile: float | None = None  # likewise, with the gradient of the profile too
    compiling_gradient: float | None = None  # [s]
    memory_gradient: int | None = None  # [bytes]


@dataclass(frozen=True)
class LQBench:
    """All measurements."""

    loops: dict[str, float]  # runs per second of the plain loops
    runs: list[Rate]


class Case(NamedTuple):
    """A machine and a run on it."""

    plant: LinearPlant
    plants: LinearPlant  # the same as a family of one
    references: Reference  # one, stacked
    preview: int
    law: type[ContouringLQ] | type[BlockwiseLQ] = ContouringLQ

    @classmethod
    def of(cls, plant: LinearPlant, reference: Reference, preview: int, dtype: np.dtype) -> "Case":
        """Case with all numbers of one type."""

        def cast(leaf):
            return leaf.astype(dtype) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf

        family, references = stack_plants([plant]), stack_references([reference])
        return cls(*jax.tree.map(cast, (plant, family, references)), preview)

    @property
    def dtype(self) -> np.dtype:
        """Type of all numbers."""
        return self.plant.A.dtype

    @property
    def formulation(self) -> str:
        """Form that `evaluate` chooses here: algebra of decoupled axes or sweep, and where."""
        controller = ContouringLQ(self.plant, LQWeights(1.0, 1.0, 1.0), self.preview)
        problem = controller.decoupled_problem(member(self.references, 0))
        form = "sweep" if problem is None else "algebra"
        return f"{form}, {'kernel' if kernels.enabled() else 'XLA'}"

    def metrics(self, weights) -> Metrics:
        """Metrics under weights (alpha, beta, rho, then the entries of a profile, if any)."""
        alpha, beta, rho, *profile = weights
        stage = jnp.stack(profile) if profile else None
        controller = self.law(self.plant, LQWeights(alpha, beta, rho, stage), self.preview)
        evaluated = evaluate(self.plants, controller, self.references)
        return jax.tree.map(lambda number: number[0, 0], evaluated)

    def objective(self, weights):
        """RMS contour error and RMS tracking error [m]."""
        metrics = self.metrics(weights)
        return metrics.rms_contour_error + metrics.rms_tracking_error

    def weights(self, batch: int, profile: int = 0):
        """Random weights (batch, 3 + profile)."""
        random = np.random.default_rng(0)
        ends = np.log([(0.1, 10.0), (0.1, 10.0), (1e-12, 1e-9)] + [(0.6, 1.6)] * profile)
        return jnp.asarray(np.exp(random.uniform(*ends.T, (batch, len(ends)))), self.dtype)


def paper_case(dtype: np.dtype, steps: int = STEPS, preview: int = PREVIEW) -> Case:
    """The paper's machine on a circle."""
    reference = along(
        circle(RADIUS), ADVANCE * np.arange(steps), bridgeport().dt, preview, at_rest=False
    )
    return Case.of(bridgeport(), reference, preview, dtype)


def coupled_case() -> Case:
    """The paper's machine and run, where nothing says that its axes are decoupled."""
    case, table = paper_case(DOUBLE), bridgeport()
    every = Pattern(*(tuple((True,) * M.shape[1] for _ in M) for M in (table.A, table.B, table.C)))
    plant = LinearPlant(table.A, table.B, table.C, table.dt, every, steady_motion(table))
    return Case.of(plant, member(case.references, 0), PREVIEW, DOUBLE)


def machine(states: tuple[int, ...]) -> LinearPlant:
    """Speed drives in front of flexible structures, with these numbers of states in the axes.

    An axis has two states, two for every resonance, and one for half a sample of delay where the
    number is odd.
    """
    dt = 1e-3
    axes: list[ContinuousAxis] = []
    for k, count in enumerate(states):
        faster = 1.0 + 0.1 * k
        axis = speed_axis(gain=0.1, time_constant=0.02 / faster, delay=0.5 * dt * (count % 2))
        for resonance in range(count // 2 - 1):
            axis = with_resonance(axis, faster * RESONANCES[resonance], DAMPING)
        axes.append(axis)
    return sampled_machine(axes, dt)[0]


def measured(flags: Bench, tell: Callable[[str], None]) -> LQBench:
    """Measure everything; `tell` receives a line after each part."""
    batches = flags.batch or ((1024, 65536) if on_gpu() else (1, 256))
    loops = {}
    for name, loop in (("NumPy loop", numpy_loop), ("compiled loop", compiled_loop)):
        loops[name] = 1 / looped(loop, STEPS)
        tell(f"{name}: {digits(loops[name])} runs per second")
    cases = [
        (dtype.name, paper_case(dtype), batch, True)
        for dtype in (DOUBLE, SINGLE)
        for batch in batches
    ]
    few = max(batches) // 16 or 1
    sizes = {}
    for states in SIZES:
        plant = machine(states)
        path = line([0.0] * plant.axes, [1.0] * plant.axes)
        reference = along(path, ADVANCE * np.arange(STEPS), plant.dt, PREVIEW, at_rest=True)
        sizes[" + ".join(map(str, states))] = Case.of(plant, reference, PREVIEW, DOUBLE)
    for name, case in (sizes | {"8 coupled": coupled_case()}).items():
        cases.append((f"{name} states", case, few, False))
    steps, batch = (10_000, 1024) if on_gpu() else (10 * STEPS, 1)
    for horizon, law, previews in HORIZONS:
        for preview in previews:
            case = paper_case(DOUBLE, steps, preview)._replace(law=law)
            cases.append((f"preview {preview} {horizon}, {steps} steps", case, batch, False))
    runs = []
    for case in cases:
        runs.append(rate_of(*case))
        tell(f"{runs[-1].name}, batch {runs[-1].batch}: {runs[-1].forward:,.5g} runs per second")
    return LQBench(loops, runs)


def rate_of(name: str, case: Case, batch: int, slopes: bool) -> Rate:
    """Speed of so many runs at once, maybe with gradient, and with gradient of the profile too."""
    batching, weights = platform_batching(), case.weights(batch)
    forward = timed(lambda w: batching(case.metrics, w), weights)
    row = Rate(
        name, case.formulation, batch, batch / forward.running, forward.compiling, forward.memory
    )
    if not slopes:
        return row

    def with_gradient(w):
        return batching(jax.value_and_grad(case.objective), w)

    gradient = timed(with_gradient, weights)
    profile = timed(with_gradient, case.weights(batch, case.preview))
    return replace(
        row,
        gradient=batch / gradient.running,
        profile=batch / profile.running,
        compiling_gradient=gradient.compiling,
        memory_gradient=gradient.memory,
    )


def looped(loop: Callable, steps: int) -> float:
    """Time of one run by a plain loop [s], the best of three."""
    case = paper_case(DOUBLE, steps)
    plant, r = (jax.tree.map(np.asarray, part) for part in (case.plant, member(case.references, 0)))
    start = np.asarray(case.plant.initial_state(r.position[0], r.start_increment)).reshape(-1, 1)
    weights = (1.0, 5.0, 1e-10)
    machine, path = (plant.A, plant.B, plant.C), (r.tangent, r.position)
    run = machine, path, weights, steps, PREVIEW, start
    return min(seconds(lambda: loop(*run)) for _ in range(3))


def rates(result: LQBench) -> dict[str, float]:
    """Runs per second by name, for `stored_results`."""
    kinds = {"forward": "forward", "value and gradient": "gradient", "with a profile": "profile"}
    return {
        f"{run.name}, batch {run.batch}, {words}": getattr(run, kind)
        for run in result.runs
        for words, kind in kinds.items()
        if getattr(run, kind) is not None
    }


def tables(result: LQBench) -> Iterator[Table | str]:
    """Rates and costs, and the loops that they are compared with."""
    kind: dict[str, Column] = {"runs": "name", "by": "by", "batch": "batch:,"}
    yield Table(
        f"Runs per second, {STEPS} steps and preview {PREVIEW} where nothing else is said",
        result.runs,
        {
            **kind,
            "forward": "forward:,.5g",
            "with\ngradient": "gradient:,.5g",
            "with\nprofile": "profile:,.5g",
            "times\nNumPy": lambda run: f"{run.forward / result.loops['NumPy loop']:.4g}",
        },
        words=2,
    )
    yield Table(
        "What they take",
        result.runs,
        {
            **kind,
            "compile\ns": "compiling:.4g",
            "with\ngradient": "compiling_gradient:.4g",
            "memory\nbytes": "memory:.4g",
            "with\ngradient ": "memory_gradient:.4g",
        },
        words=2,
    )
    for name, rate in result.loops.items():
        yield f"{name:<14} {digits(rate)} runs/s, float64, tracking and projected error only"
