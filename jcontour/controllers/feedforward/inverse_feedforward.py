"""Feedforward in front of any feedback: the control of a nominal motion, and feedback on the rest.

    u(k) = u_n(k) + [C(y(k)) - C(y_n(k))],    u_n = F(lambda) r(k + N_p),   y_n = P u_n
C is the feedback with its own reference and memory, run once on the machine and once on the
nominal machine P. Of a linear feedback this is the loop of Alter & Tsao,

    u = C_fb (r_p - y) + C_ff r_p   with   C_ff = F - C_fb,
whatever the feedback feeds forward itself. The nominal motion depends on the reference only: it is
computed before the run. It has acted on the preview already when the run starts; the machine has
not, and the feedback removes the difference.

The dry friction of the planned motion is overcome beside any controller:

    u = u_c + f(k),   f(k) = clip(k_c sign(v_r(k + d)), f(k-1) - s, f(k-1) + s),
    v_r(k) = (r(k+1) - r(k)) / T

d samples pass until a control moves an axis, and half of what a reversal takes at the slew rate s:
a jump by twice the friction would shake what the control drives.

`InverseFeedforward` knows a linear machine: what its feedback feeds forward itself, dry friction
included, is subtracted along the nominal motion. So dry friction has a term of its own, outside.
It knows the size of the friction in motion only: no sticking while the reference rests, no fall
with speed (Stribeck), no cogging. That is left to the feedback.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour._arrays import check_signs
from jcontour.controller import Controller, Plan, Wrapper, check_limit, check_preview, numbers
from jcontour.controllers.feedback.cascade import direction
from jcontour.controllers.feedforward.zpetc import PreviewFilter
from jcontour.motion.references import Reference
from jcontour.plant import Plant


class InversePlan(NamedTuple):
    """Plan of the feedback, and what is added to its control."""

    inner: Any
    ahead: Float[Array, "*T p"]


class InverseFeedforward(Wrapper):
    """Any controller behind the inverse of its nominal machine.

    Args:
        controller: the feedback.
        ahead: F, with one row for each axis; axis i drives control i.
        machine: nominal plant P, measured as the feedback reads it.
        limit: of the control, +-: one number or one for each; none when infinite.

    Raises:
        ValueError: a limit is not above zero.
    """

    laws_not_kept = {"restart": "the filter reads samples before the one at which a run begins"}
    controller: Controller
    ahead: PreviewFilter
    machine: Plant
    limit: Float[Array, "*p"] = eqx.field(converter=numbers, default=np.inf)

    def __check_init__(self):
        check_limit(self.limit)

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The longer of those of the feedback and the filter [samples]."""
        return max(self.controller.preview, self.ahead.preview)

    def prepare(self, reference: Reference) -> InversePlan:
        check_preview(self, reference)
        inner = self.controller.prepare(reference)
        nominal = self.ahead.before_and_of(reference)
        fed_back = self._feedback(reference, inner, nominal)
        return InversePlan(inner, nominal[self.ahead.preview :] - fed_back)

    def step(
        self, memory: Any, plan: InversePlan, measurement: Any
    ) -> tuple[Any, Float[Array, " p"]]:
        memory, control = self.controller.step(memory, plan.inner, measurement)
        return memory, jnp.clip(control + plan.ahead, -self.limit, self.limit)

    def _feedback(
        self, reference: Reference, inner: Plan, nominal: Float[Array, "both p"]
    ) -> Float[Array, "T p"]:
        """What the feedback would give along the nominal motion."""
        # the nominal machine sets out `preview` samples before the run, in its steady motion
        early, increment = self.ahead.preview, reference.start_increment
        start = self.machine.initial_state(reference.position[0] - early * increment, increment)

        def alone(state, control):
            return self.machine.step(state, control), None

        def followed(carried, row):
            state, memory = carried
            plan, control = row
            memory, fed_back = self.controller.step(memory, plan, self.machine.measure(state))
            return (self.machine.step(state, control), memory), fed_back

        state, _ = jax.lax.scan(alone, start, nominal[:early])
        memory = self.controller.initial_memory(reference)
        return jax.lax.scan(followed, (state, memory), (inner, nominal[early:]))[1]


class FrictionPlan(NamedTuple):
    """Plan of the wrapped controller, and the control against friction."""

    inner: Any
    friction: Float[Array, "*T p"]
    stands: Bool[Array, "*T"]  # whether the reference has stood for long


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
        ahead: d [samples], at least zero.
        turning: samples n of a reversal, at least one; the slew rate is 2 k_c / n.
        hold_after: samples for which the reference has to stand until integrals are held: dry
            friction would make them break loose again and again. None are when zero.

    Raises:
        ValueError: the gain is negative or not finite, a limit is not above zero, or there are
            fewer samples.
    """

    controller: Controller
    coulomb: Float[Array, "*p"] = eqx.field(converter=numbers)
    limit: Float[Array, "*p"] = eqx.field(converter=numbers, default=np.inf)
    ahead: int = eqx.field(static=True, default=0)
    hold_after: int = eqx.field(static=True, default=0)
    turning: int = eqx.field(static=True, default=1)

    def __check_init__(self):
        check_limit(self.limit)
        check_signs(self, not_negative=("coulomb",))
        if self.ahead < 0 or self.turning < 1:
            raise ValueError(
                "ahead, turning: need at least 0 and 1 samples, "
                f"received {self.ahead} and {self.turning}"
            )

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return max(self.controller.preview, 1 + self.ahead)

    def prepare(self, reference: Reference) -> FrictionPlan:
        directions = self.directions(reference)
        sample = jnp.arange(len(directions))
        moves = jnp.any(directions != 0, axis=1)
        last = jax.lax.cummax(jnp.where(moves, sample, -1))
        stands = (sample - last >= self.hold_after) & (self.hold_after > 0)
        friction = self.against(reference)
        return FrictionPlan(self.controller.prepare(reference), friction, stands)

    def against(self, reference: Reference) -> Float[Array, "T p"]:
        """Control against friction at every sample.

        Raises:
            ValueError: the reference looks less far ahead than this does.
        """
        wanted, most = self.directions(reference), 2 / self.turning

        def eased(before, now):
            turned = jnp.clip(now, before - most, before + most)
            return turned, turned

        start = direction(reference.start_increment[None])[0]
        return jnp.atleast_1d(self.coulomb)[None] * jax.lax.scan(eased, start, wanted)[1]

    def directions(self, reference: Reference) -> Float[Array, "T m"]:
        """Direction in which the axes are to move d samples ahead, 0 where they stand."""
        check_preview(self, reference)
        rows = reference.position[self.ahead : self.ahead + reference.steps + 1]
        return direction(jnp.diff(rows, axis=0))

    def step(
        self, memory: Any, plan: FrictionPlan, measurement: Any
    ) -> tuple[Any, Float[Array, " p"]]:
        after, control = self.controller.step(memory, plan.inner, measurement)
        memory = self.controller.with_integrals_held(memory, after, plan.stands)
        return memory, jnp.clip(control + plan.friction, -self.limit, self.limit)
