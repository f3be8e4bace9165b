"""Result of `jcontour trace`: what `result.json` of its run folder holds."""

from dataclasses import dataclass, field

import numpy as np

from jcontour.app.files.results.run_metrics import ContourRead
from jcontour.app.files.results.verdict import LimitCheck, Verdict


@dataclass(frozen=True)
class Signals:
    """Signals of a run, one row per sample of the plant."""

    arc_mm: np.ndarray
    contour_error_um: np.ndarray
    speed_mm_s: np.ndarray
    tool_mm: np.ndarray
    control: np.ndarray


@dataclass(frozen=True)
class Asked:
    """What the controller ran with, as the flags name it, the machine's defaults filled in.

    Attributes:
        r_control: of every control.
        period_ms: of the controller.
    """

    q_theta: float
    q_lag: float
    r_control: tuple[float, ...]
    horizon: int
    period_ms: float
    max_speed_mm_s: float


@dataclass(frozen=True)
class Traversed:
    """Result of `trace`.

    Attributes:
        asked: what it ran with.
        failure: why it stopped, in one line; empty when it went through.
        steps: samples that were simulated.
        fallbacks: of these, those that the fallback made.
        limited: of these, the fraction with a limit active in the plan.
        residual: the worst of any QP.
        arrived: the tool came to the end of the path, and was there at the last sample.
        time_s: until the margin of `traversal_score` before the end; None where it did not arrive.
        came_mm: farthest along the path, before it left it.
        progress_mm: where on the path the controller held it to be at the last sample.
        outrun: that progress came to the end of the path, and the tool never did.
        left_mm: how far off it was at most; None where it was never farther off than the path is
            large.
        end_mm: distance of the tool from the end of the path at the last sample.
        rms_um: contour error of the whole path; None where the tool did not come to its end.
        peak_um: its largest, likewise.
        control_used: largest size of every control.
        control_limit: of every control.
        limits: of the machine.
        verdict: whether the tool arrived, within the limits of the machine.
        read: file behind the contour; None where there is none.
        axes: names.
        lost: what of the file is not kept, in words.
    """

    plant: str
    contour: str
    control_unit: str
    length_mm: float
    asked: Asked
    failure: str
    steps: int
    fallbacks: int
    limited: float
    residual: float
    arrived: bool
    time_s: float | None
    came_mm: float | None = None
    progress_mm: float | None = None
    outrun: bool = False
    left_mm: float | None = None
    end_mm: float | None = None
    rms_um: float | None = None
    peak_um: float | None = None
    control_used: tuple[float, ...] = ()
    control_limit: tuple[float, ...] = ()
    limits: list[LimitCheck] = field(default_factory=list)
    verdict: Verdict | None = None
    signals: Signals | None = None
    read: ContourRead | None = None
    axes: tuple[str, ...] = ()
    lost: str = ""
