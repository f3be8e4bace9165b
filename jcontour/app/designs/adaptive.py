"""Controllers that learn while they run: what repeats, run-out, a position loop, an input gain.

They learn in time: frozen as they begin, as margins are found, they are the loops that they begin
with. So a limit on the sensitivity holds for these, and says nothing of what is learned.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jcontour.app.designs import gantry
from jcontour.app.designs.feedforward import (
    CROSSOVERS,
    Plain,
    axes_of,
    first_numbers,
)
from jcontour.app.designs.gains import Gain, GainDesign, Gains
from jcontour.app.designs.lq.first_loop import SENSITIVITY, sensitivity_peaks, straight_windows
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.gantry import GantryMachine
from jcontour.app.machines.linear import LinearMachine
from jcontour.controller import Controller
from jcontour.controllers.feedback.self_tuning import SelfTuning, placed_gains
from jcontour.controllers.feedforward.adaptive_zpetc import AdaptiveZeroPhaseTracking
from jcontour.controllers.feedforward.normalised_least_squares import NormalisedLeastSquares
from jcontour.controllers.learning.repetitive import Repetitive, RepetitiveFilter
from jcontour.controllers.learning.runout import Canceller, RunoutCancelled
from jcontour.controllers.wrappers.motor_kinematics import OfMotors
from jcontour.linear.transformations import with_input_delay
from jcontour.sensors import Sensors, motors
from jcontour.simulation.evaluation import stack_plants
from tuning.parameters import Fixed, Interval

PERIOD = Gain(0.1, "s", Fixed())  # of what repeats: a table at 600 rpm
FREQUENCY = Gain(2 * np.pi * 10, "rad/s", Fixed())  # of its run-out
LEARNED = Gain(0.2, "", Interval(1e-3, 0.9))  # part of the error that a period learns
LEAD = 10  # samples: of the loop's lag what no bandwidth makes too much
QUIET = (1.0, 4.0, 6.0, 4.0, 1.0)  # fourth power of a mean of two: what is fast is forgotten
POLES = (0.975, 0.97)  # of the self-tuning loop, in z: 25 and 30 rad/s at 1 ms
VARIANCE = 0.01  # [1/A^2] some tens of amperes teach the gain; a count of the encoder does not
TRACE = 2.0  # of adaptive zero phase tracking, the paper's
FLOOR = 1e-3  # [m] below which positions are not scaled up, the paper's


class Repeating(Plain):
    """The cascade, and what repeats with a known period learned.

    The period is chosen with the controller and stays: it is a number of samples.
    """

    def __init__(self, machine: LinearMachine, flags: Controlled):
        super().__init__(machine, flags)
        samples = first_numbers({"period": PERIOD}, flags)["period"] / machine.model.dt
        nearest = round(samples)
        self.samples = nearest if abs(samples - nearest) < 1e-6 else samples

    def gains(self) -> dict[str, Gain]:
        """Period, and the part that is learned."""
        return {"period": PERIOD, "learning": LEARNED}

    def build(self, gains: Gains) -> Controller:
        """The cascade with the filter."""
        taps = np.array(QUIET) / np.sum(QUIET)
        learned = RepetitiveFilter(self.samples, gains["learning"], taps, LEAD)
        return Repetitive(super().build(gains), _encoders(self.machine), learned)


class RunOut(Plain):
    """The cascade, and sinusoids of a known frequency that cancel run-out."""

    def __init__(self, machine: LinearMachine, flags: Controlled):
        super().__init__(machine, flags)
        with jax.ensure_compile_time_eval():
            axes = axes_of(with_input_delay(machine.model, self.late))
        self.turn = first_numbers({"frequency": FREQUENCY}, flags)["frequency"] * machine.model.dt
        self.delay = np.exp(-1j * self.turn)
        self.responses = np.array([axis.response(self.delay) for axis in axes])

    def gains(self) -> dict[str, Gain]:
        """Frequency, and the part of the error there that a sample learns."""
        return {"frequency": FREQUENCY, "cancelling": Gain(0.02, "", Interval(1e-4, 0.5))}

    def build(self, gains: Gains) -> Controller:
        """The cascade and the sinusoids; their phase is that of the loop, the mean of the axes."""
        closed = self._closed(gains)
        size = jnp.abs(closed)
        mean = jnp.sum(closed / size.astype(complex))
        phase = jnp.arctan2(jnp.imag(mean), jnp.real(mean))
        canceller = Canceller(self.turn, phase, gains["cancelling"] / jnp.max(size))
        return RunoutCancelled(super().build(gains), _encoders(self.machine), canceller)

    def _closed(self, gains: Gains) -> Complex[Array, " m"]:
        """Response of the position to an added control, the loop closed: G / (1 + G C)."""
        dt, step = self.machine.model.dt, 1 - self.delay
        integral = dt / step / jnp.asarray(gains["integral_time"]).astype(complex)
        speed = jnp.asarray(gains["velocity"]).astype(complex) * (1 + integral)
        C = speed * (jnp.asarray(gains["position"]).astype(complex) + step / dt)
        return jnp.asarray(self.responses) / (1 + self.responses * C)


def _encoders(machine: LinearMachine) -> Sensors:
    return Sensors(range(len(machine.axes)))


def adaptive_zero_phase(
    name: str, line: str, machine: LinearMachine, flags: Controlled
) -> GainDesign:
    """Design of a position loop behind zero phase tracking that learns the loop."""
    gain, turn = _first_loop(machine)
    unit = f"{machine.control_unit}/m"
    gains = {"position_gain": Gain(gain, unit), "trace": Gain(TRACE, "")}

    def build(machine: LinearMachine, values: Gains) -> Controller:
        return _adaptive(machine, values["position_gain"], turn, values["trace"])

    return _design(name, line, machine, gains, build)


def _adaptive(machine: LinearMachine, gain, turn: float, trace) -> AdaptiveZeroPhaseTracking:
    """The loop begins as a lag of `turn` rad per sample; a count teaches nothing."""
    first = np.array([-np.exp(-turn), -np.expm1(-turn)])
    estimator = NormalisedLeastSquares(trace, FLOOR, machine.encoder_resolution)
    sensors, dt = _encoders(machine), machine.model.dt
    smallest = 0.1 * first[1]
    return AdaptiveZeroPhaseTracking(gain, first, estimator, sensors, dt, smallest, machine.holding)


def _first_loop(machine: LinearMachine) -> tuple[np.ndarray, float]:
    """Gains of the fastest position loop of a series that keeps the margin, and its crossover."""
    axes = axes_of(machine.model)
    gains = [1 / np.abs([axis.response(np.exp(-1j * w)) for axis in axes]) for w in CROSSOVERS]
    family = stack_plants(machine.smooth_family())
    peaks = np.asarray(
        sensitivity_peaks(
            lambda gain: _adaptive(machine, gain, 0.1, TRACE),
            jnp.asarray(np.array(gains)),
            family,
            straight_windows(machine, 1),
            machine.doubt,
        )
    )
    kept = np.flatnonzero(peaks <= SENSITIVITY)
    found = int(kept[0]) if kept.size else int(np.argmin(peaks))
    return gains[found], float(CROSSOVERS[found])


def self_tuning(name: str, line: str, machine: GantryMachine, flags: Controlled) -> GainDesign:
    """Design of a self-tuning servo of each motor: its input gain is learned."""
    p, dt = machine.parameters, machine.model.dt
    head, drives = p.head_constant / p.head_mass, 2 * p.drive_constant / p.total_mass
    position, rate = placed_gains(*POLES)
    gains = {"position": Gain(position, ""), "rate": Gain(rate, "")}
    first = float(head + drives) / 2 * dt**2 / 2

    def build(machine: GantryMachine, values: Gains) -> Controller:
        servo = SelfTuning(
            values["position"], values["rate"], motors(3), first, VARIANCE, forgetting=1.0
        )
        return OfMotors(servo, gantry.MOTORS)

    return _design(name, line, machine, gains, build)


def _design(name: str, line: str, machine, gains: dict[str, Gain], build) -> GainDesign:
    start = {key: gain.start for key, gain in gains.items()}
    space = {key: gain.parameter for key, gain in gains.items()}
    preview = build(machine, start).preview
    return GainDesign(name, machine, start, space, preview, "outputs", build, line, gains)
