"""`jcontour bench whole_way`: log of a hidden machine, identify, tune, and back on that machine.

Beside it the same with the true model in the machine file, its limits and its family unchanged:
what is lost is lost by identifying.
"""

import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from scipy.linalg import block_diag

from experiments.benchmarks.hidden_machines import (
    DT,
    KINDS,
    hidden_axis,
    hidden_record,
    true_model,
)
from experiments.benchmarks.identify import MOST_DELAY, MOST_POLES
from experiments.flags.others import Bench
from experiments.flags.tuning import Tune
from experiments.machines.from_file import machine_from
from experiments.machines.identified import machine_fields
from experiments.reports import tables
from experiments.runs.tuning.problem import tuning_run
from experiments.runs.tuning.searching import NothingSound, searched
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import score
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.recording import RecordedAxis


@dataclass(frozen=True)
class Way:
    """One hidden machine.

    Attributes:
        seed, takes: which one.
        delays: true ones of its axes [samples].
        errors: by contour, the RMS contour error on the hidden machine [m]: tuned on the
            identified model, inf where every point of that search diverged, and on the true one,
            NaN where every point of that did; no contour where both did.
        gain, late: family of the identified machine file.
        sound: whether both searches found weights that keep all limits.
        diverged: whether any run of either design did, or every point of a search.
    """

    seed: int
    takes: str
    delays: tuple[int, ...]
    errors: dict[str, tuple[float, float]]
    gain: float
    late: int
    sound: bool
    diverged: bool

    @property
    def means(self) -> tuple[float, float]:
        """Mean errors over the contours [m], of both designs; NaN where there is no contour."""
        pairs = list(self.errors.values()) or [(np.nan, np.nan)]
        identified, true = np.mean(pairs, axis=0)
        return float(identified), float(true)

    @property
    def ratio(self) -> float:
        """Mean error over the contours, over that of tuning on the true machine, or NaN."""
        return _over(*self.means)

    @property
    def worst(self) -> float:
        """Largest of the ratios of single contours; NaN where one is, and where there is none."""
        ratios = [_over(one, true) for one, true in self.errors.values()]
        return float(np.max(ratios or [np.nan]))


def _over(identified: float, true: float) -> float:
    """Ratio of two errors; NaN where tuning on the true machine has none."""
    return identified / true if np.isfinite(true) else np.nan


@dataclass(frozen=True)
class WholeWayBench:
    """One row for every machine."""

    machines: list[Way]


@dataclass(frozen=True)
class OnTheMachine:
    """A tuned design on the true machine.

    Attributes:
        errors: RMS contour error by contour [m]; none where every point of the search diverged.
        sound: whether the weights keep all limits.
        diverged: whether any run did, or every point of the search.
    """

    errors: dict[str, float]
    sound: bool
    diverged: bool


def measured(flags: Bench, tell: Callable[[str], None]) -> WholeWayBench:
    """Machines of two axes of one kind, from logs of arcs and lines to their contour errors."""
    ways = []
    for seed in range(flags.first_seed, flags.first_seed + flags.seeds):
        takes = KINDS[seed % len(KINDS)]
        random = np.random.default_rng([seed, 16])
        axes = [hidden_axis(random, DT, takes) for _ in range(2)]
        ways.append(_way(axes, seed, flags.evaluations))
        tell(_line(ways[-1]))
        jax.clear_caches()  # every machine has programs of its own: they would fill the memory
    return WholeWayBench(ways)


def show(console: Console, result: WholeWayBench) -> None:
    """One line for every machine."""
    rows = [
        [
            str(way.seed),
            way.takes,
            " ".join(map(str, way.delays)),
            *(f"{1e6 * mean:.3g}" for mean in way.means),
            f"{way.ratio:.3f}",
            f"{way.worst:.3f}",
            "yes" if way.sound else "no",
            "yes" if way.diverged else "no",
        ]
        for way in result.machines
    ]
    columns = ["machine", "takes", "delays", "identified\num", "true model\num", "ratio"]
    columns += ["worst contour", "limits kept", "diverged"]
    console.print(tables.plain_table("From the log to the contour", columns, rows, text_columns=2))
    ratios = np.array([way.ratio for way in result.machines])
    known = ratios[~np.isnan(ratios)]
    if known.size:
        line = f"ratio: median {np.median(known):.3f}, largest {np.max(known):.3f}"
        tables.say(console, line)
    if known.size < ratios.size:
        tables.say(console, f"no ratio: {ratios.size - known.size} of {ratios.size} machines")


def _line(way: Way) -> str:
    return (
        f"{way.seed} {way.takes}: {way.ratio:.3f} of the error with the true model, worst contour "
        f"{way.worst:.3f}{'' if way.sound else ', limits not kept'}"
        f"{', diverged' if way.diverged else ''}"
    )


def _way(axes: list[RecordedAxis], seed: int, evaluations: int) -> Way:
    found = identify_machine(hidden_record(axes, "contour", seed), MOST_POLES, MOST_DELAY)
    fields = machine_fields(found, "identified", "unit")
    truth = true_fields(axes, fields)
    identified, known = (_tuned_on(one, truth, evaluations) for one in (fields, truth))
    delays = tuple(round(one.axis.delay / DT) for one in axes)
    errors = {
        name: (identified.errors.get(name, np.inf), known.errors.get(name, np.nan))
        for name in known.errors or identified.errors
    }
    sound, lost = identified.sound and known.sound, identified.diverged or known.diverged
    return Way(seed, axes[0].takes, delays, errors, found.gain, found.late, sound, lost)


def true_fields(axes: Sequence[RecordedAxis], fields: dict[str, Any]) -> dict[str, Any]:
    """The machine file with the true model: its own states and delays."""
    models = [true_model(one) for one in axes]
    shared = min(one.delay for one in models)
    parts = [one.realisation(one.delay - shared) for one in models]
    A, B, C = (np.asarray(block_diag(*three)).tolist() for three in zip(*parts, strict=True))
    model = {"A": A, "B": B, "C": C, "known_delay": shared}
    return fields | model | {"encoder_resolution": min(one.count for one in axes)}


def _tuned_on(fields: dict[str, Any], truth: dict[str, Any], evaluations: int) -> OnTheMachine:
    """What is tuned on a file within some evaluations, run on the true machine."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "machine.json"
        path.write_text(json.dumps(fields))
        quiet = tables.console_of(quiet=True)
        try:
            run = tuning_run(Tune(plant=str(path)))
            run = replace(run, settings=replace(run.settings, evaluations=evaluations))
            found = searched(run, Path(place), lambda _: None, quiet)
        except NothingSound:
            return OnTheMachine({}, False, True)
    controller = found.run.controller(found.tuned.weights)
    machine = machine_from(json.dumps(truth).encode(), "true")
    plant = machine.true_family(found.run.design.fed)[0]
    errors, diverged = {}, False
    for job in found.run.scenarios.jobs:
        reference = job.reference(DT, controller.preview)
        metrics = score(simulate(plant, controller, reference), reference)
        errors[job.name] = float(metrics.rms_contour_error)
        diverged |= bool(metrics.diverged)
    return OnTheMachine(errors, found.tuned.feasible, diverged)
