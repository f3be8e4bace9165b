"""Result of `jcontour precompensate`: what `result.json` of its run folder holds."""

from dataclasses import dataclass, field

from jcontour.app.files.results.run_metrics import MachineSummary, RunMetrics
from jcontour.app.files.results.verdict import LimitCheck, Verdict


@dataclass(frozen=True, kw_only=True)
class BentResult:
    """Errors along the reference as it is, and along the bent one.

    Attributes:
        error: the error that counts, "contour" or "tracking".
        roughness: price of the correction's bends.
        largest: largest shift of the reference [m].
        chord: largest distance of the G-code's moves, at their feeds, from the bent reference at
            the same time [m]; None of one axis.
        moves: of the G-code.
        halts: places where the G-code stops, as the program does more there than move its axes.
        ramps: moves of the program along which Z moves too; the G-code leaves Z alone.
        before, after: metrics by plant, the nominal one first.
        asked: largest speed [m/s] and acceleration [m/s^2] of an axis along the bent reference.
        limits: of the machine, along the bent reference; of the reference itself those that it
            exceeds.
        limits_before: of the machine, along the reference as it is.
        unlimited: what the machine states no limit of, of speed, acceleration and control.
        weights: of the controller, a line for each.
        doubts: what of the program may be meant otherwise.
        held: how long the last point is held, until the tools rest [s]; scored like the run. None
            of a run that ends in motion.
        rests: whether they rest by then.
        changing: largest acceleration of an axis from one feed of the G-code to the next [m/s^2].
        verdict: on the bent reference.
    """

    machine: MachineSummary
    controller: str
    contour: str
    error: str
    samples: int
    roughness: float
    largest: float
    chord: float | None
    moves: int
    before: dict[str, RunMetrics]
    after: dict[str, RunMetrics]
    limits: list[LimitCheck]
    limits_before: list[LimitCheck] = field(default_factory=list)
    asked: tuple[float, float] = (0.0, 0.0)
    halts: int = 0
    ramps: int = 0
    unlimited: tuple[str, ...] = ()
    weights: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    held: float | None = 0.0
    rests: bool = True
    changing: float = 0.0
    verdict: Verdict | None = None

    def _rms(self, runs: dict[str, RunMetrics]) -> list[float]:
        return [float(getattr(run, f"rms_{self.error}_error")) for run in runs.values()]

    @property
    def nominal(self) -> tuple[float, float]:
        """RMS error of the nominal machine before and after [m]."""
        return self._rms(self.before)[0], self._rms(self.after)[0]

    @property
    def worst(self) -> tuple[float, float]:
        """The worst RMS error of the family before and after [m]."""
        return max(self._rms(self.before)), max(self._rms(self.after))

    @property
    def nominal_gain(self) -> float:
        """How many times smaller the nominal RMS error is."""
        return _ratio(*self.nominal)

    @property
    def worst_gain(self) -> float:
        """How many times smaller the worst RMS error of the family is."""
        return _ratio(*self.worst)


def _ratio(before: float, after: float) -> float:
    return before / max(after, 1e-15)
