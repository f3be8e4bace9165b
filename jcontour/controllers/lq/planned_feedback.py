"""State feedback whose gains are planned ahead: u = f - F x, without a memory."""

from jaxtyping import Array, Float

from jcontour.controller import Controller
from jcontour.linear.plant import AffinePlan
from jcontour.linear.small_products import small_product
from jcontour.motion.references import Reference


class PlannedFeedback(Controller):
    """Base of the LQ controllers: `prepare` makes F and f of every step, the rest is here."""

    def initial_memory(self, reference: Reference) -> None:
        """None: the controller has no memory."""
        return None

    def step(
        self, memory: None, plan: AffinePlan, measurement: Float[Array, " n"]
    ) -> tuple[None, Float[Array, " p"]]:
        """Control u = f - F x."""
        return None, plan.f - small_product(plan.F, measurement)
