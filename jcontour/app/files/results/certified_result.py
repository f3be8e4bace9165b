"""Result of `jcontour check --bound`: what `result.json` of its run folder holds."""

from dataclasses import dataclass

from jcontour.app.files.results.run_metrics import MachineSummary, PeakPlace
from jcontour.app.files.results.verdict import Verdict


@dataclass(frozen=True, kw_only=True)
class CertifiedRow:
    """One contour on one plant of the family, SI units.

    Attributes:
        bound: largest error that the disturbances within the bounds can make, proven.
        nominal: largest error without disturbance.
        reached: largest error under the attack, encoder error chosen by it.
        counted: the same where encoders count and the attack chooses the force alone; None where
            nothing is counted.
        control: largest size of each control, proven.
        place: where the largest bound is.
    """

    contour: str
    plant: str
    bound: float
    nominal: float
    reached: float
    counted: float | None
    control: tuple[float, ...]
    place: PeakPlace


@dataclass(frozen=True, kw_only=True)
class CertifiedBound:
    """Largest error of tuned weights on what they were tuned on, proven, SI units.

    Attributes:
        force: bound on what adds to each control [control unit].
        encoder: bound on the error of every measured number, one for all or each [m].
        error: largest error that the disturbances within the bounds can make; None where there is
            no proof, as the next two.
        contour: where it is.
        plant: of which.
        refused: why there is no proof.
    """

    force: float
    encoder: float | tuple[float, ...]
    error: float | None = None
    contour: str | None = None
    plant: str | None = None
    refused: str | None = None


@dataclass(frozen=True, kw_only=True)
class CertifiedResult:
    """Largest errors of a stored loop under bounded disturbances.

    Attributes:
        certified: folder of the run whose loop it is.
        error: the error that counts, "contour" or "tracking".
        force: bound on what adds to each control [control unit].
        encoder: bound on the error of every measured number, one for all or each [m].
        control_limit: of each control; None where the machine states none.
        gain: relative; rows hold for all gains within it; None where for the plants alone.
        rows: one per contour and plant.
        verdict: whether the controls are proven to stay within their limits.
    """

    certified: str
    machine: MachineSummary
    controller: str
    error: str
    force: float
    encoder: float | tuple[float, ...]
    control_limit: tuple[float, ...] | None
    gain: float | None
    rows: list[CertifiedRow]
    verdict: Verdict

    @property
    def worst(self) -> CertifiedRow:
        """Row of the largest bound."""
        return max(self.rows, key=lambda row: row.bound)
