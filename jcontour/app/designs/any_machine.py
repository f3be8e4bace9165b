"""Laws for any machine of the catalogue, linear, flexible or a gantry, as the commands see them.

A law of the state is fed by the observer of the machine's own LQ controller, which finds the load,
too. A law of positions and speeds stands where the cascade of each motor stands. Its weights are
those of that controller and some of its own. Both Y drives of a gantry share one control of a law
of the state.
"""

import abc
from functools import cached_property
from pkgutil import resolve_name
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.designs.design import Design, Gains, Needs, picked
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.controllers.feedback.hinf_feedback import (
    Generalised,
    HInfinityFeedback,
    MixedWeights,
    central_controller,
    gain_at,
    least_gamma,
    mixed_sensitivity,
)
from jcontour.controllers.feedback.predictive import PredictiveCascade, PredictiveRepetitive
from jcontour.controllers.feedback.sliding_mode import (
    AdaptiveRobust,
    BoundaryLayer,
    DynamicSurface,
    Reaching,
    SlidingMode,
    SuperTwisting,
    riccati_surface,
)
from jcontour.controllers.wrappers.adapters import OfMotors, SharedControls, SpeedByDifference
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from tuning.parameters import Fixed, Interval, Weight, Weights

Matrix = Float[Array, "n n"]


class Quadratic(NamedTuple):
    """Model of a law of the state, and the weights Q and R of its quadratic cost."""

    model: LinearPlant
    Q: Matrix
    R: Matrix


ANY = Needs(
    "a machine given by A, B, C, flexible axes or a gantry",
    also=lambda machine: bool(machine.observed and machine.cascade),
)


def with_shares(model: LinearPlant, shares: np.ndarray) -> LinearPlant:
    """Model with the controls v of u = D v; itself where each drive has its own."""
    if shares.shape[0] == shares.shape[1]:
        return model
    return LinearPlant(model.A, model.B @ shares, model.C, model.dt, motion=model.motion)


def shared_out(law: Controller, shares: np.ndarray) -> Controller:
    """The law with its controls shared out to the drives."""
    return law if shares.shape[0] == shares.shape[1] else SharedControls(law, shares)


class StateDesign(Design[Machine]):
    """A law of the state of the model, behind the observer of state and load."""

    needs = ANY

    def __init__(self, name: str, machine: Machine, flags: Controlled):
        self.observed: Design = resolve_name(machine.observed)(name, machine, flags)
        self.weights = (*self.observed.weights, *self.weights)
        late = [flag for flag in self.observed.reads if flag == "model_delay"]
        self.reads = (*self.reads, *late)
        super().__init__(name, machine, flags)

    @abc.abstractmethod
    def law(self, quadratic: Quadratic, gains: Gains) -> Controller:
        """The law, fed the state of the model."""

    def starts(self) -> Gains:
        return self.observed.start

    def tunable(self) -> "StateDesign":
        """Behind the observer that is tuned, with its start."""
        observed = self.observed.tunable()
        return self.replaced(observed=observed, start=self.start | observed.start)

    def settings(self) -> dict[str, Any]:
        return {**self.observed.settings(), "terminal": None, **super().settings()}

    def quadratic(self, weights: Weights) -> Quadratic:
        """Model of the law and its cost."""
        shares = self.machine.shares
        R = weights.get("rho", 1.0) * jnp.asarray(shares.T @ shares)
        Q = self.observed.state_cost(self.model, weights)
        return Quadratic(with_shares(self.model, shares), Q, R)

    @property
    def model(self) -> LinearPlant:
        """Model of the observer."""
        return getattr(self.observed, "model", self.machine.model)

    def build(self, weights: Weights) -> Controller:
        observer: Any = self.observed.build(weights)
        law = shared_out(self.law(self.quadratic(weights), weights), self.machine.shares)
        return eqx.tree_at(lambda one: one.controller, observer, law)


class CascadeDesign(Design[Machine]):
    """A law in place of the cascade of every motor, with its gains and its feedforward."""

    needs = ANY

    def __init__(self, name: str, machine: Machine, flags: Controlled):
        self.loops: Design = resolve_name(machine.cascade)(name, machine, flags)
        self.weights = (*self.loops.weights, *self.weights)
        super().__init__(name, machine, flags)

    @abc.abstractmethod
    def law(self, cascade: Cascade, gains: Gains) -> Controller:
        """The law, from the cascade of the motors."""

    def starts(self) -> Gains:
        return self.loops.start

    def build(self, weights: Weights) -> Controller:
        loops = self.loops.build({name: weights[name] for name in self.loops.first})
        if isinstance(loops, Cascade):
            return self.law(loops, weights)
        assert isinstance(loops, SpeedByDifference | OfMotors)
        assert isinstance(loops.controller, Cascade)
        return eqx.tree_at(lambda one: one.controller, loops, self.law(loops.controller, weights))


PERIOD = 0.1  # [s] of a table at 600 rpm, as in repetitive control
MEMORY = 50.0  # samples after which what repeats is as heavy as the error itself
RATE = 0.05  # part of s that goes in a sample: 50 rad/s at 1 ms


def _load(machine: Machine) -> float:
    """Load that the switched part is as large as: what the observer takes for usual."""
    return 0.1 if machine.linear is None else machine.linear.control_noise


REACHING = (
    Weight("rate", range=Interval(1e-3, 0.9), start=RATE),
    Weight("size", "{control}", start=_load),
    Weight("width", "{control}", start=lambda machine: _load(machine) / RATE),
)


class BoundaryLayerSliding(StateDesign):
    """Sliding mode control with a boundary layer, observer of state and load."""

    weights = REACHING

    def law(self, quadratic: Quadratic, gains: Gains) -> Controller:
        surface, _ = riccati_surface(*quadratic)
        return SlidingMode(quadratic.model, surface, self.reaching(gains))

    def reaching(self, gains: Gains) -> Reaching:
        """Law by which the surface is reached."""
        return BoundaryLayer(*picked("rate size width", gains))


class IntegralSliding(BoundaryLayerSliding):
    """Sliding mode control on an integral surface, poles of the LQ regulator, same observer."""

    def law(self, quadratic: Quadratic, gains: Gains) -> Controller:
        surface, gain = riccati_surface(*quadratic)
        return SlidingMode(quadratic.model, surface, self.reaching(gains), gain)


class SuperTwistingSliding(BoundaryLayerSliding):
    """Super-twisting sliding mode control, observer of state and load."""

    weights = (
        Weight("root", "({control})^0.5", start=lambda machine: RATE * jnp.sqrt(_load(machine))),
        Weight("twist", "{control} per sample", start=lambda machine: RATE**2 * _load(machine)),
    )

    def reaching(self, gains: Gains) -> Reaching:
        return SuperTwisting(*picked("root twist", gains))


class RepeatedRegulator(StateDesign):
    """Predictive repetitive control, observer of state and load: a period leaves no error."""

    weights = (
        Weight("repetition", cost=True),
        Weight("period", "s", Fixed(), PERIOD),
    )

    def starts(self) -> Gains:
        start = super().starts()
        heaviest = np.max(np.diag(np.asarray(self.quadratic(start).Q)))
        return {**start, "repetition": heaviest / MEMORY**2}

    def law(self, quadratic: Quadratic, gains: Gains) -> Controller:
        turn = 2 * np.pi * quadratic.model.dt / jnp.asarray(gains["period"], float)
        return PredictiveRepetitive(*quadratic, gains["repetition"], turn)


FILTER = 5.0  # samples of the filter in a dynamic surface
HORIZON = 100  # [samples] some lags of a velocity loop: a shorter one is not stable behind a PI


class DynamicSurfaceLoops(CascadeDesign):
    """Dynamic surface control of each motor, gains and feedforward of the cascade."""

    weights = (Weight("lag", "s", start=lambda machine: FILTER * machine.model.dt),)

    def law(self, cascade: Cascade, gains: Gains) -> Controller:
        return DynamicSurface(cascade, gains["lag"])


class AdaptiveRobustLoops(CascadeDesign):
    """Adaptive robust control of each motor (Yao & Tomizuka), desired compensation."""

    weights = (
        Weight("adaptation", "1/s", start=5.0),
        Weight("share", range=Interval(1e-3, 1.0), start=0.3),
        Weight("load", "{control}", Fixed()),
    )
    learns = True

    def starts(self) -> Gains:
        limit = self.machine.limits.control
        return {**super().starts(), "load": 0.3 * (10.0 if limit is None else np.min(limit))}

    def law(self, cascade: Cascade, gains: Gains) -> Controller:
        return AdaptiveRobust(cascade, gains["adaptation"], gains["share"], gains["load"])


class GeneralisedPredictiveCascade(CascadeDesign):
    """Generalised predictive position loops around the velocity loops of the cascade.

    The lag begins as inertia over what slows the speed. A change of the command by 1 m/s weighs as
    much as ten times what it moves within the horizon.
    """

    weights = (Weight("lag", "s"), Weight("effort", "s^2", cost=True))

    def starts(self) -> Gains:
        loops = super().starts()
        slowed = np.asarray(loops["velocity"]) + np.asarray(loops["viscous"])
        lag = float(np.mean(np.asarray(loops["inertia"]) / slowed))
        dt = self.machine.model.dt
        return {**loops, "lag": lag, "effort": 10 * HORIZON**3 * dt**2 / 3}

    def law(self, cascade: Cascade, gains: Gains) -> Controller:
        return PredictiveCascade(cascade, gains["lag"], gains["effort"], HORIZON)


BANDWIDTH = 0.03  # [rad per sample]: 30 rad/s at 1 ms
ABOVE = 1.1  # level over the least one: near that the gains are large and buy nothing


class MixedSensitivity(Design[Machine]):
    """H-infinity feedback by mixed sensitivity, its target in steady motion.

    The level begins a tenth above the least that the first weights allow. The model predicts over
    the middle of the unknown delay, rounded up.
    """

    needs = ANY
    weights = (
        Weight("bandwidth", "rad/s", start=lambda machine: BANDWIDTH / machine.model.dt),
        Weight("peak", start=1.7),
        Weight("effort", start=0.1),
        Weight("load", start=0.1),
        Weight("level"),
    )
    reads = ("model_delay",)

    def starts(self) -> Gains:
        first = {one.name: one.start for one in self.weights if one.start is not None}
        first["bandwidth"] = BANDWIDTH / self.machine.model.dt
        return {"level": ABOVE * least_gamma(self.plant(first))}

    @cached_property
    def model(self) -> LinearPlant:
        """Model with the delay, its controls shared by the drives of an axis."""
        most = self.machine.unknown_delay
        late = self.model_delay(most, (most + 1) // 2)
        with jax.ensure_compile_time_eval():
            return with_shares(with_input_delay(self.machine.model, late), self.machine.shares)

    @cached_property
    def read(self) -> np.ndarray:
        """(q, r) positions in the measurement, of an axis the mean of its drives."""
        together = np.linalg.pinv(self.machine.shares)
        return np.pad(together, [(0, 0), (0, len(self.machine.sensed) - together.shape[1])])

    @cached_property
    def measured(self) -> np.ndarray:
        """C (q, n) of these positions."""
        if self.machine.linear is not None:
            return np.asarray(self.model.C)
        together = np.linalg.pinv(self.machine.shares)
        return together @ np.eye(together.shape[1], self.model.states)

    @cached_property
    def gain(self) -> float:
        """Gain of the machine at the first bandwidth: a unit, not tuned."""
        return gain_at(self.model, self.measured, BANDWIDTH / self.machine.model.dt)

    def plant(self, gains: Gains) -> Generalised:
        """Generalised plant of the weights."""
        weights = MixedWeights(*picked("bandwidth peak effort load", gains))
        return mixed_sensitivity(self.model, self.measured, weights, self.gain)

    def build(self, weights: Gains) -> Controller:
        law, _ = central_controller(self.plant(weights), jnp.asarray(weights["level"], float))
        limit = self.machine.limits.control
        bound = np.inf if limit is None else np.min(limit)
        feedback = HInfinityFeedback(self.model, self.read, self.measured, law, self.gain, bound)
        return shared_out(feedback, self.machine.shares)
