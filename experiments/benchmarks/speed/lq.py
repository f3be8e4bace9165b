"""`jcontour bench lq`: runs per second of the receding-horizon LQ contouring controller.

A run is what `evaluate` does: gains of all steps, closed loop, metrics against the contour. Every
member of a batch has weights of its own, so that nothing is computed once for all. The derivative
is that of the RMS errors with respect to alpha, beta and rho, or to these and a profile over the
horizon.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import jax
import numpy as np

from experiments.benchmarks.speed.lq_cases import (
    DOUBLE,
    PREVIEW,
    SINGLE,
    SIZES,
    STEPS,
    Case,
    coupled_case,
    formulation,
    paper_case,
    sized_case,
)
from experiments.benchmarks.speed.plain_loops import compiled_loop, numpy_loop
from experiments.benchmarks.speed.timings import seconds, timed
from experiments.tables import Column, Table
from jcontour._devices import on_gpu
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import digits
from jcontour.controllers.lq.blockwise_lq import BlockwiseLQ
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.simulation.devices import Spread, device_mesh
from jcontour.simulation.evaluation import member, platform_batching

Tell = Callable[[str], None]  # receives a line after every measurement

PREVIEWS = (10, 25, 200, 1000)
BLOCKS = (200, 1000)  # previews of horizons that move on by blocks
COMPARED = 16  # runs whose gains are compared with those of a CPU


@dataclass(frozen=True)
class RunRates:
    """Speed and cost of a batch of runs on the paper's machine.

    Attributes:
        type: of all numbers.
        batch: runs at once.
        forward: runs per second.
        gradient: runs per second with the gradient of three weights.
        gradient_ratio: time with gradient over time without.
        profile_ratio: likewise, with the gradient of the profile too.
        times_numpy: runs per second over those of the NumPy loop.
        compiling: [s].
        compiling_gradient: [s].
        memory: [bytes].
        memory_gradient: [bytes].
        by: formulation that is chosen, kernels or XLA.
    """

    type: str
    batch: int
    forward: float
    gradient: float
    gradient_ratio: float
    profile_ratio: float
    times_numpy: float
    compiling: float
    compiling_gradient: float
    memory: int
    memory_gradient: int
    by: str


@dataclass(frozen=True)
class SizeRate:
    """Runs per second, forward, on a machine of another size.

    Attributes:
        states: of the axes.
        inputs: controls.
        batch: runs at once.
        by: formulation that is chosen.
        forward: runs per second.
        compiling: [s].
        apart: largest difference of the gains from those of a CPU, over the largest gain.
    """

    states: str
    inputs: int
    batch: int
    by: str
    forward: float
    compiling: float
    apart: float


@dataclass(frozen=True)
class PreviewTime:
    """Time of a batch with one preview, forward, and its ratio to the shortest preview.

    Attributes:
        preview: samples.
        horizon: how it moves on, by samples or by blocks.
        steps: of a run.
        batch: runs at once.
        milliseconds: of the batch.
        times_shortest: over the first preview's.
    """

    preview: int
    horizon: str
    steps: int
    batch: int
    milliseconds: float
    times_shortest: float


@dataclass(frozen=True)
class DeviceRate:
    """Runs per second, forward, on several devices, and its ratio to one device."""

    devices: int
    batch: int
    forward: float
    times_one: float


@dataclass(frozen=True)
class LQBench:
    """All measurements.

    Attributes:
        loops: runs per second of the plain loops.
    """

    loops: dict[str, float]
    runs: list[RunRates]
    sizes: list[SizeRate]
    previews: list[PreviewTime]
    devices: list[DeviceRate]


def measured(flags: Bench, tell: Tell) -> LQBench:
    """Measure everything; `tell` receives a line after each part."""
    batches = flags.batch or ((1024, 65536) if on_gpu() else (1, 256))
    loops = {}
    for name, loop in (("NumPy loop", numpy_loop), ("compiled loop", compiled_loop)):
        loops[name] = 1 / looped(loop, STEPS)
        tell(f"{name}: {digits(loops[name])} runs per second")
    runs = []
    for dtype in (DOUBLE, SINGLE):
        for batch in batches:
            runs.append(rates_of(paper_case(dtype), batch, loops["NumPy loop"]))
            tell(_told(f"{dtype.name}, batch {batch}", runs[-1].forward))
    sizes = []
    for states in SIZES:
        named = " + ".join(map(str, states))
        sizes.append(rate_of(sized_case(states), named, max(batches) // 16 or 1))
        tell(_told(f"states {sizes[-1].states}", sizes[-1].forward))
    sizes.append(rate_of(coupled_case(), "8 coupled", max(batches) // 16 or 1))
    tell(_told("states 8 coupled", sizes[-1].forward))
    return LQBench(
        loops=loops,
        runs=runs,
        sizes=sizes,
        previews=previews(tell),
        devices=over_devices(max(batches), tell),
    )


def rates(result: LQBench) -> dict[str, float]:
    """Runs per second by name, for `stored_results`."""
    found = {}
    for run in result.runs:
        name = f"{run.type}, batch {run.batch}"
        found[f"{name}, forward"] = run.forward
        found[f"{name}, value and gradient"] = run.gradient
        found[f"{name}, with a profile"] = run.forward / run.profile_ratio
    for size in result.sizes:
        found[f"{size.states} states, batch {size.batch}, forward"] = size.forward
    for row in result.previews:
        name = f"preview {row.preview} {row.horizon}, {row.steps} steps, batch {row.batch}"
        found[name] = 1e3 * row.batch / row.milliseconds
    return found


def tables(result: LQBench) -> Iterator[Table | str]:
    """Rates and costs, and the loops that they are compared with."""
    kind: dict[str, Column] = {"type": "type", "by": "by", "batch": "batch:,"}
    yield Table(
        f"Runs of {STEPS} steps, preview {PREVIEW}, X-Y table of 8 states, all metrics",
        result.runs,
        {
            **kind,
            "runs/s": "forward:,.5g",
            "with\ngradient": "gradient:,.5g",
            "gradient /\nforward": "gradient_ratio:.4g",
            "with\nprofile": "profile_ratio:.4g",
            "times\nNumPy": "times_numpy:.4g",
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
            "memory\nMB": lambda row: f"{1e-6 * row.memory:,.4g}",
            "and with\ngradient": lambda row: f"{1e-6 * row.memory_gradient:,.4g}",
        },
        words=2,
    )
    yield Table(
        "Other sizes, float64, machines of flexible axes on a straight line",
        result.sizes,
        {
            "states of axes": "states",
            "by": "by",
            "inputs": "inputs",
            "batch": "batch:,",
            "runs/s": "forward:,.5g",
            "compile\ns": "compiling:.4g",
            "gains\napart": "apart:.4g",
        },
        words=2,
    )
    yield Table(
        "Long previews, float64, uniform profile",
        result.previews,
        {
            "horizon moves on": "horizon",
            "preview": "preview",
            "steps": "steps:,",
            "batch": "batch:,",
            "ms": "milliseconds:.4g",
            "times\nshortest": "times_shortest:.4g",
        },
    )
    yield Table(
        "Devices, float64, the same batch on each",
        result.devices,
        {
            "devices": "devices",
            "batch": "batch:,",
            "runs/s": "forward:,.5g",
            "times\none": "times_one:.4g",
        },
        words=0,
    )
    for name, rate in result.loops.items():
        yield f"{name:<14} {digits(rate)} runs/s, float64, tracking and projected error only"


def _told(what: str, rate: float) -> str:
    return f"{what}: {rate:,.5g} runs per second"


def rates_of(case: Case, batch: int, numpy_rate: float) -> RunRates:
    """Speed forward, with gradient, and with gradient of the profile too.

    Args:
        case: machine and run.
        batch: runs at once.
        numpy_rate: runs per second of the NumPy loop.
    """
    batching, weights = platform_batching(), case.weights(batch)

    def with_gradient(w):
        return batching(jax.value_and_grad(case.objective), w)

    forward = timed(lambda w: batching(case.metrics, w), weights)
    gradient = timed(with_gradient, weights)
    profile = timed(with_gradient, case.weights(batch, case.preview))
    return RunRates(
        type=case.dtype.name,
        batch=batch,
        forward=batch / forward.running,
        gradient=batch / gradient.running,
        gradient_ratio=gradient.running / forward.running,
        profile_ratio=profile.running / forward.running,
        times_numpy=batch / forward.running / numpy_rate,
        compiling=forward.compiling,
        compiling_gradient=gradient.compiling,
        memory=forward.memory,
        memory_gradient=gradient.memory,
        by=formulation(case),
    )


def rate_of(case: Case, states: str, batch: int) -> SizeRate:
    """Speed forward on a machine of another size."""
    found = timed(lambda w: platform_batching()(case.metrics, w), case.weights(batch))
    return SizeRate(
        states=states,
        inputs=case.plant.inputs,
        batch=batch,
        by=formulation(case),
        forward=batch / found.running,
        compiling=found.compiling,
        apart=apart(case),
    )


def apart(case: Case) -> float:
    """Largest difference of the gains from those of a CPU, over the largest gain."""

    def gains(weights):
        controller = case.law(case.plant, LQWeights(*weights), case.preview)
        return controller.prepare(member(case.references, 0)).F

    found = jax.jit(jax.vmap(gains))(case.weights(COMPARED))
    with jax.default_device(jax.devices("cpu")[0]):
        swept = jax.jit(jax.vmap(gains))(np.asarray(case.weights(COMPARED)))
    difference = np.abs(np.asarray(found) - np.asarray(swept))
    return float(np.max(difference) / np.max(np.abs(swept)))


def previews(tell: Tell) -> list[PreviewTime]:
    """Long windows beside short ones, float64, uniform profile."""
    steps, batch = (10_000, 1024) if on_gpu() else (10 * STEPS, 1)
    by_sample = [(preview, "by samples", ContouringLQ) for preview in PREVIEWS]
    by_block = [(preview, "by blocks", BlockwiseLQ) for preview in BLOCKS]
    found: list[PreviewTime] = []
    for preview, horizon, law in by_sample + by_block:
        case = paper_case(DOUBLE, steps, preview)._replace(law=law)

        def run(weights, case=case):
            return platform_batching()(case.metrics, weights)

        spent = 1e3 * timed(run, case.weights(batch)).running
        first = found[0].milliseconds if found else spent
        found.append(PreviewTime(preview, horizon, steps, batch, spent, spent / first))
        tell(f"preview {preview}, {horizon}: {digits(spent)} ms")
    return found


def over_devices(batch: int, tell: Tell) -> list[DeviceRate]:
    """Speed forward, float64, the same batch on each of 1, 2, 4 ... devices."""
    case, found = paper_case(DOUBLE), []
    for power in range(jax.device_count().bit_length()):
        count = 2**power
        spread = Spread(device_mesh(count))

        def run(weights, spread=spread):
            return spread(case.metrics, weights)

        spent = timed(run, case.weights(batch * count)).running
        rate = batch * count / spent
        slowest = found[0].forward if found else rate
        found.append(DeviceRate(count, batch * count, rate, rate / slowest))
        tell(_told(f"devices {count}", rate))
    return found


def looped(loop: Callable, steps: int) -> float:
    """Time of one run by a plain loop [s], the best of three."""
    case = paper_case(DOUBLE, steps)
    plant, r = (jax.tree.map(np.asarray, part) for part in (case.plant, member(case.references, 0)))
    start = np.asarray(case.plant.initial_state(r.position[0], r.start_increment)).reshape(-1, 1)
    weights = (1.0, 5.0, 1e-10)
    run = (plant.A, plant.B, plant.C, r.tangent, r.position, weights, steps, PREVIEW, start)
    return min(seconds(lambda: loop(*run)) for _ in range(3))
