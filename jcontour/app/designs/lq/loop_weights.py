"""Weights of a loop of LQ controller and observer, and their space."""

from typing import Any, NamedTuple

from jcontour.controllers.lq.contouring_lq import LQWeights
from tuning.parameters import Fixed, Parameter, Positive


class LoopWeights(NamedTuple):
    """Weights of an LQ controller and of its observer.

    Attributes:
        alpha, beta, rho, stage: as `LQWeights` has them.
        control_noise: standard deviation of the noise that the observer assumes on every control;
            None without an observer.
        drift: that of the change per sample of a constant disturbance of the controls; None for
            observers that estimate none.
    """

    alpha: Any
    beta: Any
    rho: Any
    stage: Any = None
    control_noise: Any = None
    drift: Any = None

    @property
    def cost(self) -> LQWeights:
        """Weights of the controller."""
        return LQWeights(self.alpha, self.beta, self.rho, self.stage)


class LoopSpace(NamedTuple):
    """Space of `LoopWeights`; what a loop does not have stays None."""

    alpha: Parameter = Positive()
    beta: Parameter = Positive()
    # only alpha/rho and beta/rho matter: with rho free one direction of the weights is flat
    rho: Parameter = Fixed()
    stage: Parameter | None = None
    control_noise: Parameter | None = None
    drift: Parameter | None = None
