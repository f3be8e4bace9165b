"""Result of `jcontour rank`: what `result.json` of its run folder holds."""

from dataclasses import dataclass, field

from jcontour.app.files.results.run_metrics import MachineSummary
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import Verdict


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A controller that is tuned alike, with the numbers that are chosen and not tuned.

    Attributes:
        controller: name in the catalogue, or FILE.py:NAME.
        preview: horizon [samples].
        terminal: cost at its end.
        model_delay: samples of unknown delay in its model; None for its own choice.
    """

    controller: str
    preview: int
    terminal: str
    model_delay: int | None = None


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """One tuned controller, on the machine with all effects; errors are RMS [m].

    Attributes:
        label: name in the table.
        failure: why it has no place, in one line; the numbers are None then.
        held_out: geometric mean over held-out contours of the family's worst error.
        training: the same over training contours.
        held_out_errors: the family's worst error, contour by contour.
        training_errors: likewise.
        peak_sensitivity: largest Ms at the probes of the training contours, over the family; None
            where a frozen loop is unstable, or none is looked at.
        learns: the controller changes while it runs; Ms is that of the loop that it begins with.
        feasible: whether every limit holds, those of the machine with all effects.
        exceeded: limits of the machine that its runs do not keep, a line each.
        stationary: whether the search had ended.
        evaluations: points that were evaluated.
        weights: by name.
        seconds: processor time of the runs of all contours and plants, compiled [s].
    """

    candidate: Candidate
    label: str
    failure: str | None = None
    held_out: float | None = None
    training: float | None = None
    held_out_errors: dict[str, float] | None = None
    training_errors: dict[str, float] | None = None
    peak_sensitivity: float | None = None
    learns: bool = False
    feasible: bool = False
    exceeded: list[str] = field(default_factory=list)
    stationary: bool = False
    evaluations: int = 0
    weights: dict[str, Weight] | None = None
    seconds: float | None = None


@dataclass(frozen=True, kw_only=True)
class RankedResult:
    """All controllers, the best first; those that failed come last.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        evaluations: that each of them was allowed.
        verdict: whether a controller keeps every limit.
        learning: names of controllers that were left out, as they learn while they run.
    """

    machine: MachineSummary
    error: str
    evaluations: int
    rows: list[Ranked]
    verdict: Verdict
    learning: list[str] = field(default_factory=list)
