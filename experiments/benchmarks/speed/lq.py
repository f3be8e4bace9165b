"""`jcontour bench lq`: runs per second of the receding-horizon LQ contouring controller.

A run is what `evaluate` does: gains of all steps, closed loop, metrics against the contour. Every
member of a batch has weights of its own, so that nothing is computed once for all. The derivative
is that of the RMS errors with respect to alpha, beta and rho, or to these and a profile over the
horizon.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from experiments.benchmarks.speed.lq_results import (
    DeviceRate,
    LQBench,
    PreviewTime,
    ProgramTime,
    RunRates,
    SizeRate,
)
from experiments.benchmarks.speed.plain_loops import compiled_loop, numpy_loop
from experiments.benchmarks.speed.timings import arithmetic_rate, seconds, timed
from experiments.flags.others import Bench
from experiments.reports import tables
from jcontour.controllers.lq.blockwise_lq import BlockwiseLQ
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line
from jcontour.kernels.dispatch import (
    multiplications,
    on_gpu,
    rank_one_multiplications,
    suits_lanes,
    suits_rank_one,
)
from jcontour.linear.continuous_axes import (
    ContinuousAxis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference, along
from jcontour.plants import bridgeport
from jcontour.simulation.devices import Spread, device_mesh
from jcontour.simulation.evaluation import (
    evaluate,
    member,
    platform_batching,
    stack_plants,
    stack_references,
)
from jcontour.simulation.metrics import Metrics
from jcontour.simulation.programs import run_program

Tell = Callable[[str], None]  # receives a line after every measurement

STEPS, PREVIEW = 500, 10  # a quarter of a second at the paper's 2 kHz, and its usual horizon
RADIUS, ADVANCE = 0.02, 4e-5  # [m], [m per sample]: 80 mm/s
PREVIEWS = (10, 25, 200, 1000)
BLOCKS = (200, 1000)  # previews of horizons that move on by blocks
LONG = 1_000_000  # steps: 500 s of machining
RESONANCES, DAMPING = (250.0, 500.0, 900.0), 0.05  # [rad/s], of the structures of larger machines
COMPARED = 16  # runs whose gains are compared with those of a CPU
SIZES = ((2, 2), (4, 4), (3, 3, 3), (4, 4, 4), (8, 8), (5, 5, 6))  # states of every axis
DOUBLE, SINGLE = np.dtype("float64"), np.dtype("float32")


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
        family, references = stack_plants([plant]), stack_references([reference])
        return cls(*cast((plant, family, references), dtype), preview)

    @property
    def dtype(self) -> np.dtype:
        """Type of all numbers."""
        return self.plant.A.dtype

    def metrics(self, weights) -> Metrics:
        """Metrics under weights (alpha, beta, rho, then the entries of a profile, if any)."""
        alpha, beta, rho, *profile = weights
        stage = jnp.stack(profile) if profile else None
        controller = self.law(self.plant, LQWeights(alpha, beta, rho, stage), self.preview)
        found = evaluate(controller, self.plants, self.references)
        return jax.tree.map(lambda number: number[0, 0], found)

    def objective(self, weights):
        """RMS contour error and RMS tracking error [m]."""
        metrics = self.metrics(weights)
        return metrics.rms_contour_error + metrics.rms_tracking_error

    def weights(self, batch: int, profile: int = 0):
        """Random weights (batch, 3 + profile)."""
        random = np.random.default_rng(0)
        ends = np.log([(0.1, 10.0), (0.1, 10.0), (1e-12, 1e-9)] + [(0.6, 1.6)] * profile)
        return jnp.asarray(np.exp(random.uniform(*ends.T, (batch, len(ends)))), self.dtype)


def measured(flags: Bench, tell: Tell) -> LQBench:
    """Measure everything; `tell` receives a line after each part."""
    batches = flags.batch or ((1024, 65536) if on_gpu() else (1, 256))
    rates = {}
    for dtype in (DOUBLE, SINGLE):
        rates[dtype.name] = arithmetic_rate(dtype)
        tell(f"arithmetic, {dtype.name}: {tables.digits(1e-9 * rates[dtype.name])} GFLOP/s")
    loops = {}
    for name, loop in (("NumPy loop", numpy_loop), ("compiled loop", compiled_loop)):
        loops[name] = 1 / looped(loop, STEPS)
        tell(f"{name}: {tables.digits(loops[name])} runs per second")
    runs = []
    for dtype in (DOUBLE, SINGLE):
        for batch in batches:
            runs.append(rates_of(paper_case(dtype), batch, rates[dtype.name], loops["NumPy loop"]))
            tell(_told(f"{dtype.name}, batch {batch}", runs[-1].forward))
    sizes = []
    for states in SIZES:
        sizes.append(of_size(states, max(batches) // 16 or 1, rates["float64"]))
        tell(_told(f"states {sizes[-1].states}", sizes[-1].forward))
    return LQBench(
        rates=rates,
        loops=loops,
        runs=runs,
        sizes=sizes,
        previews=previews(tell),
        devices=over_devices(max(batches), tell),
        program=program(),
    )


def _told(what: str, rate: float) -> str:
    return f"{what}: {_text(rate)} runs per second"


def paper_case(dtype: np.dtype, steps: int = STEPS, preview: int = PREVIEW) -> Case:
    """The paper's machine on a circle."""
    reference = along(
        circle(RADIUS), ADVANCE * np.arange(steps), bridgeport().dt, preview, at_rest=False
    )
    return Case.of(bridgeport(), reference, preview, dtype)


def rates_of(case: Case, batch: int, rate: float, numpy_rate: float) -> RunRates:
    """Speed forward, with gradient, and with gradient of the profile too.

    Args:
        case: machine and run.
        batch: runs at once.
        rate: operations per second of the device.
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
        share_of_rate=work(case) * batch / forward.running / rate,
        compiling=forward.compiling,
        compiling_gradient=gradient.compiling,
        memory=forward.memory,
        memory_gradient=gradient.memory,
        by=formulation(case),
    )


def of_size(states: tuple[int, ...], batch: int, rate: float) -> SizeRate:
    """Speed forward on a machine whose axes have these numbers of states."""
    plant = machine(states)
    path = line([0.0] * plant.axes, [1.0] * plant.axes)
    reference = along(path, ADVANCE * np.arange(STEPS), plant.dt, PREVIEW, at_rest=True)
    case = Case.of(plant, reference, PREVIEW, DOUBLE)
    found = timed(lambda w: platform_batching()(case.metrics, w), case.weights(batch))
    return SizeRate(
        states=" + ".join(map(str, states)),
        inputs=plant.inputs,
        batch=batch,
        by=formulation(case),
        forward=batch / found.running,
        share_of_rate=work(case) * batch / found.running / rate,
        compiling=found.compiling,
        apart=apart(case),
    )


def apart(case: Case) -> float:
    """Largest difference of the gains from those of a CPU, over the largest gain.

    There they are swept by XLA, whatever the form is here.
    """

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
        tell(f"preview {preview}, {horizon}: {tables.digits(spent)} ms")
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


def program() -> ProgramTime:
    """One long program, float64: outputs and controls of all steps."""
    steps = LONG if on_gpu() else LONG // 10
    case = paper_case(DOUBLE, steps)
    controller = ContouringLQ(case.plant, LQWeights(1.0, 5.0, 1e-10), case.preview)

    def run(reference):
        return run_program(case.plant, controller, reference)

    spent = timed(run, member(case.references, 0))
    return ProgramTime(steps, 1e3 * spent.running, spent.compiling)


def machine(states: tuple[int, ...]) -> LinearPlant:
    """Speed drives in front of flexible structures, with these numbers of states in the axes.

    An axis has two states, two for every resonance, and one for half a sample of delay where the
    number is odd.
    """
    dt = 1e-3
    axes = [_axis(count, 1.0 + 0.1 * axis, dt) for axis, count in enumerate(states)]
    return sampled_machine(axes, dt)[0]


def _axis(states: int, faster: float, dt: float) -> ContinuousAxis:
    axis = speed_axis(gain=0.1, time_constant=0.02 / faster, delay=0.5 * dt * (states % 2))
    for resonance in range(states // 2 - 1):
        axis = with_resonance(axis, faster * RESONANCES[resonance], DAMPING)
    return axis


def formulation(case: Case) -> str:
    """Formulation that `receding_horizon_plan` chooses here: kernels or XLA."""
    pattern = case.plant.pattern
    if suits_rank_one(pattern, case.preview, case.plant):
        return "rank one"
    return "kernels" if suits_lanes(pattern, case.plant) else "XLA"


def work(case: Case) -> float:
    """Floating-point operations of the gains of one run, over the plant's non-zeros.

    Everything else in a run is not counted.
    """
    pattern, preview = case.plant.pattern, case.preview
    step = preview * multiplications(pattern)
    if suits_rank_one(pattern, preview, case.plant):
        step = rank_one_multiplications(pattern, preview)
    return 2.0 * case.references.steps * step


def looped(loop: Callable, steps: int) -> float:
    """Time of one run by a plain loop [s], the best of three."""
    case = paper_case(DOUBLE, steps)
    plant, r = (jax.tree.map(np.asarray, part) for part in (case.plant, member(case.references, 0)))
    start = np.asarray(case.plant.initial_state(r.position[0], r.start_increment)).reshape(-1, 1)
    weights = (1.0, 5.0, 1e-10)
    run = (plant.A, plant.B, plant.C, r.tangent, r.position, weights, steps, PREVIEW, start)
    return min(seconds(lambda: loop(*run)) for _ in range(3))


def cast(tree: Any, dtype: np.dtype) -> Any:
    """The tree with its floating-point leaves in another type."""

    def one(leaf):
        return leaf.astype(dtype) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf

    return jax.tree.map(one, tree)


RUNS = {  # heading of a column -> field, factor
    "batch": ("batch", 1.0),
    "runs/s": ("forward", 1.0),
    "with\ngradient": ("gradient", 1.0),
    "gradient /\nforward": ("gradient_ratio", 1.0),
    "with\nprofile": ("profile_ratio", 1.0),
    "times\nNumPy": ("times_numpy", 1.0),
    "% of\nrate": ("share_of_rate", 100.0),
}
COSTS = {
    "batch": ("batch", 1.0),
    "compile\ns": ("compiling", 1.0),
    "with\ngradient": ("compiling_gradient", 1.0),
    "memory\nMB": ("memory", 1e-6),
    "and with\ngradient": ("memory_gradient", 1e-6),
}
OTHERS = {
    "inputs": ("inputs", 1.0),
    "batch": ("batch", 1.0),
    "runs/s": ("forward", 1.0),
    "% of\nrate": ("share_of_rate", 100.0),
    "compile\ns": ("compiling", 1.0),
    "gains\napart": ("apart", 1.0),
}

WINDOWS = {
    "preview": ("preview", 1.0),
    "steps": ("steps", 1.0),
    "batch": ("batch", 1.0),
    "ms": ("milliseconds", 1.0),
    "times\nshortest": ("times_shortest", 1.0),
}
DEVICES = {
    "devices": ("devices", 1.0),
    "batch": ("batch", 1.0),
    "runs/s": ("forward", 1.0),
    "times\none": ("times_one", 1.0),
}


def show(console: Console, result: LQBench) -> None:
    """Print the tables, and what the runs are compared with."""
    kind = {"type": "type", "by": "by"}
    size = {"states of axes": "states", "by": "by"}
    title = f"Runs of {STEPS} steps, preview {PREVIEW}, X-Y table of 8 states, all metrics"
    console.print(_table(title, result.runs, kind, RUNS))
    console.print(_table("What they take", result.runs, kind, COSTS))
    title = "Other sizes, float64, machines of flexible axes on a straight line"
    console.print(_table(title, result.sizes, size, OTHERS))
    title = "Long previews, float64, uniform profile"
    console.print(_table(title, result.previews, {"horizon moves on": "horizon"}, WINDOWS))
    title = "Devices, float64, the same batch on each"
    console.print(_table(title, result.devices, {}, DEVICES))
    steps, spent, compiling = (tables.digits(value) for value in vars(result.program).values())
    lines = [f"one program of {steps} steps: {spent} ms, compiled in {compiling} s"]
    for name, rate in result.loops.items():
        counted = "float64, tracking and projected error only"
        lines.append(f"{name:<14} {tables.digits(rate)} runs/s, {counted}")
    for name, rate in result.rates.items():
        counted = "multiplications and additions in registers"
        lines.append(f"{name:<14} {tables.digits(1e-9 * rate)} GFLOP/s measured: {counted}")
    tables.say(console, *lines)


def _table(
    title: str, rows: Sequence[Any], words: dict[str, str], columns: dict[str, tuple[str, float]]
) -> Table:
    """Rows as lines: columns of words first, then numbers times their factors."""
    lines = []
    for row in map(asdict, rows):
        numbers = [_text(factor * row[name]) for name, factor in columns.values()]
        lines.append([*(row[word] for word in words.values()), *numbers])
    return tables.plain_table(title, [*words, *columns], lines, text_columns=len(words))


def _text(value: float) -> str:
    """Digits of a number: large ones in full, others four significant."""
    return f"{value:,.0f}" if value >= 1e4 else tables.digits(value)
