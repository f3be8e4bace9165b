"""What an exported law is tried on: the recorded run, and the same run off its plan."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from jcontour.export.affine_law import AffineLaw
from jcontour.export.code_text import Precision
from jcontour.export.drive_law import DriveLaw, DrivePlan, replayed

CHANGE = 0.1  # of the largest control: far above rounding, and mostly below the limit
NUMBERS: dict[Precision, type[np.floating]] = {"double": np.float64, "single": np.float32}


def off_the_plan(
    law: DriveLaw, plan: DrivePlan, u: Float[np.ndarray, "T p"]
) -> Float[np.ndarray, "T q"]:
    """Measurements of the planned run with a slow wave on each of them.

    On its plan a law has nothing to do: the feedback is seen only off it. The wave of measurement j
    has j + 3/2 periods along the run. Its size is that which changes the controls by a tenth of the
    largest one.
    """
    steps, measured = plan.r.shape
    periods = np.arange(measured) + 1.5
    phase = 2.0 * np.pi * np.arange(steps)[:, None] * periods / steps
    ranges = np.ptp(plan.r, axis=0)
    ranges[ranges == 0.0] = ranges.max()  # of an axis that stands still
    wave = ranges * np.sin(phase)
    free = replace(law, limit=np.full(law.inputs, np.inf))
    still = replace(plan, f=np.zeros_like(plan.f), r=np.zeros_like(plan.r))
    largest = np.abs(replayed(free, still, wave)).max()
    size = CHANGE * np.abs(u).max() / largest if largest > 0.0 else 0.0  # no feedback at all
    return plan.r + size * wave


def rounding(
    affine: AffineLaw, plan: DrivePlan, y: Float[np.ndarray, "T q"], precision: Precision
) -> float:
    """Largest difference that the written numbers make to the controls of recorded measurements."""
    _, exact = affine.run(y)
    return float(np.abs(replayed(affine.law, plan, y, NUMBERS[precision]) - exact).max())
