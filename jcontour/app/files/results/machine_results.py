"""Results of `identify` and `machine`."""

from dataclasses import dataclass, field

from jcontour.app.files.results.run_metrics import AxisSummary
from tuning.identification.vibration import Resonance
from tuning.response_loop import ResponseLoop


@dataclass(frozen=True)
class LinearAxisResult:
    """One identified axis."""

    name: str  # of the axis
    integrators: int  # 1 for a drive that takes a speed or a force
    order: int  # states without the delay
    delay: int  # [samples]
    gain: float  # [m/s per unit of command at rest, or m per unit without an integrator]
    gain_interval: tuple[float, float]  # 95 %
    time_constants: list[float]  # of its real poles [s], the largest first
    # of its complex poles, natural frequency [Hz] and damping
    resonances: list[tuple[float, float]]
    # denominator, numerator: a and b of `tuning.identification.linear.axis_model`
    denominator: list[float]
    numerator: list[float]
    intervals: list[tuple[float, float]]  # 95 % intervals of a, then of b
    explained: float  # part of the variance of the speed explained where it was not fitted
    residual: float  # RMS of what the model leaves of the position, simulated over the record [m]
    innovation: float  # RMS of the error one sample ahead [m]
    correlation: float  # largest correlation of neighbouring errors
    # shown_from, shown_to: frequencies between which the response is known to 10 % [Hz]
    shown_from: float
    shown_to: float
    measured_to: float  # last line of the response from periods of the record [Hz]; 0 without any
    friction: float | None  # command that dry friction takes; None where it is not seen
    offset: float  # constant command that acts beside the given one, where friction is seen
    saturated: float  # part of the samples at an extreme command
    coupling: dict[str, float]  # part of the errors that the other axes' commands explain, by axis
    uncertainty: float  # of the gain, relative


@dataclass(frozen=True)
class LinearMachineResult:
    """An identified machine."""

    data: str  # file, or how the data were simulated
    words: list[str]  # where the data were found in the file, and what of it was used
    samples: int  # of the record
    dt: float  # sample period [s]
    control_unit: str  # of the commands
    axes: list[LinearAxisResult]  # models
    # largest speed, acceleration and command of the record, by axis; [m/s], [m/s^2]
    limits: dict[str, list[float]]
    # gain, delay: the family: relative uncertainty of the gains, further samples of delay
    gain: float
    delay: int
    notes: list[str]  # what the data do not show, or contradict
    model: str  # name of the machine file


@dataclass(frozen=True, kw_only=True)
class ResponseResult:
    """A control for a measured response."""

    data: str  # file
    lines: int  # that the loop is judged by, of those `measured`
    measured: int
    # lowest, highest: frequency of these lines [Hz]
    lowest: float
    highest: float
    loop: ResponseLoop  # the control
    crossover: float  # last one [Hz]
    phase_margin: float  # there [degrees]
    sensitivity: float  # Ms on the lines, at the frequency `sensitive_at` [Hz]
    sensitive_at: float
    deviated: float  # Ms with one deviation of every line against the loop


@dataclass(frozen=True)
class VibrationResult:
    """Resonances of a machine, from the vibration of its tool."""

    axes: dict[str, list[Resonance]]  # by X, Y or Z of the sensor, the main one first


@dataclass(frozen=True, kw_only=True)
class MachineResult:
    """A machine as its file says."""

    name: str
    file: str  # that was read or written
    figure: str  # of step response and frequency response
    control_unit: str
    period: float  # sample period [s]
    description: dict[str, str]  # heading by heading
    family: list[str]  # names of the plants that it may be
    words: list[str]  # where the numbers of a new file come from
    axes: list[AxisSummary]
    warnings: list[str] = field(default_factory=list)  # what should be looked at
