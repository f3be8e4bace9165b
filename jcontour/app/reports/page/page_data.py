"""Content of a page about a run, from the files of its folder alone; long signals are thinned."""

import base64
import html
import json
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import load_variables
from jcontour.app.files.results.loop_results import AuditedResult, SimulatedResult
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.files.results.search_results import BudgetPoint, FrontResult
from jcontour.app.files.results.stored import from_json, read_result
from jcontour.app.files.results.tuned_result import HistoryPoint, TunedResult
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.machines import Audit
from jcontour.app.flags.tuning import Front, Tune
from jcontour.app.reports.causes import audit_answer
from jcontour.app.reports.rollouts import ROLLOUTS, SENSITIVITY
from jcontour.app.reports.run_tables import margin_rows, simulated_answer, tuned_answer
from jcontour.app.reports.screen import Entry, screen
from jcontour.app.reports.tables import weight_digits

Shown = TunedResult | SimulatedResult | FrontResult


class Kind(NamedTuple):
    """A command whose runs have a page."""

    result: type[Shown]
    flags: type[Any]
    answer: Callable[[Any], list[Entry]]  # entries of its screen


KINDS = {
    "tune": Kind(TunedResult, Tune, tuned_answer),
    "simulate": Kind(SimulatedResult, Simulate, simulated_answer),
    "audit": Kind(AuditedResult, Audit, audit_answer),
    "front": Kind(FrontResult, Front, lambda _: []),
}
BEST = "recommended: the least error within every limit"
BYTES = 3e6  # of the signals of a run on its page
MOST_CONTOURS = 12
FEWEST, MOST = 300, 3000  # samples of a contour: more do not fit on a screen


def kept_samples(signals: Float[np.ndarray, "S T"], most: int) -> Int[np.ndarray, " K"]:
    """Samples to keep, at most about `most`, the same ones of every signal.

    The run is cut into equal stretches. Of each stretch its first sample stays, and the one where
    each signal is largest, so that no peak is lost.

    >>> kept_samples(np.array([[0.0, 1.0, 9.0, 1.0, 0.0, 2.0, 1.0, 3.0]]), 4).tolist()
    [0, 2, 4, 7]

    Args:
        signals: sizes, at least zero; NaN counts as nothing.
        most: how many, at least two for each signal.
    """
    count, steps = signals.shape
    if steps <= most:
        return np.arange(steps)
    stretches = max(most // (count + 1), 1)
    edges = np.linspace(0, steps, stretches + 1).astype(int)
    sizes = np.where(np.isfinite(signals), signals, -1.0)
    kept = {0, steps - 1}
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        kept.add(int(first))
        kept.update((first + sizes[:, first:last].argmax(axis=1)).tolist())
    return np.array(sorted(kept))


def packed(values: Float[np.ndarray, "..."]) -> dict[str, str]:
    """Numbers for the page: base64 of little-endian float32, row by row."""
    return {"f32": base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()}


def page_data(folder: Path, room: float = BYTES) -> dict[str, Any]:
    """Everything that the page shows of one run.

    Args:
        folder: of the run.
        room: bytes that its signals may take.
    """
    result = stored_result(folder)
    settings = run_folder.read_json(folder, run_folder.SETTINGS)
    command = settings["command"]
    tuned = result if isinstance(result, TunedResult) else None
    verdict = result.verdict
    unit = result.machine.control_unit
    try:
        words = settings["command_line"]
        at = words.index("--out") if "--out" in words else len(words)
        tried, margins, drives = [], [], {}
        if tuned is not None:
            if (path := folder / "history.json").exists():
                tried = from_json(json.loads(path.read_text()), list[HistoryPoint])
            margins = [f"{name:<23}  {value}" for name, value in margin_rows(tuned.margins)]
        if tuned is not None and tuned.drive is not None:
            from jcontour.app.reports.drives import PRODUCTS, drive_gains

            drives = {one: drive_gains(tuned.drive.weights, unit, one) for one in PRODUCTS}
        return {
            "name": folder.name,
            "command": command,
            "repeat": shlex.join([*words[:at], *words[at + 2 :]]),  # in a new folder
            "settings": _changed(KINDS[command].flags, settings["flags"]),
            "versions": settings["versions"],
            "machine": result.machine.name,
            "control_unit": unit,
            "shown": {
                name: (f"{metric.words} [{metric.shown(unit)}]", metric.factor)
                for name, metric in METRICS.items()
                if metric.on_page
            },
            "controller": result.controller,
            "error": result.error,
            "verdict": verdict and {"usable": verdict.usable, "lines": verdict.lines},
            "answer": KINDS[command].answer(result),
            "alternatives": [] if tuned is None else _alternatives(tuned, tried),
            "lines": [] if tuned is None else [*tuned.weight_lines, *margins],
            "drives": drives,
            "sensitivity": _sensitivity(folder),
            "limit": None if tuned is None else tuned.limits.get("peak_sensitivity"),
            "points": _points(result, tried),
            **_signals(folder, room),
        }
    except (KeyError, AttributeError, TypeError, ValueError) as error:
        raise run_folder.RunError(
            f"{folder}: a run of another version of jcontour ({error} is missing or different)"
        ) from None


def _changed(kind: type[Any], flags: dict[str, Any]) -> dict[str, str]:
    """Flags that differ from their defaults, as words."""
    usual = run_folder.plain(kind())
    changed = {name: value for name, value in flags.items() if value != usual.get(name)}
    words = {True: "yes", False: "no"}
    return {
        name: " ".join(map(str, value)) if isinstance(value, list) else words.get(value, str(value))
        for name, value in changed.items()
    }


def stored_result(folder: Path) -> Shown:
    """Result of a run that has a page.

    Raises:
        RunError: not the folder of a finished run of `tune`, `simulate` or `front`, or one of
            another version.
    """
    command = run_folder.read_json(folder, run_folder.SETTINGS).get("command")
    if command not in KINDS:
        raise run_folder.RunError(
            f"{folder}: holds a run of {command!r}; pages are made of {', '.join(KINDS)}"
        )
    return read_result(folder, KINDS[command].result)


class StoredRun:
    """A run of `tune`, `simulate` or `front`, which a notebook shows as the terminal does.

    Args:
        folder: of the run.

    Attributes:
        result: as it is stored.

    Raises:
        RunError: as `stored_result`.
    """

    def __init__(self, folder: Path | str):
        self.result: Any = stored_result(Path(folder))  # of its command

    def _repr_html_(self) -> str:
        one = self.result
        answer = next(kind.answer for kind in KINDS.values() if kind.result is type(one))
        lines = screen(one.verdict, answer(one))
        return f"<pre>{html.escape(chr(10).join(lines))}</pre>"


def _alternatives(result: TunedResult, tried: Sequence[HistoryPoint]) -> list[dict[str, Any]]:
    """Start, tuned, calmer points of the search and nearest simple loop side by side.

    Only start and tuned weights, or a baseline, were run with all effects on every contour. The
    others have the tuned one's numbers times what the search found them to be of it.
    """
    times = [one.read.duration for one in result.contours if one.read and one.read.duration]
    cycle, rows = max(times, default=None), []
    compared = {one.compared for one in result.contours}
    margins = {
        "start": result.start_margins,
        "baseline": result.baseline_margins,
        "tuned": result.margins,
    }
    notes = {
        "start": "beyond a limit, or unstable" if "baseline" in compared else "",
        "baseline": "the best simple loop within every limit, with its first gains",
        "tuned": BEST if result.verdict.usable else "",
    }
    for name, of_loops in margins.items():
        runs = [one.metrics[name].worst for one in result.contours if name in one.metrics]
        if not runs or any(one.diverged for one in runs):
            continue
        rows.append(
            {
                "name": name,
                "error": 1e6 * max(one.rms(result.error) for one in runs),
                "margin": None if of_loops is None else of_loops.sensitivity,
                "effort": max(one.rms_increment for one in runs),
                "time": cycle,
                "note": notes[name],
            }
        )
    if not rows or rows[-1]["name"] != "tuned":
        return rows
    best = rows[-1]
    chosen = next((one for one in tried if one.weights == result.weights), None)
    calmer = {}  # the least objective with at most 1/2, and 1/4, of the chosen control increment
    for part in (2, 4):
        most = -1.0 if chosen is None else chosen.rms_increment / part
        within = [one for one in tried if one.feasible and one.rms_increment <= most]
        if within:
            calmer[part] = min(within, key=lambda one: one.objective)
    if calmer.get(2) is calmer.get(4):
        calmer.pop(2, None)
    for part, point in calmer.items():
        assert chosen is not None
        weights = " ".join(f"{name}={weight_digits(one)}" for name, one in point.weights.items())
        rows.append(
            {
                "name": f"calmer: 1/{part} of the control's change or less",
                "error": best["error"] * point.rms_error / chosen.rms_error,
                "margin": point.sensitivity,
                "effort": best["effort"] * point.rms_increment / chosen.rms_increment,
                "time": cycle,
                "note": f"about, within every limit; --weights {weights}",
            }
        )
    if (drive := result.drive) is not None and drive.controller != result.controller:
        error = best["error"] * drive.error / drive.tuned_error
        note = "about; gains of a drive" + ("" if drive.kept else ", beyond a limit")
        row = {"name": drive.controller, "error": error, "margin": drive.sensitivity}
        rows.append({**row, "time": cycle, "note": note})
    return rows


def _sensitivity(folder: Path) -> dict[str, Any] | None:
    path = folder / SENSITIVITY
    if not path.exists():
        return None
    data = load_variables(path)
    designs = zip(data["design"], data["sensitivity"], strict=True)
    return {
        "frequency": data["frequency"].tolist(),
        "designs": {str(design): packed(values) for design, values in designs},
    }


def _points(result: Shown, tried: Sequence[HistoryPoint]) -> dict[str, Any] | None:
    """Points of a front, or those that tuning tried: error against what it costs."""
    chosen, against = None, "increment"
    rows: list[tuple[float, float, str | None, BudgetPoint | HistoryPoint]]
    if isinstance(result, FrontResult):
        against = result.against
        rows = [
            (one.spent(result.against), one.error(result.error), f"{one.budget:.4g}", one)
            for one in result.points
        ]
    else:
        rows = [(one.rms_increment, one.rms_error, None, one) for one in tried]
        if isinstance(result, TunedResult) and result.verdict.usable:
            chosen = result.weights
    if not rows:
        return None
    return {
        "x": {
            "increment": f"RMS increment [{result.machine.control_unit} per sample]",
            "sensitivity": "Ms",
            "feed": "cycle time [s]",
        }[against],
        "points": [
            {
                "x": cost,
                "y": 1e6 * error,
                "feasible": one.feasible,
                "recommended": one.weights == chosen,
                "design": budget,
                "weights": {k: value for k, value in one.weights.items() if value is not None},
            }
            for cost, error, budget, one in rows
            if np.isfinite([cost, error]).all()
        ],
    }


def _signals(folder: Path, room: float) -> dict[str, Any]:
    """Designs, plants and contours with their signals; none where no rollouts were kept."""
    path = folder / ROLLOUTS
    if not path.exists():
        return {"designs": [], "plants": [], "axes": [], "inputs": 0, "contours": []}
    data = load_variables(path)
    words = {
        name: [str(one) for one in data[name]]
        for name in ("design", "contour", "plant", "axis", "input")
    }
    names = words["contour"][:MOST_CONTOURS]
    signals = 2 * len(words["axis"]) + len(words["input"]) + 1
    each = len(words["design"]) * len(words["plant"]) * signals
    most = int(room / len(names) / (each * 4 * 4 / 3))
    most = min(max(most, FEWEST), MOST)
    return {
        "designs": words["design"],
        "plants": words["plant"],
        "axes": words["axis"],
        "inputs": len(words["input"]),
        "contours": [_contour(data, k, name, most) for k, name in enumerate(names)],
    }


def _contour(data: dict[str, np.ndarray], number: int, name: str, most: int) -> dict[str, Any]:
    """One contour, thinned alike in every run; lengths in mm, errors in um."""
    # Samples up to the last that counts or moves; runs are padded to the longest
    reference, scored = data["reference"][number], data["scored"][number]
    moves = np.any(np.diff(reference, axis=0) != 0, axis=1)
    ends = np.flatnonzero(np.insert(moves, 0, False) | (scored == 1))
    length = int(ends[-1]) + 1 if ends.size else len(scored)
    time, reference = data["time"][:length], reference[:length]
    output, error, control = (
        data[key][:, number, :, :length] for key in ("output", "contour_error", "control")
    )
    period = float(time[1] - time[0]) if length > 1 else 1.0
    feed = np.zeros(output.shape[:-1])
    feed[..., 1:] = np.linalg.norm(np.diff(output, axis=2), axis=-1) / period
    steps = np.linalg.norm(np.diff(reference, axis=0, prepend=reference[:1]), axis=1)
    sizes = [np.linalg.norm(error, axis=-1), np.linalg.norm(control, axis=-1)]
    loudest = np.array([np.nan_to_num(size, nan=0.0).max(axis=(0, 1)) for size in sizes])
    kept = kept_samples(loudest, most)
    return {
        "name": name,
        "training": bool(data["training"][number]),
        "samples": length,
        "kept": len(kept),
        "time": packed(time[kept]),
        "arc": packed(1e3 * np.cumsum(steps)[kept]),
        "reference": packed(1e3 * reference[kept]),
        "output": packed(1e3 * output[:, :, kept]),
        "error": packed(1e6 * error[:, :, kept]),
        "control": packed(control[:, :, kept]),
        "feed": packed(60e3 * feed[:, :, kept]),
        "metrics": {
            name: data[name][:, number].tolist()
            for name in METRICS
            if METRICS[name].on_page and name in data  # a run may be older than a metric
        },
        "diverged": data["diverged"][:, number].astype(bool).tolist(),
    }


FILE = "report.html"
MOST_BYTES = 5_000_000
HERE = Path(__file__).parent


def write_page(folders: Sequence[Path], path: Path) -> Path:
    """Write one page of these runs, in a folder that is made where there is none.

    Raises:
        RunError: as `page_data`; or the page would be larger than it may be.
    """
    runs = [page_data(folder, BYTES / len(folders)) for folder in folders]
    # The page; text of the user is escaped in the title, and never markup in the data
    title = "jcontour: " + ", ".join(run["name"] for run in runs)
    data = json.dumps(run_folder.plain(list(runs)), separators=(",", ":"), allow_nan=False)
    parts = {
        "TITLE": html.escape(title),
        "STYLE": (HERE / "page.css").read_text(),
        "DATA": data.replace("<", "\\u003c").replace("\u2028", " ").replace("\u2029", " "),
        "PLOTS": (HERE / "plots.js").read_text(),
        "PROGRAM": (HERE / "page.js").read_text(),
    }
    place = re.compile(f"@({'|'.join(parts)})@")
    text = place.sub(lambda match: parts[match[1]], (HERE / "page.html").read_text())
    if len(text.encode()) > MOST_BYTES:
        raise run_folder.RunError(
            f"{path}: the page would take {len(text.encode())} bytes; give fewer runs"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    return run_folder.write(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
