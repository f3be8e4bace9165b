"""Result of `jcontour machine`: what `--json` prints."""

from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class AxisSummary:
    """One axis of the nominal model, under one unit of its own control.

    Attributes:
        kind: what settles: "speed", "position", "acceleration", or "nothing" of an axis that runs
            away.
        gain: the value to which it settles [m/s, m, m/s^2]; NaN of nothing.
        rise: time to 63 % of it, the delay left out [s]; NaN where it takes longer than a hundred
            thousand samples.
        delay: samples before anything moves.
        acceleration: largest [m/s^2].
        resonance: of its most ringing mode [Hz]; NaN without one.
    """

    name: str
    kind: str
    gain: float
    rise: float
    delay: int
    acceleration: float
    resonance: float


@dataclass(frozen=True, kw_only=True)
class MachineResult:
    """A machine as its file says.

    Attributes:
        file: that was read or written.
        figure: of step response and frequency response.
        period: sample period [s].
        description: heading by heading.
        family: names of the plants that it may be.
        words: where the numbers of a new file come from.
        warnings: what should be looked at.
    """

    name: str
    file: str
    figure: str
    control_unit: str
    period: float
    description: dict[str, str]
    family: list[str]
    words: list[str]
    axes: list[AxisSummary]
    warnings: list[str] = field(default_factory=list)
