"""`jcontour bench identify`: what `identify` finds of axes that it cannot see."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from statistics import fmean, median

import numpy as np
from jaxtyping import Complex, Float

from experiments.benchmarks.records.hidden_machines import (
    DT,
    PROGRAMS,
    SECONDS,
    hidden_axis,
    hidden_record,
    late_by_a_part,
    true_model,
)
from experiments.benchmarks.stored_results import kept
from experiments.tables import Column, Table
from jcontour.app.flags.others import Bench
from jcontour.linear.continuous_axes import sampled_axis
from tuning.identification.linear import evidence
from tuning.identification.linear.found import LinearAxis, MachineRecord
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.noise_model import whitening
from tuning.identification.linear.output_error import (
    NOISE_TERMS,
    TRAINING,
    AxisRecord,
    predicted,
    simulated,
)
from tuning.identification.linear.recording import FEEDBACK, RecordedAxis

MOST_POLES, MOST_DELAY = 3, 10
FREQUENCIES = 24
HIGHEST = 0.3  # of the sampling rate


@dataclass(frozen=True)
class HiddenResult:
    """What was found of one axis.

    Attributes:
        program: that it ran: arcs and lines, or the one of `--excite`.
        seed, takes: which axis.
        states: of the axis, resonance included.
        delay, found: true and identified [samples]; found is the whole samples of it.
        told: whether the record is said not to tell the two apart.
        bandwidth: of its closed loop [Hz].
        error: largest relative error of the response up to there.
        inside: part of the frequencies up to there whose 95 % region holds the truth.
        holds: part of those up to 0.3 of the sampling rate whose stated interval holds it.
        held_out: one-step prediction error on held-out data, over that of the true model.
        seconds: that its record took, with both axes.
    """

    program: str
    seed: int
    takes: str
    states: int
    delay: float
    found: int
    told: bool
    bandwidth: float
    error: float
    inside: float
    holds: float
    held_out: float
    seconds: float

    @property
    def exact(self) -> bool:
        """Whether the whole samples of the delay were found."""
        return self.found == int(self.delay)


@dataclass(frozen=True)
class IdentifyBench:
    """One row for every axis and program, from records of one length [s]."""

    axes: list[HiddenResult]
    length: float


def measured(flags: Bench, tell: Callable[[str], None]) -> IdentifyBench:
    """Random machines of two axes each, under both programs.

    Raises:
        ValueError: the file to keep them is none of this benchmark.
    """
    machines = range(flags.first_seed, flags.first_seed + flags.seeds)

    def run(program: str, machine: int) -> list[HiddenResult]:
        rows = _identified(program, machine)
        for one in rows:
            tell(_line(one))
        return rows

    keys = product(PROGRAMS, machines)
    return IdentifyBench(kept(flags.keep, HiddenResult, keys, run), SECONDS)


def _identified(program: str, machine: int) -> list[HiddenResult]:
    """Both axes of a machine; those of every other are late by a part of a sample."""
    seeds = [2 * machine, 2 * machine + 1]
    axes = [hidden_axis(np.random.default_rng(seed), DT) for seed in seeds]
    if machine % 2:
        axes = [
            late_by_a_part(axis, DT, np.random.default_rng([seed, 1]))
            for axis, seed in zip(axes, seeds, strict=True)
        ]
    record = hidden_record(axes, program, machine)
    began = time.perf_counter()
    found = identify_machine(record, MOST_POLES, MOST_DELAY)
    seconds = time.perf_counter() - began
    return [
        _compared(axes[k], found.axes[k], record, k, program, seed, seconds)
        for k, seed in enumerate(seeds)
    ]


def tables(result: IdentifyBench) -> Iterator[Table | str]:
    """One line for every program and kind of drive."""
    groups: dict[tuple[str, str], list[HiddenResult]] = {}
    for program, parted, resonant in product(PROGRAMS, (False, True), (False, True)):
        name = "with resonance" if resonant else "without"
        key = program, name + (", parted delay" if parted else "")
        for one in result.axes:
            if (one.program, one.delay % 1 > 0, one.states > 2) == (program, parted, resonant):
                groups.setdefault(key, []).append(one)
    columns: dict[str, Column] = {
        "program": lambda key: key[0],
        "axes": lambda key: key[1],
        "number": lambda key: str(len(groups[key])),
        "delay\nexact": lambda key: str(sum(one.exact for one in groups[key])),
        "or\ntold": lambda key: str(sum(one.exact or one.told for one in groups[key])),
        "worst\nerror %": lambda key: f"{100 * max(one.error for one in groups[key]):.2g}",
        "median\nerror %": lambda key: f"{100 * median(one.error for one in groups[key]):.2g}",
        "95 % region\nholds %": lambda key: f"{100 * fmean(x.inside for x in groups[key]):.3g}",
        "intervals\nhold %": lambda key: f"{100 * fmean(x.holds for x in groups[key]):.3g}",
        "held out,\nworst ratio": lambda key: f"{max(one.held_out for one in groups[key]):.4g}",
    }
    yield Table("Hidden axes", list(groups), columns, words=2)
    seconds = [one.seconds for one in result.axes]
    yield (
        "error and region: of the frequency response up to the bandwidth of the closed loop; "
        "intervals: as stated, up to 0.3 of the sampling rate\n"
        "parted delay: not of whole samples; exact are then its whole samples\n"
        f"{median(seconds):.3g} s for {result.length:g} s of 1 kHz data of two axes, "
        f"longest {max(seconds):.3g} s"
    )


def _line(one: HiddenResult) -> str:
    return (
        f"{one.program} {one.seed} {one.takes} {one.states} states: delay {one.found} "
        f"({one.delay:.3g}{', told' if one.told else ''}), {100 * one.error:.2g} % up to "
        f"{one.bandwidth:.3g} Hz, inside {one.inside:.2f}, holds {one.holds:.2f}, "
        f"held out {one.held_out:.4f}"
    )


def _compared(
    axis: RecordedAxis,
    found: LinearAxis,
    record: MachineRecord,
    k: int,
    program: str,
    seed: int,
    seconds: float,
) -> HiddenResult:
    highest = bandwidth(axis)
    hertz = np.geomspace(0.3, highest, FREQUENCIES)
    truth, model = response(axis, hertz), found.fit.model
    value, slopes = model.log_terms(2 * np.pi * hertz)
    off = value - np.log(truth)
    off = np.real(off) + 1j * np.angle(np.exp(1j * np.imag(off)))
    size = slopes.shape[1]
    region = evidence.inside_region(off, slopes, found.estimate.covariance[:size, :size])
    late = round(axis.axis.delay / DT, 6)
    return HiddenResult(
        program=program,
        seed=seed,
        takes=axis.takes,
        states=len(axis.axis.A),
        delay=late,
        found=model.delay,
        told=bool(found.late),
        bandwidth=highest,
        error=float(np.abs(np.exp(off) - 1).max()),
        inside=float(np.mean(region)),
        holds=_holds(axis, found.response),
        held_out=_held_out_ratio(axis, found, record, k),
        seconds=seconds,
    )


def _holds(axis: RecordedAxis, stated: evidence.Response) -> float:
    """Part of the frequencies whose stated interval holds the truth."""
    low = stated.frequency < HIGHEST / DT
    off = np.abs(stated.value[low] / response(axis, stated.frequency[low]) - 1)
    return float(np.mean(off <= stated.half_width[low]))


def _held_out_ratio(axis: RecordedAxis, found: LinearAxis, record: MachineRecord, k: int) -> float:
    """RMS one step ahead on held-out data, over that of the true model and its noise filter."""
    whole = AxisRecord(record.dt, record.command[:, k], record.position[:, k])
    cut = int(TRAINING * len(whole.position))
    training, rest = whole.part(0, cut), whole.part(cut, len(whole.position))
    fit = simulated(training, true_model(axis))
    truth = predicted(rest, fit, whitening(fit.residual, NOISE_TERMS))
    own = predicted(rest, found.fit, found.fit.filter)
    return float(np.sqrt(np.mean(own**2) / np.mean(truth**2)))


def response(axis: RecordedAxis, hertz: Float[np.ndarray, " F"]) -> Complex[np.ndarray, " F"]:
    """Transfer from the command to the position, sampled."""
    A, B, C, late = sampled_axis(axis.axis, DT)
    z = np.exp(2j * np.pi * hertz * DT)
    return np.array(
        [(C @ np.linalg.solve(one * np.eye(len(A)) - A, B)).item() * one**-late for one in z]
    )


def bandwidth(axis: RecordedAxis) -> float:
    """Frequency at which the loop's answer to its reference has fallen by 3 dB [Hz]."""
    hertz = np.geomspace(0.3, 200.0, 800)
    G, z = response(axis, hertz), np.exp(2j * np.pi * hertz * DT)
    if axis.takes == "speed":
        loop = axis.loop[0] * G
        closed = loop / (1 + loop)
    elif axis.takes == "position":
        closed = (axis.loop[0] + FEEDBACK) * G / (1 + FEEDBACK * G)
    else:
        outer, inner = axis.loop
        closed = inner * outer * G / (1 + inner * G * (outer + (1 - 1 / z) / DT))
    low = np.flatnonzero(np.abs(closed) < np.sqrt(0.5))
    return float(hertz[low[0]]) if low.size else float(hertz[-1])
