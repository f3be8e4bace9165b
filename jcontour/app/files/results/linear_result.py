"""Result of `jcontour identify --machine linear`."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LinearAxisResult:
    """One identified axis.

    Attributes:
        name: of the axis.
        integrators: 1 for a drive that takes a speed or a force.
        order: states without the delay.
        delay: [samples].
        delays: delays that the data do not tell from it [samples].
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
    delays: list[int]
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
