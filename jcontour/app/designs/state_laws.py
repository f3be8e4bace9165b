"""Laws of the state of any machine: sliding modes, and what repeats with a period."""

import jax.numpy as jnp
import numpy as np

from jcontour.app.designs.any_machine import Quadratic, StateDesign
from jcontour.app.designs.design import Gains, picked
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.controllers.feedback.predictive import PredictiveRepetitive
from jcontour.controllers.feedback.sliding_mode import (
    BoundaryLayer,
    Reaching,
    SlidingMode,
    SuperTwisting,
    riccati_surface,
)
from tuning.parameters import Fixed, Interval, Weight

PERIOD = 0.1  # [s] of a table at 600 rpm, as in repetitive control
MEMORY = 50.0  # samples after which what repeats is as heavy as the error itself
RATE = 0.05  # part of s that goes in a sample: 50 rad/s at 1 ms


def _load(machine: Machine) -> float:
    """Load that the switched part is as large as: what the observer takes for usual."""
    return machine.control_noise if isinstance(machine, LinearMachine) else 0.1


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
