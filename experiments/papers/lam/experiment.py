"""Lam, Manzie & Good: model predictive contouring control of an X-Y table, Figs 8 to 13 and every statement about them.

The paper shows measurements. Its contour, the friction of its table and the weights of its
baselines are not printed: ours are named in `lam_runs`, and what can be reproduced is how the
controllers compare.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.papers.lam.claims import MPCC, MPTC, PI_FAST, PI_SLOW, claims
from experiments.papers.lam.figures import draw
from experiments.papers.lam.runs import (
    PERIOD,
    SAMPLE,
    cascaded,
    lobes,
    machines,
    row,
    trace_of,
    traced,
    tracked,
)
from experiments.papers.lam.tables import show
from jcontour.geometry.contour import Contour

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = "D. Lam, C. Manzie, M. Good: Application of Model Predictive Contouring Control to an X-Y Table. IFAC World Congress (2011)"
PUBLISHED = ()  # Figs 8 to 13 have no numbers in print
TRACE_WEIGHTS = (0.03, 5.0)  # q_theta of Figs 8 to 11
WEIGHTS = (
    0.02,
    0.03,
    0.1,
    0.3,
    1.0,
    5.0,
)  # q_theta of Fig. 13; 0.02 is slow enough for the slowest of the others
SPEEDS = (0.05, 0.075, 0.1, 0.125, 0.15)  # [m/s] of the tracking controllers, section 5
SHOWN_PLANT = "friction"  # of Figs 8 to 11: the nearest there is to the paper's machine


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce lam`."""

    quick: bool = False
    """The friction machine alone, instead of the nominal, the frictional and the mismatched one."""


def run(settings: Settings, folder: Path) -> dict[str, Any]:
    """Simulate everything; all that is found is in the summary, nothing is written to the folder."""
    contour = lobes()
    plants = (SHOWN_PLANT,) if settings.quick else tuple(machines(SAMPLE))
    traces, rows = [], []
    for plant in plants:
        found, shown = _one_plant(contour, plant)
        rows += found
        traces += shown if plant == SHOWN_PLANT else []
    summary: dict[str, Any] = {
        "source": SOURCE,
        "settings": asdict(settings),
        "plants": list(plants),
        "path": _path(contour),
        "traces": traces,
        "trade_off": rows,
    }
    summary["claims"] = claims(summary)
    return summary


def _one_plant(contour: Contour, plant: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Rows of Fig. 13, and the traces of Figs 8 to 11."""
    radius, fine, coarse = _radius(contour), machines(SAMPLE)[plant], machines(PERIOD)[plant]
    rows, traces = [], []
    for weight in WEIGHTS:
        outcome, controller = traced(fine, contour, weight)
        rows.append(row(MPCC, plant, f"q_theta {weight:g}", outcome, radius))
        if weight in TRACE_WEIGHTS:
            traces.append(trace_of(contour, controller, outcome, weight))
    for speed in SPEEDS:
        setting = f"{1e3 * speed:g} mm/s"
        rows.append(row(MPTC, plant, setting, tracked(fine, contour, speed), radius))
        rows.append(row(PI_SLOW, plant, setting, cascaded(coarse, contour, speed), radius))
        rows.append(row(PI_FAST, plant, setting, cascaded(fine, contour, speed), radius))
    return sorted(rows, key=lambda r: (r["controller"], r["time_s"])), traces


def _path(contour: Contour) -> dict[str, Any]:
    points = 1e3 * np.asarray(contour.position(np.linspace(0.0, float(contour.length), 1001)))
    return {
        "length_mm": 1e3 * float(contour.length),
        "max_radius_mm": 1e3 * _radius(contour),
        "points_mm": points.tolist(),
    }


def _radius(contour: Contour) -> float:
    """Largest distance from the centre of the contour [m]."""
    return float(
        np.linalg.norm(
            np.asarray(contour.position(np.linspace(0.0, float(contour.length), 4001))), axis=1
        ).max()
    )
