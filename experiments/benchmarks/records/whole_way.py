"""`jcontour bench whole_way`: log of a hidden machine, identify, tune, and back on that machine.

The log is of arcs and lines. Where `identify` says that it does not show a response, the machine
runs what `--excite` writes, as the tool advises.

Beside it the same with the true model in the machine file, its limits and its family unchanged:
what is lost is lost by identifying.
"""

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from experiments.benchmarks.kept_rows import kept
from experiments.benchmarks.records.hidden_machines import (
    DT,
    KINDS,
    PROGRAMS,
    hidden_axis,
    hidden_record,
    true_model,
)
from experiments.benchmarks.records.identify import MOST_DELAY, MOST_POLES
from experiments.tables import Column, Table
from jcontour.app.files.checks import MachineError
from jcontour.app.flags.others import Bench
from jcontour.app.flags.tuning import Tune
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.identified import largest, machine_fields
from jcontour.app.reports.tables import console_of
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.app.runs.tuning.searching import NothingSound, searched
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import score
from tuning.identification.linear.found import LinearMachineFound
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.recording import RecordedAxis

WORDS = {
    "ratio": "ratio",
    "counted": "ratio from a count on",
    "family": "ratio of the family's largest errors",
}


@dataclass(frozen=True)
class Way:
    """One hidden machine.

    Errors are means over the contours of the RMS contour error of both designs, NaN where a run or
    a whole search diverged, inf where only the search on the identified model did. A ratio is that
    of tuning on the identified model over that of tuning on the true one.

    Attributes:
        seed, takes: which one.
        record: that it was identified from: arcs and lines, or what the tool advises.
        delays: true ones of its axes [samples].
        identified, true: errors on the hidden machine [m].
        ratio: of these errors.
        worst: largest of the ratios of single contours.
        counted: ratio where no error counts for less than an encoder count.
        family: ratio of the largest errors over the hidden machine's own gains and delays.
        sound: whether both searches found weights that keep all limits.
        lost: why there is no result, of which of the two designs; empty where there is one.
    """

    seed: int
    takes: str
    record: str
    delays: str
    identified: float
    true: float
    ratio: float
    worst: float
    counted: float
    family: float
    sound: bool
    lost: str


@dataclass(frozen=True)
class WholeWayBench:
    """One row for every machine."""

    machines: list[Way]


@dataclass(frozen=True)
class OnTheMachine:
    """A tuned design on the true machine.

    Attributes:
        errors: RMS contour error by contour [m]; none without a design.
        largest: the same over all members of the true machine's family [m].
        sound: whether the weights keep all limits.
        lost: contours on which a member diverged, why the search found nothing, or why the file
            was refused; empty where all went well.
    """

    errors: dict[str, float]
    largest: dict[str, float]
    sound: bool
    lost: str


def measured(flags: Bench, tell: Callable[[str], None]) -> WholeWayBench:
    """Machines of two axes of one kind, from their logs to their contour errors.

    Raises:
        ValueError: the file to keep them is none of this benchmark.
    """
    seeds = range(flags.first_seed, flags.first_seed + flags.seeds)

    def run(seed: int) -> list[Way]:
        takes = KINDS[seed % len(KINDS)]
        random = np.random.default_rng([seed, 16])
        axes = [hidden_axis(random, DT, takes) for _ in range(2)]
        way = _way(axes, seed, flags.evaluations)
        tell(_line(way))
        jax.clear_caches()  # every machine has programs of its own: they would fill the memory
        return [way]

    return WholeWayBench(kept(flags.keep, Way, seeds, run))


def tables(result: WholeWayBench) -> Iterator[Table | str]:
    """One line for every machine."""
    columns: dict[str, Column] = {
        "no": "seed",
        "takes": "takes",
        "record": "record",
        "delays": "delays",
        "identified\num": lambda way: f"{1e6 * way.identified:.3g}",
        "true\num": lambda way: f"{1e6 * way.true:.3g}",
        "ratio": "ratio:.3f",
        "worst\ncontour": "worst:.3f",
        "from a\ncount on": "counted:.3f",
        "family": "family:.3f",
        "limits\nkept": lambda way: "yes" if way.sound else "no",
    }
    yield Table("From the log to the contour", result.machines, columns, words=3)
    for name, words in WORDS.items():
        ratios = np.array([getattr(way, name) for way in result.machines])
        known = ratios[~np.isnan(ratios)]
        if known.size:
            yield f"{words}: median {np.median(known):.3f}, largest {np.max(known):.3f}"
    missing = sum(bool(np.isnan(way.ratio)) for way in result.machines)
    if missing:
        yield f"no ratio: {missing} of {len(result.machines)} machines"
    for way in result.machines:
        if way.lost:
            yield f"machine {way.seed}: {way.lost}"


def _line(way: Way) -> str:
    return (
        f"{way.seed} {way.takes}, {way.record}: {way.ratio:.3f} of the error with the true model, "
        f"worst contour {way.worst:.3f}, from a count on {way.counted:.3f}, family {way.family:.3f}"
        f"{'' if way.sound else ', limits not kept'}"
        f"{f', {way.lost}' if way.lost else ''}"
    )


def _way(axes: list[RecordedAxis], seed: int, evaluations: int) -> Way:
    program, fields = _as_advised(axes, seed)
    truth = true_fields(axes, fields)
    identified, known = (_tuned_on(one, truth, evaluations) for one in (fields, truth))
    errors = _both(identified.errors, known.errors)
    count = min(one.count for one in axes)
    return Way(
        seed=seed,
        takes=axes[0].takes,
        record=program,
        delays=" ".join(str(round(one.axis.delay / DT)) for one in axes),
        identified=float(errors[0].mean()),
        true=float(errors[1].mean()),
        ratio=_ratio(errors),
        worst=float(np.max([_over(*pair) for pair in errors.T])),
        counted=_ratio(np.maximum(errors, count)),
        family=_ratio(_both(identified.largest, known.largest)),
        sound=identified.sound and known.sound,
        lost="; ".join(
            f"{model} model: {one.lost}"
            for model, one in (("identified", identified), ("true", known))
            if one.lost
        ),
    )


def _as_advised(axes: list[RecordedAxis], seed: int) -> tuple[str, dict[str, Any]]:
    """Program of the record that a user would keep, and the machine file from it.

    Where the record of arcs and lines leaves a response unseen and `identify` says so, the machine
    runs the program of `--excite`. Of the two the record is kept that shows more modes, else the
    one that shows more of the frequencies. Limits are what went well in either.
    """
    found = {PROGRAMS[0]: _identified(axes, PROGRAMS[0], seed)}
    if found[PROGRAMS[0]].unseen:
        found[PROGRAMS[1]] = _identified(axes, PROGRAMS[1], seed)
    program = max(found, key=lambda one: (found[one].order, np.nan_to_num(found[one].shown_to)))
    fields = machine_fields(found[program], "identified", "unit")
    limits = [largest(one) for one in found.values()]
    both = {name: np.max([one[name] for one in limits], axis=0).tolist() for name in limits[0]}
    return program, fields | {"limits": both}


def _identified(axes: list[RecordedAxis], program: str, seed: int) -> LinearMachineFound:
    return identify_machine(hidden_record(axes, program, seed), MOST_POLES, MOST_DELAY)


def _both(identified: dict[str, float], known: dict[str, float]) -> Float[np.ndarray, "2 c"]:
    """Errors of both designs; where a search has none inf of the identified, NaN of the true."""
    names = list(known or identified)
    if not names:
        return np.full((2, 1), np.nan)
    one = [identified.get(name, np.inf) for name in names]
    return np.array([one, [known.get(name, np.nan) for name in names]])


def _ratio(errors: Float[np.ndarray, "2 c"]) -> float:
    """Ratio of the mean errors over the contours."""
    return _over(*errors.mean(axis=1))


def _over(identified: float, true: float) -> float:
    """Ratio of two errors; NaN where tuning on the true machine has none."""
    return float(identified / true) if np.isfinite(true) else np.nan


def true_fields(axes: Sequence[RecordedAxis], fields: dict[str, Any]) -> dict[str, Any]:
    """The machine file with the true model: its own states and delays, nothing doubted of them."""
    models = [true_model(one) for one in axes]
    shared = min(one.delay for one in models)
    parts = [one.realisation(one.delay - shared) for one in models]
    A, B, C = (np.asarray(block_diag(*three)).tolist() for three in zip(*parts, strict=True))
    model = {"A": A, "B": B, "C": C, "known_delay": shared}
    model["uncertainty"] = {name: fields["uncertainty"][name] for name in ("gain", "delay")}
    encoders = {
        "encoder_resolution": [one.count for one in axes],
        "encoder_noise": [one.noise for one in axes],
    }
    return fields | model | encoders


def _tuned_on(fields: dict[str, Any], truth: dict[str, Any], evaluations: int) -> OnTheMachine:
    """What is tuned on a file within some evaluations, run on the true machine."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "machine.json"
        path.write_text(json.dumps(fields))
        quiet = console_of(quiet=True)
        try:
            run = tuning_run(Tune(plant=str(path)))
            run = replace(run, settings=replace(run.settings, evaluations=evaluations))
            found = searched(run, Path(place), lambda _: None, quiet)
        except NothingSound as error:
            return OnTheMachine({}, {}, False, f"tune found nothing ({error})")
        except MachineError as error:
            fault = str(error).removeprefix(f"{path}: ")
            return OnTheMachine({}, {}, False, f"tune refused the file ({fault})")
    controller = found.run.controller(found.tuned.weights)
    machine = machine_from(json.dumps(truth).encode(), "true")
    family = machine.true_family(found.run.design.fed)
    errors, largest, diverged = {}, {}, []
    for job in found.run.scenarios.jobs:
        reference = job.reference(DT, controller.preview)
        runs = [score(simulate(plant, controller, reference), reference) for plant in family]
        values = [float(one.rms_contour_error) for one in runs]
        errors[job.name], largest[job.name] = values[0], float(np.max(values))
        if any(bool(one.diverged) for one in runs):
            diverged.append(job.name)
    lost = f"diverged on {', '.join(diverged)}" if diverged else ""
    return OnTheMachine(errors, largest, found.tuned.feasible, lost)
