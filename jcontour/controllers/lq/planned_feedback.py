"""State feedback whose gains are planned ahead: u = f - F x, without a memory.

A drive that takes a position needs a control u_0 to stand where a run begins, in the state x_0. The
control costs what it differs from that: the law is planned for the run moved to the origin,

    u = u_0 + f - F (x - x_0).
u_0 and x_0 are zero where a drive takes a speed or a force.
"""

import abc
from dataclasses import replace
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from jcontour.controller import Controller, check_preview
from jcontour.linear.plant import AffinePlan, LinearPlant, operating_point
from jcontour.linear.small_products import small_product
from jcontour.motion.references import Reference


class PlannedFeedback(Controller):
    """Base of the LQ controllers: `prepare` makes F and f of every step, the rest is here."""

    follows_its_plan: ClassVar[bool] = True  # a kernel may compute the run

    def initial_memory(self, reference: Reference) -> None:
        """None: the controller has no memory."""
        return None

    def step(
        self, memory: None, plan: AffinePlan, measurement: Float[Array, " n"]
    ) -> tuple[None, Float[Array, " p"]]:
        """Control u = f - F x."""
        return None, plan.f - small_product(plan.F, measurement)


class ModelFeedback(PlannedFeedback):
    """Base of those with one model: their law is planned as if the run began at the origin."""

    model: eqx.AbstractVar[LinearPlant]

    @abc.abstractmethod
    def gain_schedule(self, reference: Reference) -> AffinePlan:
        """F and f of every step, for a reference that counts from the operating point."""

    def prepare(self, reference: Reference) -> AffinePlan:
        """Gain schedule of every step of the reference.

        Raises:
            ValueError: the reference looks less far ahead than the controller.
        """
        check_preview(self, reference)
        at = operating_point(self.model, reference.position[0])
        moved = replace(reference, position=reference.position - at.position[None])
        return self.gain_schedule(moved).at(at)
