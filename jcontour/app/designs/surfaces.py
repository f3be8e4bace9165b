"""Laws of measured positions and speeds in place of the cascade of every motor."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from jcontour.app.designs.any_machine import CascadeDesign
from jcontour.app.designs.design import Gains
from jcontour.controller import Controller
from jcontour.controllers.feedback.adaptive_robust import AdaptiveRobust
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.controllers.feedback.dynamic_surface import DynamicSurface
from jcontour.controllers.feedback.predictive_cascade import PredictiveCascade
from tuning.parameters import Fixed, Interval, Weight

FILTER = 5.0  # samples of the filter in a dynamic surface
LAGS, SHORTEST, LONGEST = 3.0, 20, 100  # horizon in lags of the velocity loop, and in samples
PERIOD = 0.1  # [s] of a table at 600 rpm, as in repetitive control


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

    The lag begins as inertia over velocity gain. A change of the command by 1 m/s weighs as much as
    what it moves within the horizon.
    """

    weights = (Weight("lag", "s"), Weight("effort", "s^2", cost=True))
    harmonics: ClassVar[int] = 0

    def starts(self) -> Gains:
        loops = super().starts()
        lag = float(np.mean(np.asarray(loops["inertia"]) / np.asarray(loops["velocity"])))
        dt = self.machine.model.dt
        self.horizon = int(np.clip(np.ceil(LAGS * lag / dt), SHORTEST, LONGEST))
        return {**loops, "lag": lag, "effort": self.horizon**3 * dt**2 / 3}

    def law(self, cascade: Cascade, gains: Gains) -> Controller:
        period = gains.get("period", jnp.inf)
        turn = 2 * np.pi * cascade.dt / jnp.asarray(period, float)
        return PredictiveCascade(
            cascade, gains["lag"], gains["effort"], self.horizon, turn, self.harmonics
        )


class PredictiveRepetitiveCascade(GeneralisedPredictiveCascade):
    """The same with a period that leaves no error in its first harmonic (Wang)."""

    weights = (*GeneralisedPredictiveCascade.weights, Weight("period", "s", Fixed(), PERIOD))
    harmonics = 1
