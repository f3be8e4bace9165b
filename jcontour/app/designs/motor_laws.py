"""Laws of measured positions and speeds in place of the cascade of every motor."""

import numpy as np

from jcontour.app.designs.any_machine import CascadeDesign
from jcontour.app.designs.design import Gains
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.controllers.feedback.predictive import PredictiveCascade
from jcontour.controllers.feedback.sliding_mode import AdaptiveRobust, DynamicSurface
from tuning.parameters import Fixed, Interval, Weight

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
