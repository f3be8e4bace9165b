"""Results of `identify --machine linear` and `machine`."""

from dataclasses import dataclass, field

from tuning.response_loop import ResponseLoop


@dataclass(frozen=True)
class LinearAxisResult:
    """One identified axis.

    Attributes:
        name: of the axis.
        integrators: 1 for a drive that takes a speed or a force.
        order: states without the delay.
        delay: [samples].
        gain: [m/s per unit of command at rest, or m per unit without an integrator].
        gain_interval: 95 %.
        time_constants: of its real poles [s], the largest first.
        resonances: of its complex poles, natural frequency [Hz] and damping.
        denominator, numerator: a and b of `tuning.identification.linear.axis_model`.
        intervals: 95 % intervals of a, then of b.
        explained: part of the variance of the speed explained where it was not fitted.
        residual: RMS of what the model leaves of the position, simulated over the record [m].
        innovation: RMS of the error one sample ahead [m].
        correlation: largest correlation of neighbouring errors.
        shown_from, shown_to: frequencies between which the response is known to 10 % [Hz].
        friction: command that dry friction takes; None where it is not seen.
        offset: constant command that acts beside the given one, where friction is seen.
        saturated: part of the samples at an extreme command.
        coupling: part of the errors that the other axes' commands explain, by axis.
        uncertainty: of the gain, relative.
    """

    name: str
    integrators: int
    order: int
    delay: int
    gain: float
    gain_interval: tuple[float, float]
    time_constants: list[float]
    resonances: list[tuple[float, float]]
    denominator: list[float]
    numerator: list[float]
    intervals: list[tuple[float, float]]
    explained: float
    residual: float
    innovation: float
    correlation: float
    shown_from: float
    shown_to: float
    friction: float | None
    offset: float
    saturated: float
    coupling: dict[str, float]
    uncertainty: float


@dataclass(frozen=True)
class LinearMachineResult:
    """An identified machine.

    Attributes:
        data: file, or how the data were simulated.
        words: where the data were found in the file, and what of it was used.
        samples: of the record.
        dt: sample period [s].
        control_unit: of the commands.
        axes: models.
        limits: largest speed, acceleration and command of the record, by axis; [m/s], [m/s^2].
        gain, delay: the family: relative uncertainty of the gains, further samples of delay.
        notes: what the data do not show, or contradict.
        model: name of the machine file.
    """

    data: str
    words: list[str]
    samples: int
    dt: float
    control_unit: str
    axes: list[LinearAxisResult]
    limits: dict[str, list[float]]
    gain: float
    delay: int
    notes: list[str]
    model: str


@dataclass(frozen=True, kw_only=True)
class ResponseResult:
    """A control for a measured response.

    Attributes:
        data: file.
        lines: that the loop is judged by, of those `measured`.
        lowest, highest: frequency of these lines [Hz].
        loop: the control.
        crossover: last one [Hz].
        phase_margin: there [degrees].
        sensitivity: Ms on the lines, at the frequency `sensitive_at` [Hz].
        deviated: Ms with one deviation of every line against the loop.
    """

    data: str
    lines: int
    measured: int
    lowest: float
    highest: float
    loop: ResponseLoop
    crossover: float
    phase_margin: float
    sensitivity: float
    sensitive_at: float
    deviated: float


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
