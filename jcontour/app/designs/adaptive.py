"""Controllers that learn while they run: what repeats, run-out, a position loop.

They learn in time: frozen as they begin, as margins are found, they are the loops that they begin
with. So a limit on the sensitivity holds for these, and says nothing of what is learned.
"""

from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jcontour.app.designs.design import Gains, LinearDesign
from jcontour.app.designs.first_loop import fastest
from jcontour.app.designs.simple_loops import CROSSOVERS, LinearCascade, axes_of
from jcontour.app.machines.linear import LinearMachine
from jcontour.controller import Controller
from jcontour.controllers.feedforward.adaptive_zpetc import (
    AdaptiveZeroPhaseTracking,
    NormalisedLeastSquares,
)
from jcontour.controllers.learning.repetitive import (
    Canceller,
    Repetitive,
    RepetitiveFilter,
    RunoutCancelled,
)
from jcontour.linear.transformations import with_input_delay
from jcontour.sensors import Sensors
from tuning.parameters import Fixed, Interval, Weight

LEAD = 10  # samples: of the loop's lag what no bandwidth makes too much
QUIET = (1.0, 4.0, 6.0, 4.0, 1.0)  # fourth power of a mean of two: what is fast is forgotten
TRACE = 2.0  # of adaptive zero phase tracking, the paper's
FLOOR = 1e-3  # [m] below which positions are not scaled up, the paper's


class RepetitiveCascade(LinearCascade):
    """Cascade, and what repeats with a known period learned (Tomizuka, Tsao & Chew).

    The period, at first that of a table at 600 rpm, is chosen with the controller and stays: it is
    a number of samples.
    """

    weights = (
        *LinearCascade.weights,
        Weight("period", "s", Fixed(), 0.1),
        Weight("learning", range=Interval(1e-3, 0.9), start=0.2),  # part of the error, a period
    )
    learns = True

    @cached_property
    def samples(self) -> float:
        """Samples of the period."""
        samples = float(self.start["period"]) / self.machine.model.dt
        nearest = round(samples)
        return nearest if abs(samples - nearest) < 1e-6 else samples

    def build(self, weights: Gains) -> Controller:
        taps = np.array(QUIET) / np.sum(QUIET)
        learned = RepetitiveFilter(self.samples, weights["learning"], taps, LEAD)
        return Repetitive(super().build(weights), _encoders(self.machine), learned)


class RunOutCascade(LinearCascade):
    """Cascade, and sinusoids of a known frequency that cancel.

    The phase of the sinusoids is that of the loop, the mean of the axes.
    """

    weights = (
        *LinearCascade.weights,
        Weight("frequency", "rad/s", Fixed(), 2 * np.pi * 10),  # of a table at 600 rpm
        Weight("cancelling", range=Interval(1e-4, 0.5), start=0.02),  # part of the error, a sample
    )
    reads = ("model_delay",)
    learns = True

    @cached_property
    def turn(self) -> float:
        """Angle of the run-out in a sample [rad]."""
        return float(self.start["frequency"]) * self.machine.model.dt

    @cached_property
    def responses(self) -> np.ndarray:
        """Response of every axis at that frequency."""
        with jax.ensure_compile_time_eval():
            axes = axes_of(with_input_delay(self.machine.model, self.late))
        return np.array([axis.response(np.exp(-1j * self.turn)) for axis in axes])

    def build(self, weights: Gains) -> Controller:
        closed = self._closed(weights)
        size = jnp.abs(closed)
        mean = jnp.sum(closed / size.astype(complex))
        phase = jnp.arctan2(jnp.imag(mean), jnp.real(mean))
        canceller = Canceller(self.turn, phase, weights["cancelling"] / jnp.max(size))
        return RunoutCancelled(super().build(weights), _encoders(self.machine), canceller)

    def _closed(self, gains: Gains) -> Complex[Array, " m"]:
        """Response of the position to an added control, the loop closed: G / (1 + G C)."""
        dt, step = self.machine.model.dt, 1 - np.exp(-1j * self.turn)
        integral = dt / step / jnp.asarray(gains["integral_time"]).astype(complex)
        speed = jnp.asarray(gains["velocity"]).astype(complex) * (1 + integral)
        C = speed * (jnp.asarray(gains["position"]).astype(complex) + step / dt)
        return jnp.asarray(self.responses) / (1 + self.responses * C)


class AdaptiveZeroPhase(LinearDesign):
    """Position loop behind zero phase tracking that learns the loop (Smith & Lee).

    It begins as the fastest position loop of a series that keeps the margin.
    """

    weights = (Weight("position_gain", "{control} per m"), Weight("trace", start=TRACE))
    learns = True

    @cached_property
    def first_loop(self) -> tuple[np.ndarray, float]:
        """Gains of the first loop, and its crossover."""
        machine, axes = self.machine, axes_of(self.machine.model)
        gains = [1 / np.abs([axis.response(np.exp(-1j * w)) for axis in axes]) for w in CROSSOVERS]
        index = fastest(machine, gains, lambda gain: _adaptive(machine, gain, 0.1, TRACE))
        return gains[index], float(CROSSOVERS[index])

    def starts(self) -> Gains:
        return {"position_gain": self.first_loop[0]}

    def build(self, weights: Gains) -> Controller:
        return _adaptive(
            self.machine, weights["position_gain"], self.first_loop[1], weights["trace"]
        )


def _encoders(machine: LinearMachine) -> Sensors:
    return Sensors(range(len(machine.axes)))


def _adaptive(machine: LinearMachine, gain, turn: float, trace) -> AdaptiveZeroPhaseTracking:
    """The loop begins as a lag of `turn` rad per sample; a count teaches nothing."""
    first = np.array([-np.exp(-turn), -np.expm1(-turn)])
    estimator = NormalisedLeastSquares(trace, FLOOR, machine.encoder_resolution)
    sensors, dt = _encoders(machine), machine.model.dt
    smallest = 0.1 * first[1]
    return AdaptiveZeroPhaseTracking(gain, first, estimator, sensors, dt, smallest, machine.holding)
