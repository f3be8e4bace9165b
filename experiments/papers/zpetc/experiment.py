"""Smith & Lee 1990: ZPETC with an integrator and adaptive ZPETC on a three-link manipulator.

The tables of errors were measured on the manipulator. Models, filters and equations are checked to
the printed digits. Our runs take a path, a geometry and model errors that are chosen; the printed
limit of the current is kept where Table 2 is judged, friction is assumed there.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from jcontour import Controller, Plant, Reference, simulate
from jcontour.controllers import AdaptiveZeroPhaseTracking, ZeroPhaseTracking, zero_phase_filter
from jcontour.controllers.feedforward.adaptive_zpetc import Estimate, NormalisedLeastSquares
from jcontour.controllers.feedforward.zpetc import gain_error
from jcontour.linear import transfer_function
from jcontour.linear.transfer_functions import TransferFunction, from_polynomials
from jcontour.motion import from_samples
from jcontour.plants import Encoders, Quantised, leg_lengths, manipulator_path, servo_axes
from jcontour.plants.arms import LVDT_QUANTUM, PATH_DURATION, SERVO_GAIN, SERVO_POLE
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import Rollout

SOURCE = (
    "A. Smith, K.-M. Lee: An Experimental Investigation of Two Digital Tracking Controllers: "
    "Adaptive and Non-Adaptive. ASME Winter Annual Meeting (1990)"
)
POLE = 567.0  # of (1), in print [rad/s]
CORRECTED_POLE = 567.5  # gives the printed digits (errata)
FITTED_GAIN, FITTED_POLE = 817.41795, 567.503628  # give all digits of (8)
FAST, SLOW = 3e-3, 16.8e-3  # sample periods [s]
PRINTED = {  # gain, zero and poles of (6), (7), (16) and (17)
    "(6)": ("0.0449", "0.5737", "1", "0.1822"),
    "(7)": ("3.673e-2", "0.5737", "0.2196", "0.9259"),
    "(16)": ("0.4335", "0.1171", "1", "7.235e-5"),
    "(17)": ("0.2995", "0.1171", "0.0544", "0.6461"),
}
PREFILTER = ("6.3060", "3.7692", "-11.3100", "2.2348")  # (8)
WITHOUT_INTEGRATOR = 546.1  # [um]
WITH_INTEGRATOR = 111.8  # [um], in the text; Table 2 has 66.5
# [s], section 5.1: with the least mean error of Table 2, 66.5 and 41.9 um; its others are lost
BEST_TIME = 0.05
AMPLIFIER = {"Table 1": 38.0, "text": 750.0}  # [A/V]
GAIN = "16359"  # of (1)
PRINTED_POSITION_POLE = 26.0  # [rad/s] at which the paper places the slower pole
INTEGRAL_TIMES = (None, 0.002, 0.003, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # [s]
QUICK_TIMES = (None, 0.002, 0.01, 0.05, 0.2)
STARTS = ((-0.6461, 0.3539), (-0.8, 0.2))  # the good model (19), and a poor one
TRACES = (2.0, 200.0)
ADAPTATION_OFF = 1e9  # [m] of dead zone
FRICTIONS = (0.0, 3.0, 6.0)  # [A], assumed: with the most, 0.05 s is the best time, as in print
FLOOR = 1e-3  # [m]: the paper's normalisation is in mm
FIRST, LATER, CHANGE = 30.0, 7.5, 0.5  # [A], [A], [s] after the start of the motion
PER_AMPERE = 0.17011 * 0.7958e-3 / 2.4434e-4  # [m/s^2 per A], Table 1
SUBSTEP = 1e-4  # [s]


@dataclass(frozen=True)
class Model:
    """Gain, zero (-z of 1 + z / z) and poles of a discrete model: in print, and of a servo."""

    item: str
    printed: tuple[str, ...]
    pole_rad_s: float  # of the servo
    ours: tuple[float, ...]


@dataclass(frozen=True)
class IntegralRun:
    """Zero phase tracking of one leg with an integrator, counts of 43 um."""

    truth: str
    integral_time: float | None  # [s]; None without
    mean_um: float
    peak_um: float
    friction: float | None = None  # [A] beside the limit of the current; None without both


@dataclass(frozen=True)
class AdaptiveRun:
    """Adaptive zero phase tracking of one leg, counts of 43 um."""

    truth: str
    theta: tuple[float, float]  # first a_1 and b_0
    trace: float
    rule: str  # of the forgetting factor: ours, as printed, or none
    mean_um: float
    second_half_um: float
    final_theta: tuple[float, float]
    fitted_theta: tuple[float, float]  # of the servo's loop, by least squares along the path
    final_trace: float


@dataclass(frozen=True)
class GainError:
    """Gain and phase that zero phase tracking leaves, over frequency."""

    hertz: Float[np.ndarray, " f"]
    error: Float[np.ndarray, " f"]
    phase: Float[np.ndarray, " f"]  # of y / y_d [rad]


@dataclass(frozen=True)
class Units:
    """Gain and pole of (1) from Table 1, with one of the two amplifier gains."""

    source: str
    amperes_per_volt: float
    gain_inch: float  # inch / (s^2 V)
    pole: float  # [rad/s]


@dataclass(frozen=True)
class Result:
    """Models, filters and equations, and runs of one leg."""

    models: tuple[Model, ...]
    prefilters: dict[str, tuple[float, ...]]  # coefficients of (8) by what they are made from
    slow_pole: float  # of the printed loop [rad/s]
    corrected_5: float  # difference between (5), corrected, and a simulation at 3 Hz
    printed_5: float  # the same as printed
    units: tuple[Units, ...]
    gain_error: GainError
    errors_um: dict[str, Float[np.ndarray, " T"]]  # of drawn runs
    integral: tuple[IntegralRun, ...]  # the linear servo, then the limit and some frictions
    adaptive: tuple[AdaptiveRun, ...]


class Truth(NamedTuple):
    """A servo that the controller's model may miss."""

    name: str
    gain: float  # times SERVO_GAIN
    pole: float

    def axis(self, dt: float) -> Plant:
        """One leg."""
        return servo_axes([self.gain * SERVO_GAIN], self.pole, dt)


TRUTHS = (
    Truth("exact", 1.0, SERVO_POLE),
    Truth("gain x1.1", 1.1, SERVO_POLE),
    Truth("gain x1.5", 1.5, SERVO_POLE),
    Truth("gain x0.7, pole 500", 0.7, 500.0),
)


def run(quick: bool = False) -> Result:
    """Simulate everything."""
    times = QUICK_TIMES if quick else INTEGRAL_TIMES
    fast, slow = (TRUTHS[2].axis(dt) for dt in (FAST, SLOW))
    adapting = adaptive(STARTS[0], NormalisedLeastSquares(TRACES[0], FLOOR))
    corrected, printed = equation_5()
    return Result(
        models=models(),
        prefilters={
            f"servo pole {FITTED_POLE:.2f}": prefilter_of(fitted_loop()),
            "from (7) as printed": prefilter_of(PRINTED_LOOP),
        },
        slow_pole=float(-np.log(float(PRINTED["(7)"][3])) / FAST),
        corrected_5=corrected,
        printed_5=printed,
        units=units(),
        gain_error=gain_left(),
        errors_um={
            "Fig. 8: no integrator, gain x1.5": errors(tracking(None), fast)[0],
            f"Fig. 9: T_i = {BEST_TIME:g} s, gain x1.5": errors(tracking(BEST_TIME), fast)[0],
            "adaptive, gain x1.5": errors(adapting, slow)[0],
        },
        integral=tuple(
            row for one in (None, *FRICTIONS) for row in integral_runs(times=times, friction=one)
        ),
        adaptive=adaptive_runs(),
    )


def servo(dt: float, gain: float = SERVO_GAIN, pole: float = SERVO_POLE) -> TransferFunction:
    """One leg from control to length [m]."""
    return transfer_function(servo_axes([gain], pole, dt))


def closed(plant: TransferFunction, gain: float) -> TransferFunction:
    """Position loop u = gain (r - y), from r to y."""
    top = gain * plant.numerator
    return from_polynomials(top, polynomial.polyadd(plant.denominator, top), plant.dt)


def placing_gain(plant: TransferFunction, pole: float = PRINTED_POSITION_POLE) -> float:
    """Gain that puts a pole of the loop at exp(-pole T)."""
    at = np.array(np.exp(pole * plant.dt))  # in lambda
    ratio = polynomial.polyval(at, plant.denominator) / polynomial.polyval(at, plant.numerator)
    return float(-ratio)


_gain, _zero, _first, _second = map(float, PRINTED["(7)"])
PRINTED_LOOP = from_polynomials(  # (7)
    _gain * np.array([0.0, 1.0, _zero]), np.convolve([1.0, -_first], [1.0, -_second]), FAST
)


def models() -> tuple[Model, ...]:
    """(6), (7), (16), (17) with the pole in print and with the corrected one; the fitted loop."""
    rows = []
    for pole in (POLE, SERVO_POLE):
        for dt, open_, loop in ((FAST, "(6)", "(7)"), (SLOW, "(16)", "(17)")):
            plant = servo(dt, pole=pole)
            rows += [(open_, pole, plant), (loop, pole, closed(plant, placing_gain(plant)))]
    described = []
    for item, pole, function in (*rows, ("(7)", FITTED_POLE, fitted_loop())):
        integrating = PRINTED[item][2] == "1"  # a plant: its gain is per mm, its pole at 1 is first
        poles = sorted((float(np.real(p)) for p in function.poles_z), key=abs, reverse=integrating)
        gain = function.gain * (1e3 if integrating else 1.0)
        zero = -float(np.real(function.zeros_z[0]))
        described.append(Model(item, PRINTED[item], pole, (gain, zero, *poles)))
    return tuple(described)


def prefilter_of(loop: TransferFunction) -> tuple[float, ...]:
    """Coefficients of y_d(k+2), y_d(k+1), y_d(k), y_d(k-1)."""
    ahead = zero_phase_filter(loop)
    return tuple((np.asarray(ahead.numerator) / np.asarray(ahead.denominator)[0]).tolist())


def fitted_loop() -> TransferFunction:
    """The loop whose prefilter has all digits of (8)."""
    return closed(servo(FAST, pole=FITTED_POLE), FITTED_GAIN)


def equation_5(hertz: float = 3.0, integral: float = 0.06) -> tuple[float, float]:
    """(5) against the loop of a plant with 1.1 times the gain: corrected, and as printed.

    Differences at one frequency, over the size of the loop's answer.
    """
    x = np.exp(-2j * np.pi * hertz * FAST)
    model = closed(servo(FAST), FITTED_GAIN)
    truth = closed(servo(FAST, 1.1 * SERVO_GAIN), FITTED_GAIN)
    ahead = zero_phase_filter(model)
    fed = polynomial.polyval(x, ahead.numerator) / polynomial.polyval(x, ahead.denominator)
    fed, sums = fed / x**ahead.preview, integral / (1 - x)
    wanted = truth.response(x) * (fed + sums) / (1 + truth.response(x) * sums)
    apart = []
    zero = 1 - truth.zeros_z[0] * x
    below = polynomial.polyval(x, truth.denominator) * (1 - x)
    for cancelled in (truth.gain, zero):
        # (5) holds for the plant's own B^a B^u; printed is B^u B^u
        added = x * integral * zero * cancelled
        through = fed * x * truth.gain * zero * (1 - x)
        ratio = (through + added) / (below + added)
        apart.append(float(abs(ratio - wanted) / abs(wanted)))
    return apart[0], apart[1]


def units() -> tuple[Units, ...]:
    """Gain and pole of (1) from Table 1: inches and 750 A/V give the printed number."""
    torque, lead, inertia = 0.17011, 0.7958, 2.4434e-4  # N m/A, mm/rad, kg m^2
    velocity, feedback, viscous = 0.01752, 0.0780, 1.03e-6  # V s/mm, -, N m s/rad
    rows = []
    for source, amplifier in AMPLIFIER.items():
        gain = amplifier * torque * lead / inertia  # mm / (s^2 V)
        pole = gain * velocity * feedback + viscous / inertia
        rows.append(Units(source, amplifier, gain / 25.4, pole))
    return tuple(rows)


def gain_left() -> GainError:
    """Gain error and phase of the corrected model's loop behind its filter, up to Nyquist."""
    hertz = np.geomspace(0.1, 0.999 / (2 * FAST), 200)
    loop = closed(servo(FAST), FITTED_GAIN)
    ahead, x = zero_phase_filter(loop), np.exp(-2j * np.pi * hertz * FAST)
    fed = polynomial.polyval(x, ahead.numerator) / polynomial.polyval(x, ahead.denominator)
    through = loop.response(x) * fed / x**ahead.preview  # as the filter is built
    return GainError(hertz, gain_error(loop, 2 * np.pi * hertz), np.angle(through))


def legs(dt: float) -> Float[np.ndarray, "T 3"]:
    """Lengths of the legs along the path, from those at the start [m]."""
    times = dt * np.arange(round(PATH_DURATION / dt) + 1)
    lengths = leg_lengths(manipulator_path(times))
    return lengths - lengths[0]


def reference(dt: float, preview: int) -> Reference:
    """The first leg, from rest to rest."""
    samples = legs(dt)[:, :1]
    padded = np.concatenate([samples, np.repeat(samples[-1:], preview, axis=0)])
    return from_samples(padded, np.ones_like(padded), dt, preview, in_motion=False)


def errors(controller: Controller, leg: Plant) -> tuple[Float[np.ndarray, " T"], Rollout]:
    """Errors of a leg along the path [um], and the run."""
    wanted = reference(leg.dt, controller.preview)
    run = simulate(Quantised(Encoders(leg), LVDT_QUANTUM), controller, wanted)
    output = np.asarray(run.output)[:, 0]
    return 1e6 * (np.asarray(wanted.position)[: output.size, 0] - output), run


def tracking(integral_time: float | None) -> ZeroPhaseTracking:
    """The paper's controller on the corrected model."""
    ahead = zero_phase_filter(closed(servo(FAST), FITTED_GAIN))
    time = np.inf if integral_time is None else integral_time
    return ZeroPhaseTracking(
        ahead=ahead, gain=FITTED_GAIN, sensors=Sensors([0]), dt=FAST, integral_time=time
    )


def integral_runs(
    truths: Iterable[Truth] = TRUTHS,
    times: Iterable[float | None] = INTEGRAL_TIMES,
    friction: float | None = None,
) -> tuple[IntegralRun, ...]:
    """Mean and largest error over the integral time; with a friction [A] as the leg is built."""
    rows = []
    for truth, time in product(truths, times):
        leg = truth.axis(FAST)
        if friction is not None:
            leg = LimitedServo(truth.gain * SERVO_GAIN, truth.pole, friction, FAST)
        size = np.abs(errors(tracking(time), leg)[0])
        rows.append(IntegralRun(truth.name, time, float(size.mean()), float(size.max()), friction))
    return tuple(rows)


class ServoState(NamedTuple):
    """Length [m], its speed [m/s], and the time since the start [s]."""

    position: Float[Array, "1"]
    speed: Float[Array, "1"]
    time: Float[Array, ""]


class LimitedServo(Plant):
    """A velocity servo k / (s (s + p)) with a limited motor current and friction of the ballscrew.

        v' = clip(k u - p v, -h i(t), h i(t)) - f sign(v),   y' = v
    The limit i(t) is printed in section 2; its time counts from the start of the motion. The factor
    h follows from Table 1 (torque constant, lead, inertia). Friction is not printed: f is assumed.
    Without both it is that of `servo_axes` to a trapezoid of the speed over a substep.
    """

    gain: Float[Array, ""] = eqx.field(converter=jnp.asarray)  # k [m/s^2 per unit of control]
    # p [rad/s], by feedback of the speed to the amplifier
    pole: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    friction: Float[Array, ""] = eqx.field(converter=jnp.asarray)  # of the motor [A]
    dt: float = eqx.field(static=True)  # sample period [s]

    def initial_state(self, position: Float[Array, "1"], increment: Float[Array, "1"]):
        """State at the start of the motion."""
        return ServoState(position, increment / self.dt, jnp.zeros(()))

    def step(self, state: ServoState, control: Float[Array, "1"]) -> ServoState:
        """Exact where nothing is limited and nothing rubs; but a trapezoid of the speed."""
        count = round(self.dt / SUBSTEP)
        h = self.dt / count
        left = jnp.exp(-self.pole * h)

        def substep(_, state: ServoState) -> ServoState:
            y, v, t = state
            most = PER_AMPERE * jnp.where(t < CHANGE, FIRST, LATER) * h
            asked = (1 - left) * (self.gain * control / self.pole - v)
            free = v + jnp.clip(asked, -most, most)
            after = jnp.sign(free) * jnp.maximum(
                jnp.abs(free) - PER_AMPERE * self.friction * h, 0.0
            )
            return ServoState(y + h * (v + after) / 2, after, t + h)

        return jax.lax.fori_loop(0, count, substep, state)

    def output(self, state: ServoState) -> Float[Array, "1"]:
        """Length of the leg [m]."""
        return state.position


class PrintedLeastSquares(NormalisedLeastSquares):
    """The same with the forgetting factor of (15) as printed: tr F / tr F(0) is taken for one."""

    @jax.jit
    def update(self, estimate: Estimate, phi: Float[Array, "m q"], y: Float[Array, " m"]):
        """Estimate after one more sample."""
        after, F = super().update(estimate, phi, y), estimate.gain
        n = jnp.maximum(jnp.linalg.norm(phi, axis=-1, keepdims=True), self.floor)
        g = jnp.einsum("mij,mj->mi", F, phi / n)
        drop = jnp.sum(g**2, axis=-1) / (1 + jnp.sum(phi / n * g, axis=-1))
        factor = (jnp.trace(F, axis1=-2, axis2=-1) - drop) / (self.trace - drop)
        return after._replace(gain=after.gain * factor[:, None, None])


def adaptive(
    theta: tuple[float, float], estimator: NormalisedLeastSquares
) -> AdaptiveZeroPhaseTracking:
    """The paper's adaptive controller."""
    gain = placing_gain(servo(SLOW))
    return AdaptiveZeroPhaseTracking(gain, theta, estimator, Sensors([0]), SLOW)


def adaptive_runs(truths: Iterable[Truth] = TRUTHS[:3]) -> tuple[AdaptiveRun, ...]:
    """Runs without adaptation, with our forgetting factor, and with the printed one."""
    few, many = TRACES
    estimators = (
        ("none", NormalisedLeastSquares(few, FLOOR, ADAPTATION_OFF)),
        ("ours", NormalisedLeastSquares(few, FLOOR)),
        ("ours", NormalisedLeastSquares(many, FLOOR)),
        ("printed", PrintedLeastSquares(many, FLOOR)),
    )
    rows = []
    for truth, theta, (rule, estimator) in product(truths, STARTS, estimators):
        error, run = errors(adaptive(theta, estimator), truth.axis(SLOW))
        end, size = run.final_memory.estimate, np.abs(error)
        a, b = map(float, end.theta[0])
        sizes = float(size.mean()), float(size[size.size // 2 :].mean())
        trace = float(np.trace(end.gain[0]))
        start = truth.name, theta, float(estimator.trace), rule
        rows.append(AdaptiveRun(*start, *sizes, (a, b), one_pole_fit(truth), trace))
    return tuple(rows)


def one_pole_fit(truth: Truth) -> tuple[float, float]:
    """a_1 and b_0 that fit a servo's position loop along the path, by least squares."""
    plant = servo(SLOW, truth.gain * SERVO_GAIN, truth.pole)
    loop = closed(plant, placing_gain(servo(SLOW)))
    wanted = 1e3 * legs(SLOW)[:, 0]
    output = np.asarray(lfilter(loop.numerator, loop.denominator, wanted))
    phi = np.stack([-output[:-1], wanted[:-1]], axis=1)
    a, b = np.linalg.lstsq(phi, output[1:])[0]
    return float(a), float(b)
