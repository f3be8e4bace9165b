"""Figures of an identification: what every fit leaves unexplained, and the friction and cogging that it found."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.files.run_folder import write
from experiments.reports.png import DOTS
from tuning.identification.axis import IdentifiedAxis

POINT = {"marker": ".", "linestyle": "none", "markersize": 2.0, "alpha": 0.5}
HARMONICS_SHOWN = 10


def save_figures(
    figures: dict[str, Callable[[IdentifiedAxis], Figure]], found: IdentifiedAxis, folder: Path
) -> list[Path]:
    """Draw every figure; the names are those of the files."""
    return [_saved(folder / f"{name}.png", draw(found)) for name, draw in figures.items()]


def residuals(found: IdentifiedAxis) -> Figure:
    """Of the current, of the end effector, and of the force over position, speed and time: noise shows no shape."""
    figure = Figure(figsize=(9.0, 7.5), layout="constrained")
    (current, tool), (position, speed) = figure.subplots(2, 2)
    if found.winding is not None:
        current.plot(np.concatenate(found.winding.residuals), linewidth=0.4)
    _label(current, "winding: simulated - recorded i_q", "row of the electrical tests", "A")
    if found.link is not None:
        tool.plot(1e6 * np.concatenate(found.link.residuals), linewidth=0.4)
    _label(tool, "link: simulated - recorded end effector", "row of the motion tests", "um")
    for slide, left in zip(found.forces.slides, found.forces.residuals, strict=True):
        colour = "tab:blue" if slide.direction > 0 else "tab:orange"
        position.plot(slide.position @ slide.weights, left, color=colour, **POINT)
        speed.plot(slide.speed @ slide.weights, left, color=colour, **POINT)
    _label(position, "balance of forces, one way blue, the other orange", "motor position [m]", "N")
    _label(speed, "balance of forces", "speed [m/s]", "N")
    return figure


def model(found: IdentifiedAxis) -> Figure:
    """Friction over speed and cogging over position, each with what the other terms leave of the data; the spectrum of cogging."""
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    friction, cogging, lines = figure.subplots(3, 1)
    value = dict(zip(found.estimate.names, found.estimate.values, strict=True))
    for slide, left in zip(found.forces.slides, found.forces.residuals, strict=True):
        speed, place = slide.speed @ slide.weights, slide.position @ slide.weights
        friction.plot(speed, _friction(value, speed) - left, color="0.6", **POINT)
        cogging.plot(place, _cogging(value, found, place) - left, color="0.6", **POINT)
    for sign in (-1, 1):
        speed = sign * np.linspace(1e-3, found.forces.fastest, 200)
        friction.plot(speed, _friction(value, speed), color="tab:blue")
    places = [slide.position for slide in found.forces.slides]
    place = np.linspace(min(p.min() for p in places), max(p.max() for p in places), 800)
    cogging.plot(place, _cogging(value, found, place), color="tab:blue")
    _label(
        friction,
        "friction: the fit, and what inertia and cogging leave of the current",
        "speed [m/s]",
        "N",
    )
    _label(
        cogging,
        "cogging: the fit, and what inertia and friction leave of the current",
        "motor position [m]",
        "N",
    )
    lines.plot(found.forces.spectrum.wavenumber, found.forces.spectrum.amplitude, linewidth=0.9)
    for j in range(1, found.forces.cogging.count + 1):
        lines.axvline(j / found.forces.cogging.pole_pitch, color="tab:orange", linewidth=0.6)
    lines.set_xlim(0, HARMONICS_SHOWN / found.forces.cogging.pole_pitch)
    _label(lines, "spectrum over position, harmonics in the fit orange", "1/m", "N")
    return figure


FIGURES = {"residuals": residuals, "model": model}


def _friction(value: dict[str, float], speed: np.ndarray) -> np.ndarray:
    fall = value["drop"] * speed**2 / (1 + value.get("curvature", 0.0) * speed**2)
    return np.sign(speed) * (value["break_away"] - fall) + value["viscous"] * speed


def _cogging(value: dict[str, float], found: IdentifiedAxis, position: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi / value.get("pole_pitch", found.forces.cogging.pole_pitch) * position
    orders = range(1, found.forces.cogging.count + 1)
    return sum(
        (
            value[f"sine_{j}"] * np.sin(j * angle) + value[f"cosine_{j}"] * np.cos(j * angle)
            for j in orders
        ),
        np.zeros_like(position),
    )


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set(xlabel=x, ylabel=y)
    axes.grid(color="0.9")


def _saved(path: Path, figure: Figure) -> Path:
    return write(path, lambda temporary: figure.savefig(temporary, dpi=DOTS))
