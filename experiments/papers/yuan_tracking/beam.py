"""The beam of the test bench (Fig. 3.3), by Euler and Bernoulli in place of finite elements."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from experiments.papers.panels import Curve, Panel
from jcontour.app.reports.figures.axes import CYCLE
from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.plants.flexible_axis.cantilever import beam_modes, beam_shapes, thesis_beam

MODES = 3


@dataclass(frozen=True)
class BeamStudy:
    """Frequencies of the beam [Hz], and the load at its tip that gives the identified one."""

    bare_hz: tuple[float, ...]
    loaded_hz: tuple[float, ...]
    identified_hz: float  # sqrt(k / m_e) of section 3.3
    load_kg: float
    stiffness: float  # identified k over 3 E I / L^3, that of the beam at its tip
    place: Float[np.ndarray, " x"]  # along the beam, over its length
    shapes: Float[np.ndarray, "modes x"]  # of the loaded beam, one at their largest


@cache
def beam_study() -> BeamStudy:
    """Modes of the bare beam and of the loaded one."""
    axis, beam = thesis_axis(), thesis_beam()
    k, m = float(axis.stiffness[0]), float(axis.tool_mass[0])
    wanted = float(np.sqrt(k / m))

    def off(load: float) -> float:
        return float(beam_modes(thesis_beam(load), 1).frequency[0]) - wanted

    load = float(np.asarray(brentq(off, 1e-6, 10.0, xtol=1e-12)))
    loaded, place = beam_modes(thesis_beam(load), MODES), np.linspace(0, 1, 101)
    shapes = beam_shapes(loaded.beta, place)
    hertz = 1 / (2 * np.pi)
    return BeamStudy(
        tuple((beam_modes(beam, MODES).frequency * hertz).tolist()),
        tuple((loaded.frequency * hertz).tolist()),
        wanted * hertz,
        load,
        k / (3 * beam.stiffness / beam.length**3),
        place,
        shapes / np.abs(shapes).max(axis=1, keepdims=True),
    )


def panel(study: BeamStudy) -> Panel:
    """Shapes of the modes along the beam."""
    curves = [
        Curve(study.place, shape, f"{hz:.4g} Hz", {"color": colour})
        for shape, hz, colour in zip(study.shapes, study.loaded_hz, CYCLE, strict=False)
    ]
    title = f"Fig. 3.3: modes of the beam with {study.load_kg:.3f} kg at its tip"
    return Panel(title, "place along the beam, over its length", "deflection", curves)
