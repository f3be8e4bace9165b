"""Lam, Manzie & Good 2011: model predictive contouring control of an X-Y table, Figs 8 to 13.

The paper shows measurements. Its contour, the friction of its table and the weights of its
baselines are not printed: ours are named in `runs`. Only the comparison of the controllers can be
reproduced.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from experiments.papers.lam.claims import MPCC, MPTC, PI_FAST, PI_SLOW, claims
from experiments.papers.lam.figures import draw
from experiments.papers.lam.result import Lobes, Point, Result, Trace
from experiments.papers.lam.runs import (
    PERIOD,
    SAMPLE,
    cascaded,
    lobes,
    machines,
    point,
    trace_of,
    traced,
    tracked,
)
from experiments.papers.lam.tables import show
from jcontour.geometry.contour import Contour

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "D. Lam, C. Manzie, M. Good: Application of Model Predictive Contouring Control to an X-Y "
    "Table. IFAC World Congress (2011)"
)
PUBLISHED = ()  # Figs 8 to 13 have no numbers in print
TRACE_WEIGHTS = (0.03, 5.0)  # q_theta of Figs 8 to 11
# q_theta of Fig. 13; 0.02 is slow enough for the slowest of the others
WEIGHTS = (0.02, 0.03, 0.1, 0.3, 1.0, 5.0)
SPEEDS = (0.05, 0.075, 0.1, 0.125, 0.15)  # [m/s] of the tracking controllers, section 5
SHOWN_PLANT = "friction"  # of Figs 8 to 11: the nearest there is to the paper's machine


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce lam`."""

    quick: bool = False
    """The friction machine alone, instead of the nominal, the frictional and the mismatched one."""


def run(settings: Settings, folder: Path) -> Result:
    """Simulate everything; nothing is written to the folder."""
    contour = lobes()
    plants = (SHOWN_PLANT,) if settings.quick else tuple(machines(SAMPLE))
    traces: list[Trace] = []
    points: list[Point] = []
    for plant in plants:
        found, shown = _on_plant(contour, plant)
        points += found
        traces += shown if plant == SHOWN_PLANT else []
    found = Result(SOURCE, asdict(settings), plants, _path(contour), tuple(traces), tuple(points))
    return replace(found, claims=claims(found))


def _on_plant(contour: Contour, plant: str) -> tuple[list[Point], list[Trace]]:
    """Points of Fig. 13, and the traces of Figs 8 to 11."""
    radius, fine, coarse = _radius(contour), machines(SAMPLE)[plant], machines(PERIOD)[plant]
    points, traces = [], []
    for weight in WEIGHTS:
        outcome, controller = traced(fine, contour, weight)
        points.append(point(MPCC, plant, f"q_theta {weight:g}", outcome, radius))
        if weight in TRACE_WEIGHTS:
            traces.append(trace_of(contour, controller, outcome, weight))
    for speed in SPEEDS:
        setting = f"{1e3 * speed:g} mm/s"
        points.append(point(MPTC, plant, setting, tracked(fine, contour, speed), radius))
        points.append(point(PI_SLOW, plant, setting, cascaded(coarse, contour, speed), radius))
        points.append(point(PI_FAST, plant, setting, cascaded(fine, contour, speed), radius))
    return sorted(points, key=lambda one: (one.controller, one.time_s)), traces


def _path(contour: Contour) -> Lobes:
    arc = np.linspace(0.0, float(contour.length), 1001)
    points = 1e3 * np.asarray(contour.position(arc))
    return Lobes(1e3 * float(contour.length), 1e3 * _radius(contour), points)


def _radius(contour: Contour) -> float:
    """Largest distance from the centre of the contour [m]."""
    arc = np.linspace(0.0, float(contour.length), 4001)
    return float(np.linalg.norm(np.asarray(contour.position(arc)), axis=1).max())
