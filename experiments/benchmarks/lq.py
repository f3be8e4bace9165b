"""`jcontour bench lq`: whole runs of the receding-horizon LQ contouring controller per second, forward and with gradient.

A run is what `evaluate` does: gains of all steps, closed loop, metrics against the contour. Every
member of a batch has weights of its own, so that nothing is computed once for all. The derivative
is that of the RMS errors with respect to alpha, beta and rho, or to these and a profile over the
horizon.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from experiments.benchmarks.plain_loops import compiled_loop, numpy_loop
from experiments.benchmarks.timings import arithmetic_rate, seconds, timed
from experiments.options import Bench
from experiments.reports import tables
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line
from jcontour.kernels.dispatch import multiplications, on_gpu, suits_lanes
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

STEPS, PREVIEW = 500, 10  # a quarter of a second at the paper's 2 kHz, and its usual horizon
RADIUS, ADVANCE = 0.02, 4e-5  # [m], [m per sample]: 80 mm/s
PREVIEWS = (10, 25, 200, 1000)
LONG = 1_000_000  # steps: 500 s of machining
SIZES = ((2, 2), (4, 4), (3, 3, 3), (4, 4, 4), (8, 8), (5, 5, 6))  # states of every axis


class Case(NamedTuple):
    """A machine with a run to make."""

    plant: LinearPlant
    plants: LinearPlant  # the same as a family of one
    references: Reference  # one, stacked
    preview: int

    @classmethod
    def of(cls, plant: LinearPlant, reference: Reference, preview: int, dtype: np.dtype) -> "Case":
        """With all numbers of one type."""
        return cls(
            *cast((plant, stack_plants([plant]), stack_references([reference])), dtype), preview
        )

    @property
    def dtype(self) -> np.dtype:
        """Type of all numbers."""
        return self.plant.A.dtype

    def metrics(self, weights) -> Metrics:
        """Of the run under weights (alpha, beta, rho, entries of the profile if there are any)."""
        alpha, beta, rho, *profile = weights
        controller = ContouringLQ(
            self.plant,
            LQWeights(alpha, beta, rho, jnp.stack(profile) if profile else None),
            self.preview,
        )
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


def rows(flags: Bench) -> dict[str, Any]:
    """Everything that is measured."""
    batches = flags.batch or ((1024, 65536) if on_gpu() else (1, 256))
    types = [np.dtype("float64"), np.dtype("float32")]
    rates = {dtype.name: arithmetic_rate(dtype) for dtype in types}
    loops = {
        name: looped(loop, STEPS)
        for name, loop in (("NumPy loop", numpy_loop), ("compiled loop", compiled_loop))
    }
    slowest = loops["NumPy loop"]
    runs = [
        measured(paper_case(dtype), batch, rates[dtype.name], slowest)
        for dtype in types
        for batch in batches
    ]
    sizes = [of_size(states, max(batches) // 16 or 1, rates["float64"]) for states in SIZES]
    return {
        "rates": rates,
        "loops": {name: 1 / spent for name, spent in loops.items()},
        "runs": runs,
        "sizes": sizes,
        "previews": previews(),
        "devices": over_devices(max(batches)),
        "program": program(),
    }


def paper_case(dtype: np.dtype, steps: int = STEPS, preview: int = PREVIEW) -> Case:
    """The paper's machine on a circle."""
    reference = along(
        circle(RADIUS), ADVANCE * np.arange(steps), bridgeport().dt, preview, at_rest=False
    )
    return Case.of(bridgeport(), reference, preview, dtype)


def measured(case: Case, batch: int, rate: float, slowest: float) -> dict[str, Any]:
    """Forward, with gradient, and with gradient of the profile too."""
    batching, weights = platform_batching(), case.weights(batch)
    forward = timed(lambda w: batching(case.metrics, w), weights)
    gradient = timed(lambda w: batching(jax.value_and_grad(case.objective), w), weights)
    profile = timed(
        lambda w: batching(jax.value_and_grad(case.objective), w), case.weights(batch, case.preview)
    )
    return {
        "type": case.dtype.name,
        "batch": batch,
        "forward": batch / forward.running,
        "gradient": batch / gradient.running,
        "gradient_ratio": gradient.running / forward.running,
        "profile_ratio": profile.running / forward.running,
        "times_numpy": slowest * batch / forward.running,
        "share_of_rate": work(case) * batch / forward.running / rate,
        "compiling": forward.compiling,
        "compiling_gradient": gradient.compiling,
        "memory": forward.memory,
        "memory_gradient": gradient.memory,
        "by": formulation(case),
    }


def of_size(states: tuple[int, ...], batch: int, rate: float) -> dict[str, Any]:
    """Forward, of a machine with so many states in every axis."""
    plant = machine(states)
    path = line([0.0] * plant.axes, [1.0] * plant.axes)
    case = Case.of(
        plant,
        along(path, ADVANCE * np.arange(STEPS), plant.dt, PREVIEW, at_rest=True),
        PREVIEW,
        np.dtype("float64"),
    )
    found = timed(lambda w: platform_batching()(case.metrics, w), case.weights(batch))
    name = " + ".join(map(str, states))
    return {
        "states": name,
        "inputs": plant.inputs,
        "batch": batch,
        "by": formulation(case),
        "forward": batch / found.running,
        "share_of_rate": work(case) * batch / found.running / rate,
        "compiling": found.compiling,
    }


def previews() -> list[dict[str, Any]]:
    """Long windows beside short ones, float64, uniform profile."""
    steps, batch = (10_000, 1024) if on_gpu() else (STEPS, 1)
    found = []
    for preview in PREVIEWS:
        case = paper_case(np.dtype("float64"), steps, preview)
        spent = timed(
            lambda w, case=case: platform_batching()(case.metrics, w), case.weights(batch)
        ).running
        found.append(
            {"preview": preview, "steps": steps, "batch": batch, "milliseconds": 1e3 * spent}
        )
    return [
        {**row, "times_shortest": row["milliseconds"] / found[0]["milliseconds"]} for row in found
    ]


def over_devices(batch: int) -> list[dict[str, Any]]:
    """Forward, float64, the same batch on each of 1, 2, 4 ... devices."""
    case, found = paper_case(np.dtype("float64")), []
    for count in [
        2**k for k in range(jax.device_count().bit_length()) if 2**k <= jax.device_count()
    ]:
        spread, weights = Spread(device_mesh(count)), case.weights(batch * count)
        spent = timed(lambda w, spread=spread: spread(case.metrics, w), weights).running
        found.append({"devices": count, "batch": batch * count, "forward": batch * count / spent})
    return [{**row, "times_one": row["forward"] / found[0]["forward"]} for row in found]


def program() -> dict[str, float]:
    """One long program, float64: outputs and controls of all steps."""
    steps = LONG if on_gpu() else LONG // 10
    case = paper_case(np.dtype("float64"), steps)
    controller = ContouringLQ(case.plant, LQWeights(1.0, 5.0, 1e-10), case.preview)
    spent = timed(
        lambda reference: run_program(case.plant, controller, reference), member(case.references, 0)
    )
    return {"steps": steps, "milliseconds": 1e3 * spent.running, "compiling": spent.compiling}


def machine(states: tuple[int, ...]) -> LinearPlant:
    """A stable machine whose axes have so many states."""
    random, owner = np.random.default_rng(sum(states)), np.repeat(np.arange(len(states)), states)
    A, B, C = (
        random.standard_normal(shape)
        for shape in (
            (owner.size, owner.size),
            (owner.size, len(states)),
            (len(states), owner.size),
        )
    )
    A *= owner[:, None] == owner
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    acts = owner[:, None] == np.arange(len(states))
    return LinearPlant(A, B * acts, C * acts.T, 1e-3)


def formulation(case: Case) -> str:
    """What `receding_horizon_plan` chooses here."""
    return "kernels" if suits_lanes(case.plant.pattern, case.plant) else "XLA"


def work(case: Case) -> float:
    """Floating-point operations of the sweeps of one run over the non-zeros of the plant; what else a run does is not counted."""
    return 2.0 * case.references.steps * case.preview * multiplications(case.plant.pattern)


def looped(loop: Callable, steps: int) -> float:
    """Seconds of one run by a plain loop, the best of three."""
    case = paper_case(np.dtype("float64"), steps)
    plant, r = (jax.tree.map(np.asarray, part) for part in (case.plant, member(case.references, 0)))
    start = np.asarray(case.plant.initial_state(r.position[0], r.start_increment)).reshape(-1, 1)
    return min(
        seconds(
            lambda: loop(
                plant.A,
                plant.B,
                plant.C,
                r.tangent,
                r.position,
                (1.0, 5.0, 1e-10),
                steps,
                PREVIEW,
                start,
            )
        )
        for _ in range(3)
    )


def cast(tree: Any, dtype: np.dtype) -> Any:
    """Floating-point leaves as another type."""
    return jax.tree.map(
        lambda leaf: leaf.astype(dtype) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf, tree
    )


RUNS = {  # heading of a column -> what is in it, and its factor
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


def show(console: Console, summary: dict[str, Any]) -> None:
    """Tables, and what the runs are compared with."""

    def table(
        title: str, key: str, words: dict[str, str], columns: dict[str, tuple[str, float]]
    ) -> None:
        lines = [
            [*(r[w] for w in words.values()), *(_text(f * r[n]) for n, f in columns.values())]
            for r in summary[key]
        ]
        console.print(tables.plain_table(title, [*words, *columns], lines, text_columns=len(words)))

    table(
        f"Runs of {STEPS} steps, preview {PREVIEW}, X-Y table of 8 states, all metrics",
        "runs",
        {"type": "type", "by": "by"},
        RUNS,
    )
    table("What they take", "runs", {"type": "type", "by": "by"}, COSTS)
    table(
        "Other sizes, float64, random machines on a straight line",
        "sizes",
        {"states of axes": "states", "by": "by"},
        OTHERS,
    )
    table("Long previews, float64, uniform profile", "previews", {}, WINDOWS)
    table("Devices, float64, the same batch on each", "devices", {}, DEVICES)
    long = {name: tables.digits(value) for name, value in summary["program"].items()}
    tables.say(
        console,
        f"one program of {long['steps']} steps: {long['milliseconds']} ms, compiled in {long['compiling']} s",
    )
    for name, rate in summary["loops"].items():
        tables.say(
            console,
            f"{name:<14} {tables.digits(rate)} runs/s, float64, tracking and projected error only",
        )
    for name, rate in summary["rates"].items():
        tables.say(
            console,
            f"{name:<14} {tables.digits(1e-9 * rate)} GFLOP/s measured: multiplications and additions in registers",
        )


def _text(value: float) -> str:
    """Counts in full, everything else with four digits."""
    return f"{value:,.0f}" if value >= 1e4 else tables.digits(value)
