"""Content of a page about a run, from the files of its folder alone; long signals are thinned."""

import base64
import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import load_dataset
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.files.results.stored import from_json
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports.rollouts import ROLLOUTS as ROLLOUTS
from jcontour.app.reports.rollouts import ROLLOUTS as SENSITIVITY

COMMANDS = ("tune", "simulate", "front")
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

    Raises:
        RunError: not the folder of a finished run of `tune`, `simulate` or `front`, or one of
            another version.
    """
    settings = run_folder.read_json(folder, run_folder.SETTINGS)
    command = settings.get("command")
    if command not in COMMANDS:
        raise run_folder.RunError(
            f"{folder}: holds a run of {command!r}; pages are made of {', '.join(COMMANDS)}"
        )
    result = run_folder.read_json(folder, run_folder.RESULT)
    try:
        return {
            "name": folder.name,
            "command": command,
            "repeat": shlex.join(settings["command_line"]),
            "settings": {name: _word(value) for name, value in settings["flags"].items()},
            "versions": settings["versions"],
            "machine": result["machine"].get("name", ""),
            "control_unit": result["machine"]["control_unit"],
            "shown": _shown(result["machine"]["control_unit"]),
            "controller": result["controller"],
            "error": result["error"],
            "verdict": None if command == "front" else _verdict(result["verdict"]),
            "lines": _lines(result),
            "sensitivity": _sensitivity(folder),
            "limit": result.get("limits", {}).get("peak_sensitivity"),
            "points": _points(folder, command, result),
            **_signals(folder, room),
        }
    except (KeyError, AttributeError, TypeError) as error:
        raise run_folder.RunError(
            f"{folder}: a run of another version of jcontour ({error} is missing or different)"
        ) from None


def _word(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _verdict(stored: dict[str, Any]) -> dict[str, Any]:
    """Lines that the terminal prints, and whether they are against the values."""
    verdict = from_json(stored, Verdict)
    return {"usable": verdict.usable, "lines": verdict.lines}


def _lines(result: dict[str, Any]) -> list[str]:
    """Tuned weights and margins in words."""
    lines = list(result.get("values", []))
    margins = result.get("safety")
    if margins:
        low_high = "; ".join(f"{low:.3g} to {high:.3g}" for low, high in margins["gain_range"])
        lines.append(f"gain margin    factors {low_high}")
        lines.append(f"delay margin   {margins['delay_samples']} samples")
        if margins.get("sensitivity") is not None:
            lines.append(f"Ms             {margins['sensitivity']:.3g} in the family")
    return lines


def _sensitivity(folder: Path) -> dict[str, Any] | None:
    path = folder / SENSITIVITY
    if not path.exists():
        return None
    data = load_dataset(path)
    return {
        "frequency": data.frequency.values.tolist(),
        "designs": {
            str(design): packed(data.sensitivity.sel(design=design).values)
            for design in data.design.values
        },
    }


def _points(folder: Path, command: str, result: dict[str, Any]) -> dict[str, Any] | None:
    """Points of a front, or those that tuning tried: error against what it costs."""
    error = f"rms_{result['error']}_error"
    if command == "front":
        names, against = result["weights"], result.get("against", "increment")
        spent = "rms_increment" if against == "increment" else "peak_sensitivity"
        rows = result["points"]
    elif command == "tune" and (folder / "history.json").exists():
        rows = json.loads((folder / "history.json").read_text())
        names, spent, against = list(result["weights"]), "rms_increment", "increment"
    else:
        return None
    kept = [row for row in rows if row.get(error) is not None and row.get(spent) is not None]
    unit = result["machine"]["control_unit"]
    return {
        "x": f"RMS increment [{unit} per sample]" if against == "increment" else "Ms",
        "points": [
            {
                "x": row[spent],
                "y": 1e6 * row[error],
                "feasible": bool(row.get("feasible", (row.get("violation") or 0) <= 1e-6)),
                "design": f"{row['budget']:.4g}" if command == "front" else None,
                "weights": {name: row.get(name) for name in names if row.get(name) is not None},
            }
            for row in kept
        ],
    }


def _shown(control_unit: str) -> dict[str, tuple[str, float]]:
    """Heading of every metric of the page, and its factor from SI."""
    return {
        name: (f"{metric.words} [{metric.shown(control_unit)}]", metric.factor)
        for name, metric in METRICS.items()
        if metric.on_page
    }


def _signals(folder: Path, room: float) -> dict[str, Any]:
    """Designs, plants and contours with their signals; none where no rollouts were kept."""
    path = folder / ROLLOUTS
    if not path.exists():
        return {"designs": [], "plants": [], "axes": [], "inputs": 0, "contours": []}
    data = load_dataset(path)
    names = [str(name) for name in data.contour.values][:MOST_CONTOURS]
    designs, plants, axes = data.sizes["design"], data.sizes["plant"], data.sizes["axis"]
    each = designs * plants * (2 * axes + data.sizes["input"] + 1)
    most = int(room / len(names) / (each * 4 * 4 / 3))
    most = min(max(most, FEWEST), MOST)
    return {
        "designs": [str(name) for name in data.design.values],
        "plants": [str(name) for name in data.plant.values],
        "axes": [str(name) for name in data.axis.values],
        "inputs": data.sizes["input"],
        "contours": [_contour(data.sel(contour=name), name, most) for name in names],
    }


def _contour(data: xr.Dataset, name: str, most: int) -> dict[str, Any]:
    """One contour, thinned alike in every run; lengths in mm, errors in um."""
    length = _length(data)
    data = data.isel(time=slice(0, length))
    time, reference = data.time.values, data.reference.values
    output, error, control = (data[key].values for key in ("output", "contour_error", "control"))
    period = float(time[1] - time[0]) if length > 1 else 1.0
    feed = np.zeros(output.shape[:-1])
    feed[..., 1:] = np.linalg.norm(np.diff(output, axis=2), axis=-1) / period
    steps = np.linalg.norm(np.diff(reference, axis=0, prepend=reference[:1]), axis=1)
    sizes = [np.linalg.norm(error, axis=-1), np.linalg.norm(control, axis=-1)]
    loudest = np.array([np.nan_to_num(size, nan=0.0).max(axis=(0, 1)) for size in sizes])
    kept = kept_samples(loudest, most)
    return {
        "name": name,
        "training": bool(data.training.values),
        "samples": length,
        "kept": len(kept),
        "time": packed(time[kept]),
        "arc": packed(1e3 * np.cumsum(steps)[kept]),
        "reference": packed(1e3 * reference[kept]),
        "output": packed(1e3 * output[:, :, kept]),
        "error": packed(1e6 * error[:, :, kept]),
        "control": packed(control[:, :, kept]),
        "feed": packed(60e3 * feed[:, :, kept]),
        "metrics": {name: data[name].values.tolist() for name in METRICS if METRICS[name].on_page},
        "diverged": data.diverged.values.astype(bool).tolist(),
    }


def _length(data: xr.Dataset) -> int:
    """Samples up to the last that counts or moves; runs are padded to the longest."""
    moves = np.any(np.diff(data.reference.values, axis=0) != 0, axis=1)
    ends = np.flatnonzero(np.insert(moves, 0, False) | (data.scored.values == 1))
    return int(ends[-1]) + 1 if ends.size else data.sizes["time"]
