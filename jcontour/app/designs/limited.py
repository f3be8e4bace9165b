"""Loops that keep the limits of a machine, whatever the reference is."""

from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from jcontour.app.designs.any_machine import ANY, Quadratic, StateDesign
from jcontour.app.designs.design import Gains, Needs
from jcontour.app.designs.receding_horizon import TERMINALS, LQDesign
from jcontour.app.files import run_folder
from jcontour.app.jobs.replays import Scenarios
from jcontour.controller import Controller
from jcontour.controllers.feedback.governor import (
    LoopLimits,
    ScalarGovernor,
    VectorGovernor,
    enough_steps,
    governed_loop,
)
from jcontour.controllers.feedback.state_feedback import lq_gain, moving_target
from jcontour.controllers.observers.kalman import OffsetFreeWithLoad
from jcontour.mpc.tracking.artificial_reference import ArtificialReferenceMPC
from jcontour.mpc.tracking.constrained_lq import ConstrainedLQ
from jcontour.mpc.tracking.limits import Limits
from tuning.parameters import Positive, Weight

SHARE = 0.9  # of the limits for the law, the rest for the load that its observer cancels
PULL = 10.0  # of the artificial reference, over the weight on a state off by as much
UNKNOWN = 0.03  # of speed and acceleration
SPARE = 2  # the rows look as much further ahead: weights may make the loop slower


class ScalarGoverned(StateDesign):
    """Linear-quadratic loop behind a scalar reference governor, observer of state and load."""

    needs = Needs(
        f"limits of the controls: {ANY.words}",
        also=lambda machine: ANY.met_by(machine) and machine.limits.control is not None,
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
    """Tracking MPC with an artificial reference (Limon & Alvarado), same observer."""

    weights = (Weight("pull", "m-2", cost=True),)
    reads = ("preview",)

    def starts(self) -> Gains:
        start = super().starts()
        quadratic = self.quadratic(start)
        rest = np.asarray(moving_target(quadratic.model).state)  # of a metre
        return {**start, "pull": PULL * np.max(np.diag(rest.T @ np.asarray(quadratic.Q) @ rest))}

    def first_preview(self, first: Gains) -> int:
        return self.flags.horizon(self.machine.model.dt)

    def law(self, quadratic: Quadratic, gains: Gains) -> Controller:
        limits, horizon = self.limits(quadratic), self.flags.horizon(self.machine.model.dt)
        return ArtificialReferenceMPC(*quadratic, gains["pull"], limits, horizon, self.steps)


class CostWeight(Positive):
    """Weight on errors, at most a hundred thousand times more or less than at the start.

    Control is then as good as free: ten times more changes the gains by 0.14 % or less. A plan
    within limits bears any weight, so that nothing would stop the search where margins do not.
    """

    reach: ClassVar[float] = float(np.log(1e5))


class ConstrainedLQDesign(LQDesign):
    """Contouring LQ that keeps to the machine's limits: a quadratic program at every sample.

    Limits on speed and acceleration are divided by the family's largest gain, and kept 3 % below.
    It is behind an observer of state and load.
    """

    needs = Needs(
        "a machine given by A, B, C that states limits",
        "linear",
        lambda machine: any(limit is not None for limit in machine.limits),
    )
    weights = (
        *LQDesign.weights,
        Weight("alpha", "m-2", CostWeight(), cost=True),
        Weight("beta", "m-2", CostWeight(), cost=True),
    )
    keeps_limits = True
    law = "receding-horizon LQ contouring under limits"

    def build(self, weights: Gains) -> Controller:
        model, terminal = self.model, TERMINALS[self.terminal]
        # A machine with larger gains moves by as much more than the plan of the nominal one says,
        # and a little is left for what no plan knows: late controls, loads not yet observed
        stated, most = self.machine.limits, (1.0 + self.machine.uncertainty.gain) * (1.0 + UNKNOWN)
        speed, acceleration = (
            None if limit is None else limit / most for limit in (stated.speed, stated.acceleration)
        )
        limits = Limits.within(
            speed=speed,
            acceleration=acceleration,
            control=stated.control,
            increment=stated.increment,
        )
        loop = self.loop
        inner = ConstrainedLQ(model, loop.cost(weights), self.horizon, limits, terminal)
        return OffsetFreeWithLoad(inner, model, loop.gain(weights), model.C)

    @property
    def files(self) -> dict[str, str]:
        """The observer; there is no gain schedule, a quadratic program is solved instead."""
        return {"observer.json": "the observer's equations and matrices; u is the program's answer"}

    def save(self, controller: Controller, scenarios: Scenarios, folder: Path) -> None:
        assert isinstance(controller, OffsetFreeWithLoad)
        run_folder.write_json(folder / "observer.json", self.observer_file(controller.gain))
