"""Figures of an identification: residuals of every fit, the friction and cogging that it found."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jcontour.app.reports.figures.shared.axes import grid
from tuning.identification.flexible_axis.axis import IdentifiedAxis

POINT = {"marker": ".", "linestyle": "none", "markersize": 2.0, "alpha": 0.5}
HARMONICS_SHOWN = 10


def residuals(found: IdentifiedAxis) -> Figure:
    """Residuals of current, end effector and force. Where only noise is left they have no shape."""
    figure = Figure(figsize=(9.0, 7.5), layout="constrained")
    (current, tool), (position, speed) = figure.subplots(2, 2)
    if found.winding is not None:
        current.plot(np.concatenate(found.winding.residuals), linewidth=0.4)
    grid(current, "winding: simulated - recorded i_q", "row of the electrical tests", "A")
    if found.link is not None:
        tool.plot(1e6 * np.concatenate(found.link.residuals), linewidth=0.4)
    grid(tool, "link: simulated - recorded end effector", "row of the motion tests", "um")
    for slide, left in zip(found.forces.slides, found.forces.residuals, strict=True):
        colour = "tab:blue" if slide.direction > 0 else "tab:orange"
        position.plot(slide.position @ slide.weights, left, color=colour, **POINT)
        speed.plot(slide.speed @ slide.weights, left, color=colour, **POINT)
    grid(position, "balance of forces, one way blue, the other orange", "motor position [m]", "N")
    grid(speed, "balance of forces", "speed [m/s]", "N")
    return figure


def model(found: IdentifiedAxis) -> Figure:
    """Friction over speed, cogging over position, and the spectrum of cogging.

    Grey: what the other terms leave of the data. Blue: the fit.
    """
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    friction, cogging, lines = figure.subplots(3, 1)
    _draw_friction(friction, found)
    _draw_cogging(cogging, found)
    _draw_spectrum(lines, found)
    return figure


def _draw_friction(axes: Axes, found: IdentifiedAxis) -> None:
    value = _values(found)
    for slide, left in zip(found.forces.slides, found.forces.residuals, strict=True):
        speed = slide.speed @ slide.weights
        axes.plot(speed, _friction(value, speed) - left, color="0.6", **POINT)
    for sign in (-1, 1):
        speed = sign * np.linspace(1e-3, found.forces.fastest, 200)
        axes.plot(speed, _friction(value, speed), color="tab:blue")
    title = "friction: the fit, and what inertia and cogging leave of the current"
    grid(axes, title, "speed [m/s]", "N")


def _draw_cogging(axes: Axes, found: IdentifiedAxis) -> None:
    value, slides = _values(found), found.forces.slides
    for slide, left in zip(slides, found.forces.residuals, strict=True):
        place = slide.position @ slide.weights
        axes.plot(place, _cogging(value, found, place) - left, color="0.6", **POINT)
    low = min(slide.position.min() for slide in slides)
    high = max(slide.position.max() for slide in slides)
    place = np.linspace(low, high, 800)
    axes.plot(place, _cogging(value, found, place), color="tab:blue")
    title = "cogging: the fit, and what inertia and friction leave of the current"
    grid(axes, title, "motor position [m]", "N")


def _draw_spectrum(axes: Axes, found: IdentifiedAxis) -> None:
    spectrum, cogging = found.forces.spectrum, found.forces.cogging
    axes.plot(spectrum.wavenumber, spectrum.amplitude, linewidth=0.9)
    for j in range(1, cogging.highest + 1):
        axes.axvline(j / cogging.pole_pitch, color="tab:orange", linewidth=0.6)
    axes.set_xlim(0, HARMONICS_SHOWN / cogging.pole_pitch)
    grid(axes, "spectrum over position, harmonics in the fit orange", "1/m", "N")


def _values(found: IdentifiedAxis) -> dict[str, float]:
    return dict(zip(found.estimate.names, found.estimate.values, strict=True))


FIGURES = {"residuals": residuals, "model": model}


def _friction(value: dict[str, float], speed: np.ndarray) -> np.ndarray:
    fall = value["drop"] * speed**2 / (1 + value.get("curvature", 0.0) * speed**2)
    return np.sign(speed) * (value["break_away"] - fall) + value["viscous"] * speed


def _cogging(value: dict[str, float], found: IdentifiedAxis, position: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi / value.get("pole_pitch", found.forces.cogging.pole_pitch) * position
    orders = range(1, found.forces.cogging.highest + 1)
    return sum(
        (
            value[f"sine_{j}"] * np.sin(j * angle) + value[f"cosine_{j}"] * np.cos(j * angle)
            for j in orders
        ),
        np.zeros_like(position),
    )
