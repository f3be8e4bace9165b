"""Loops that keep the limits of their controls, whatever the reference is."""

from functools import cached_property
from typing import ClassVar

import numpy as np

from jcontour.app.designs.any_machine import ANY, Quadratic, StateDesign
from jcontour.app.designs.design import Gains, Needs
from jcontour.app.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.controllers.feedback.governor import (
    LoopLimits,
    ScalarGovernor,
    VectorGovernor,
    enough_steps,
    governed_loop,
)
from jcontour.controllers.feedback.state_feedback import lq_gain, moving_target
from jcontour.mpc.tracking.artificial_reference import ArtificialReferenceMPC
from tuning.parameters import Weight

SHARE = 0.9  # of the limits for the law, the rest for the load that its observer cancels
PULL = 10.0  # of the artificial reference, over the weight on a state off by as much
SPARE = 2  # the rows look as much further ahead: weights may make the loop slower


class ScalarGoverned(StateDesign):
    """Linear-quadratic loop behind a scalar reference governor, observer of state and load."""

    needs = Needs(
        f"limits of the controls: {ANY.words}",
        Machine,
        lambda machine: ANY.also(machine) and machine.limits.control is not None,
    )
    governor: ClassVar[type[ScalarGovernor | VectorGovernor]] = ScalarGovernor

    def limits(self, quadratic: Quadratic) -> LoopLimits:
        """Limits of the controls of the law."""
        assert self.machine.limits.control is not None
        return LoopLimits.of(quadratic.model, SHARE * np.min(self.machine.limits.control))

    @cached_property
    def steps(self) -> int:
        """Samples that the rows look ahead, enough for the first weights."""
        quadratic = self.quadratic(self.observed.start)
        limits = self.limits(quadratic)
        return SPARE * enough_steps(quadratic.model, lq_gain(*quadratic), limits)

    def law(self, quadratic: Quadratic, gains: Gains) -> Controller:
        gain, limits = lq_gain(*quadratic), self.limits(quadratic)
        loop = governed_loop(quadratic.model, gain, limits, self.steps)
        return self.governor(loop)


class VectorGoverned(ScalarGoverned):
    """The same behind a command governor: every axis comes as near as it can."""

    governor = VectorGovernor


class ArtificialReferenceDesign(ScalarGoverned):
    """Tracking MPC with an artificial reference (Limon & Alvarado), observer of state and load."""

    weights = (Weight("pull", "m-2", cost=True),)
    reads = ("preview",)

    def starts(self) -> Gains:
        start = super().starts()
        quadratic = self.quadratic(start)
        rest = np.asarray(moving_target(quadratic.model).state)  # of a metre
        return {**start, "pull": PULL * np.max(np.diag(rest.T @ np.asarray(quadratic.Q) @ rest))}

    def first_preview(self, first: Gains) -> int:
        return self.flags.preview

    def law(self, quadratic: Quadratic, gains: Gains) -> Controller:
        limits, horizon = self.limits(quadratic), self.flags.preview
        return ArtificialReferenceMPC(*quadratic, gains["pull"], limits, horizon, self.steps)
