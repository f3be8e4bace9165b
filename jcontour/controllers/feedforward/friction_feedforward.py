"""Control that overcomes the dry friction of the planned motion, beside any controller.

    u = u_c + k_c sign(v_r),   v_r(k) = (r(k+1) - r(k)) / T

`InverseFeedforward` knows a linear machine: what its feedback feeds forward itself, dry friction
included, is subtracted along the nominal motion. So dry friction has a term of its own, outside.
It knows the size of the friction in motion only: no sticking while the reference rests, no fall
with speed (Stribeck), no cogging, no sample by which the drive is late. That is left to the
feedback.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, Wrapper, check_limit, checked_gain
from jcontour.motion.references import Reference


class FrictionPlan(NamedTuple):
    """Plan of the wrapped controller, and the control against friction."""

    inner: Any
    friction: Float[Array, "*T p"]


class FrictionFeedforward(Wrapper):
    """Any controller, and the control that dry friction needs; control i drives axis i.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.motion.references import from_samples
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), dt=1e-3)
    >>> path = jnp.array([[0.0], [1e-4], [1e-4], [0.0]])
    >>> reference = from_samples(path, jnp.ones((4, 1)), dt=1e-3, preview=1)
    >>> FrictionFeedforward(cascade, 0.7).prepare(reference).friction.ravel().tolist()
    [0.7, 0.0, -0.7]

    Args:
        controller: the wrapped controller.
        coulomb: k_c, in the unit of the control: one number, or one for each axis.
        limit: of the whole control, +-: one number or one for each; none when infinite.

    Raises:
        ValueError: the gain is negative or not finite, or a limit is not above zero.
    """

    controller: Controller
    coulomb: Float[Array, "*p"]
    limit: Float[Array, "*p"]

    def __init__(
        self,
        controller: Controller,
        coulomb: ArrayLike | Sequence[float],
        limit: ArrayLike | Sequence[float] = np.inf,
    ):
        check_limit(limit)
        self.controller, self.coulomb = controller, checked_gain("coulomb", coulomb)
        self.limit = jnp.asarray(limit, float)

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """That of the wrapped controller, at least the next sample."""
        return max(self.controller.preview, 1)

    def prepare(self, reference: Reference) -> FrictionPlan:
        """Plan of the wrapped controller, and the control against friction."""
        steps = reference.steps
        ahead = jnp.diff(reference.position[: steps + 1], axis=0)
        friction = jnp.atleast_1d(self.coulomb)[None] * jnp.sign(ahead)
        return FrictionPlan(self.controller.prepare(reference), friction)

    def initial_memory(self, reference: Reference) -> Any:
        """Memory of the wrapped controller."""
        return self.controller.initial_memory(reference)

    def step(
        self, memory: Any, plan: FrictionPlan, measurement: Any
    ) -> tuple[Any, Float[Array, " p"]]:
        """Next memory, and the whole control within its limit."""
        memory, control = self.controller.step(memory, plan.inner, measurement)
        return memory, jnp.clip(control + plan.friction, -self.limit, self.limit)
