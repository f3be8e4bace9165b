"""Contouring schemes around the cascade of two flexible axes, built from gains."""

from typing import ClassVar

import numpy as np

from jcontour.app.designs.design import Gains, Needs, picked
from jcontour.app.designs.flexible_axis import AxisCascade
from jcontour.controller import Controller
from jcontour.controllers.contouring.schemes import (
    CommandShaped,
    ConstantCoupling,
    Coupling,
    CrossCoupled,
    CrossGains,
    Precompensated,
    TaskFrame,
    VariableCoupling,
)
from tuning.parameters import Weight


class ContouringScheme(AxisCascade):
    """P-PI cascades of two flexible axes or more, for a contour."""

    needs = Needs(
        "two flexible axes or more, for a contour", "flexible axes", lambda axes: len(axes.axes) > 1
    )


class CrossCoupledCascade(ContouringScheme):
    """P-PI cascades with Koren's cross-coupled control, constant gains.

    The compensator is weak beside the position loops.
    """

    weights = (
        *ContouringScheme.weights,
        Weight("cross", "1/s", start=3.0),
        Weight("cross_integral", "1/s^2", start=3.0),
        Weight("cross_derivative", start=0.01),
    )
    coupling: ClassVar[type[Coupling]] = ConstantCoupling

    def build(self, weights: Gains) -> Controller:
        gains = CrossGains(*picked("cross cross_integral cross_derivative", weights))
        return CrossCoupled(self.cascade(weights), gains, self.coupling())


class VariablyCoupledCascade(CrossCoupledCascade):
    """The same with variable gains (Koren & Lo)."""

    coupling = VariableCoupling


class TaskFrameCascade(ContouringScheme):
    """P-PI cascades, position gains along the path and across it.

    They stand in place of one for both axes.
    """

    weights = (*ContouringScheme.weights, Weight("position", "1/s", start=np.array([30.0, 30.0])))

    def build(self, weights: Gains) -> Controller:
        return TaskFrame(self.cascade(weights))


class PrecompensatedCascade(ContouringScheme):
    """P-PI cascades behind cross-coupled pre-compensation.

    It is far below the bandwidth of the position loops.
    """

    weights = (*ContouringScheme.weights, Weight("precompensation", "1/s", start=1.0))

    def build(self, weights: Gains) -> Controller:
        return Precompensated(self.cascade(weights), weights["precompensation"])


class ShapedCascade(ContouringScheme):
    """P-PI cascades behind cross-coupled position command shaping.

    It takes a tenth of the contour error.
    """

    weights = (*ContouringScheme.weights, Weight("shaping", start=0.1))

    def build(self, weights: Gains) -> Controller:
        return CommandShaped(self.cascade(weights), weights["shaping"])
