"""Learning in Cartesian space on an arm: the force at the tool is learned from cycle to cycle.

Guglielmo & Sadegh in the volume of 1990; there is no text of it here, so this is the textbook form.
With the error e = r - x of the tool, on torques tau of the joints,

    f = K_p e + K_d e',     tau = J(q)' (f + w_j(t)),     w_{j+1} = Q [w_j + gain f_j]
The feedback does what is not learned yet; what it still does is learned. J' turns a force at the
tool into torques, so no model of the arm's masses is needed, only its lengths.
"""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour._arrays import check_signs
from jcontour.controller import Controller, check_axes, check_period, checked_period, numbers
from jcontour.controllers.learning.laps import Lap, RunLap
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import simulate


@runtime_checkable
class Arm(Protocol):
    """Kinematics that the law needs."""

    def tool(self, angle: Float[Array, "2"]) -> Float[Array, "2"]:
        """Tool at these angles [m]."""
        ...

    def jacobian(self, angle: Float[Array, "2"]) -> Float[Array, "2 2"]:
        """Speed of the tool by the speeds of the joints [m/rad]."""
        ...


class Wanted(eqx.Module):
    """Position [m] and speed [m/s] of the tool, and the learned force [N]."""

    position: Float[Array, "*T 2"]
    speed: Float[Array, "*T 2"]
    force: Float[Array, "*T 2"]


class CartesianControl(Controller):
    """Spring and damper at the tool, with a learned force, on measured angles and their speeds.

    Args:
        arm: kinematics of the arm.
        stiffness: K_p [N/m].
        damping: K_d [N s/m].
        force: w (T, 2) [N].
        dt: sample period [s].

    Raises:
        ValueError: a gain is negative or not finite, or `dt` is not above zero.
    """

    arm: Arm
    stiffness: Float[Array, ""] = eqx.field(converter=numbers)
    damping: Float[Array, ""] = eqx.field(converter=numbers)
    force: Float[Array, "T 2"] = eqx.field(converter=jnp.asarray)
    dt: float = eqx.field(static=True, converter=checked_period)
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        check_signs(self, not_negative=("stiffness", "damping"))

    def prepare(self, reference: Reference) -> Wanted:
        """Positions, speeds by differences about each sample, and the force.

        Raises:
            ValueError: the sample period, the number of axes or the length of the force is another.
        """
        check_axes(2, reference)
        check_period(self.dt, reference)
        steps = reference.steps
        if self.force.shape != (steps, 2):
            raise ValueError(f"force: needs the shape ({steps}, 2), received {self.force.shape}")
        before = reference.position[:1] - reference.start_increment[None]
        path = jnp.concatenate([before, reference.position[: steps + 1]])
        speed = (path[2:] - path[:-2]) / (2 * self.dt)
        return Wanted(reference.position[:steps], speed, self.force)

    def initial_memory(self, reference: Reference) -> None:
        return None

    def step(self, memory: None, plan: Wanted, measurement) -> tuple[None, Float[Array, "2"]]:
        force = self.feedback(plan, measurement) + plan.force
        return None, self.arm.jacobian(measurement[0]).T @ force

    def feedback(self, plan: Wanted, measurement) -> Float[Array, "2"]:
        """f = K_p e + K_d e' [N]."""
        angle, speed = measurement
        error = plan.position - self.arm.tool(angle)
        closing = plan.speed - self.arm.jacobian(angle) @ speed
        return self.stiffness * error + self.damping * closing


def cartesian_cycles(
    plant: Callable[[Any], Plant],
    control: CartesianControl,
    reference: Reference,
) -> RunLap:
    """Cycles of an arm for `learn`: the correction is the force, the error is f [N].

    Args:
        plant: the arm of each cycle, by its number.
        control: gains and kinematics; its force is replaced.
        reference: of one cycle.
    """

    def run(force, lap):
        controller = eqx.tree_at(lambda c: c.force, control, force)
        rollout = simulate(plant(lap), controller, reference)
        plan = controller.prepare(reference)
        still = jax.vmap(controller.feedback)(plan, rollout.measurement)
        return Lap(force, still, rollout.output, rollout.control)

    return run
