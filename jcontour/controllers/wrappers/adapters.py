"""Any controller on a machine with other motors, controls or sensors than it expects, or a gap.

The path of every motor follows from that of the tool, r_motor = K r with K (q, m). A gantry's two Y
drives both follow y: its beam is taken as straight.
Drives may share a control, u = D v. Speeds that are not measured are
v(k) = (q(k) - q(k-1)) / dt. Against backlash the motor leads the tool by half the gap, in the
direction of motion.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Memory, Plan, Wrapper
from jcontour.controllers.feedback.cascade import STANDS
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class OfMotors(Wrapper):
    """A controller that sees a reference of q motors where the machine has m axes.

    Args:
        controller: a controller of single motors, such as `Cascade`.
        kinematics: K (q, m).
    """

    controller: Controller
    kinematics: Float[Array, "q m"] = eqx.field(converter=jnp.asarray)

    def prepare(self, reference: Reference) -> Plan:
        return self.controller.prepare(self._of_motors(reference))

    def initial_memory(self, reference: Reference) -> Memory:
        return self.controller.initial_memory(self._of_motors(reference))

    def _of_motors(self, reference: Reference) -> Reference:
        return eqx.tree_at(
            lambda r: (r.position, r.tangent, r.start_increment),
            reference,
            replace_fn=lambda vectors: vectors @ self.kinematics.T,
        )


class SharedControls(Wrapper):
    """A controller whose q controls are shared out to the p drives of a machine.

    Args:
        controller: of q controls.
        shares: D (p, q).
    """

    controller: Controller
    shares: Float[Array, "p q"] = eqx.field(converter=jnp.asarray)

    def step(self, memory: Memory, plan: Plan, measurement) -> tuple[Memory, Float[Array, " p"]]:
        memory, control = self.controller.step(memory, plan, measurement)
        return memory, self.shares @ control


class WithoutLearning(Wrapper):
    """A controller as it begins, whose memory is what it learns: margins are those of this loop."""

    controller: Controller

    def step(self, memory: Memory, plan: Plan, measurement) -> tuple[Memory, Float[Array, " p"]]:
        """The control with what is known; nothing is learned."""
        known = jax.lax.stop_gradient(memory)
        return known, self.controller.step(known, plan, measurement)[1]


class DifferenceMemory(NamedTuple):
    """Last positions [m], and the memory of the wrapped controller."""

    position: Float[Array, " m"]
    inner: Any


class SpeedByDifference(Wrapper):
    """A controller that reads positions and speeds, (q, v), such as a cascade on `motors(m)`.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 20.0, 0.02), motors(2), dt=1e-3)
    >>> differenced = SpeedByDifference(cascade, Sensors([0, 1]), dt=1e-3)

    Args:
        controller: the wrapped controller.
        sensors: where the positions stand in the measurement.
        dt: sample period [s].
    """

    controller: Controller
    sensors: Sensors
    dt: float = eqx.field(static=True)

    def initial_memory(self, reference: Reference) -> DifferenceMemory:
        before = reference.position[0] - reference.start_increment
        return DifferenceMemory(before, self.controller.initial_memory(reference))

    def step(
        self, memory: DifferenceMemory, plan: Any, measurement: Any
    ) -> tuple[DifferenceMemory, Float[Array, " p"]]:
        position = self.sensors.positions(measurement)
        speed = (position - memory.position) / self.dt
        inner, control = self.controller.step(
            memory.inner, plan, jnp.concatenate([position, speed])
        )
        return DifferenceMemory(position, inner), control

    def with_integrals_held(
        self, before: DifferenceMemory, after: DifferenceMemory, holds: Any
    ) -> DifferenceMemory:
        inner = self.controller.with_integrals_held(before.inner, after.inner, holds)
        return after._replace(inner=inner)


RISE = 8  # samples in which the gap is crossed: a jump would shake the loop


class BacklashCompensation(Wrapper):
    """A controller whose reference leads by half a gap: r + gap / 2 sign(r').

    At rest the last direction holds. The lead turns within `RISE` samples before a reversal, so
    that the gap is closed when the tool turns; the score is taken against the reference itself.

    Args:
        controller: the wrapped controller, fed by encoders at the motor.
        gap: of every axis [m].
    """

    controller: Controller
    gap: Float[Array, " m"]

    def prepare(self, reference: Reference) -> Plan:
        return self.controller.prepare(self.leading(reference))

    def leading(self, reference: Reference) -> Reference:
        """The reference with positions that lead."""
        ahead = reference.position + self.gap[None] / 2 * directions(reference)
        return eqx.tree_at(lambda one: one.position, reference, ahead)


@jax.jit
def directions(reference: Reference) -> Float[Array, "S m"]:
    """Direction of every axis, in [-1, 1], turning before it reverses; 0 until it first moves."""
    moved = jnp.diff(reference.position, axis=0)
    moved = jnp.concatenate([moved, moved[-1:]])
    index = jnp.arange(len(moved))[:, None]
    last = jax.lax.cummax(jnp.where(jnp.abs(moved) > STANDS, index, -1), axis=0)
    way = jnp.sign(jnp.take_along_axis(moved, jnp.maximum(last, 0), axis=0))
    way = jnp.where(last >= 0, way, 0.0)
    ahead = jnp.concatenate([way, jnp.repeat(way[-1:], RISE - 1, axis=0)])
    return jnp.mean(jnp.stack([ahead[k : k + len(way)] for k in range(RISE)]), axis=0)
