"""Runs round a circle, for the figures."""

import numpy as np
import pytest

from jcontour.app.reports.figures.contours import ContourRuns, DrawnRun

RADIUS, STEPS = 0.01, 60


def drawn(label, plant, radial, diverged=False):
    """A tool that is `radial` [m] outside a circle."""
    around = np.linspace(0, 2 * np.pi, STEPS)
    out = np.stack([np.cos(around), np.sin(around)], axis=-1)
    return DrawnRun(
        label, plant, (RADIUS + radial) * out, np.zeros((STEPS, 2)), radial * out, diverged
    )


@pytest.fixture(scope="module")
def runs():
    around = np.linspace(0, 2 * np.pi, STEPS)
    reference = RADIUS * np.stack([np.cos(around), np.sin(around)], axis=-1)
    scored = np.arange(STEPS) >= 10
    rows = (
        (drawn("start", "nominal plant", 1e-6), drawn("tuned", "nominal plant", 1e-7)),
        (
            drawn("start", "largest RMS (late)", 4e-5),
            drawn("tuned", "largest RMS (heavy)", 9.0, True),
        ),
    )
    return ContourRuns("ring", 1e-3 * np.arange(STEPS), scored, reference, ("X", "Y"), "A", rows)
