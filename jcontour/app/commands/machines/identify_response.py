"""`jcontour identify --response FILE`: a PI control with filters for a measured response."""

import numpy as np
from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.response_file import read_response
from jcontour.app.files.results.machine_results import ResponseResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.machines import Identify
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import save_figure
from jcontour.app.reports.figures.identification import response_figure
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.lifecycle import finished
from tuning.response_loop import CALM, crossover, quickest, sensitivity, tuned

MOST = 1.5  # Ms of a loop inside others
LEAST = 20  # lines that are coherent enough


def command(flags: Identify) -> int:
    """Read, tune, store and print; exit code."""
    assert flags.response is not None
    measured = read_response(flags.response)
    lines = measured.calm
    if len(lines.frequency) < LEAST:
        raise ValueError(
            f"{flags.response}: {len(lines.frequency)} of {len(measured.frequency)} lines have a "
            f"coherence of {CALM:g}: excite more, or average over more periods"
        )
    wanted = flags.crossover_hz
    loop = quickest(lines, MOST) if wanted is None else tuned(lines, wanted)
    L = loop.response(lines.frequency) * lines.value
    at, S = crossover(lines.frequency, L), sensitivity(L)
    phase = np.interp(at, lines.frequency, np.unwrap(np.angle(-L)))
    result = ResponseResult(
        data=str(flags.response),
        lines=len(lines.frequency),
        measured=len(measured.frequency),
        lowest=float(lines.frequency[0]),
        highest=float(lines.frequency[-1]),
        loop=loop,
        crossover=at,
        phase_margin=float(np.degrees((phase + np.pi) % (2 * np.pi) - np.pi)),
        sensitivity=float(S.max()),
        sensitive_at=float(lines.frequency[np.argmax(S)]),
        deviated=float(sensitivity(L, lines.deviation).max()),
    )
    folder = run_folder.create(flags.out, "identify", flags, [flags.response])
    save_figure(response_figure(lines, {"PI with filters": loop}), folder / "response.png")
    write_result(folder, result)
    return finished(folder, result, flags, show, answer_of(result))


def answer_of(result: ResponseResult) -> list[Entry]:
    """Entries of the screen: the parameters as a drive has them, and the margins."""
    loop = result.loop
    notch = f"{loop.notch:.5g} Hz, damping {loop.depth:.3g} over {loop.width:.3g}"
    worst = f"Ms {result.sensitivity:.4g} at {result.sensitive_at:.4g} Hz"
    return [
        Entry("Control", f"PI: K_p {loop.gain:.5g}, T_n {1e3 * loop.reset_time:.4g} ms"),
        Entry("Filters", f"low-pass {loop.lowpass:.5g} Hz (damping 0.7071), notch {notch}"),
        Entry("Loop", f"crossover {result.crossover:.4g} Hz, phase {result.phase_margin:.3g} deg"),
        Entry("Margin", f"{worst}; {result.deviated:.4g} within one deviation of the lines"),
        Entry("Lines", f"{result.lines} of {result.measured} are coherent enough to judge by"),
        Entry(
            "To load",
            "these numbers into the drive; no machine file, since lines state neither the length "
            "and period of its model nor limits. For tune record a log: jcontour identify LOG",
        ),
    ]


def show(result: ResponseResult, console: Console) -> None:
    """Print what was read; the screen has every parameter."""
    span = f"{result.lowest:.4g} to {result.highest:.4g} Hz"
    tables.say(console, f"Data: {result.data}, {result.lines} of {result.measured} lines, {span}")
