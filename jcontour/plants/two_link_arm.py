"""A horizontal arm of two links with a motor in each joint: dynamics, kinematics and energy.

    M(q) q'' + c(q, q') + b q' = tau
    M = [[a_1 + 2 a_2 cos q_2, a_3 + a_2 cos q_2], [a_3 + a_2 cos q_2, a_3]]
    c = a_2 sin q_2 (-q_2' (2 q_1' + q_2'), q_1'^2)
    a_1 = I_1 + I_2 + m_1 c_1^2 + m_2 (l_1^2 + c_2^2),  a_2 = m_2 l_1 c_2,  a_3 = I_2 + m_2 c_2^2
q_2 is measured from the first link. The tool is at l_1 (cos q_1, sin q_1) + l_2 (cos, sin)(q_1 +
q_2). A textbook arm for learning in Cartesian space; no paper prints it.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.plant import Plant
from jcontour.plants.integrators import runge_kutta
from jcontour.tracing import is_concrete

SUBSTEPS = 4  # of Runge-Kutta's fourth order in a sample: its error is below rounding at 1 ms


class Joints(NamedTuple):
    """Angles [rad] and their speeds [rad/s]."""

    angle: Float[Array, "2"]
    speed: Float[Array, "2"]


class TwoLinkArm(Plant):
    """Two rigid links in a plane; the controls are the torques [N m].

    Stretched out to a right angle:

    >>> arm = TwoLinkArm()
    >>> angle = arm.angles(jnp.array([0.4, 0.3]))
    >>> bool(jnp.allclose(arm.tool(angle), jnp.array([0.4, 0.3])))
    True

    Args:
        length: l_1, l_2 [m].
        centre: c_1, c_2, from the joint to the link's centre of mass [m].
        mass: m_1, m_2 [kg].
        inertia: I_1, I_2 about the centres of mass [kg m^2].
        viscous: b of both joints [N m s/rad].
        dt: sample period [s].

    Raises:
        ValueError: a number is not above zero (viscous: negative), or not finite.
    """

    length: Float[Array, "2"]
    centre: Float[Array, "2"]
    mass: Float[Array, "2"]
    inertia: Float[Array, "2"]
    viscous: Float[Array, "2"]
    dt: float = eqx.field(static=True)

    def __init__(
        self,
        length=(0.4, 0.3),
        centre=(0.2, 0.15),
        mass=(8.0, 4.0),
        inertia=(0.12, 0.04),
        viscous=(0.5, 0.3),
        dt: float = 1e-3,
    ):
        named = {"length": length, "centre": centre, "mass": mass, "inertia": inertia}
        for name, value in {**named, "viscous": viscous, "dt": dt}.items():
            if is_concrete(value):
                numbers = np.asarray(value)
                enough = numbers >= 0 if name == "viscous" else numbers > 0
                if not np.all(np.isfinite(numbers) & enough):
                    raise ValueError(f"{name}: needs to be above zero, received {value}")
        for name, value in {**named, "viscous": viscous}.items():
            setattr(self, name, jnp.broadcast_to(jnp.asarray(value, float), (2,)))
        self.dt = float(dt)

    @property
    def alike_everywhere(self) -> bool:
        """Nowhere: angles and inertia depend on the place."""
        return False

    def initial_state(self, position, increment) -> Joints:
        """Elbow bent to the left, the tool in motion.

        Raises:
            ValueError: the position is out of reach; traced ones pass unchecked.
        """
        angle = self.angles(jnp.asarray(position))
        return Joints(
            angle, jnp.linalg.solve(self.jacobian(angle), jnp.asarray(increment) / self.dt)
        )

    def step(self, state: Joints, control: Float[Array, "2"]) -> Joints:
        """State one sample later, by Runge-Kutta's method."""
        h = self.dt / SUBSTEPS

        def rates(one: Joints) -> Joints:
            return Joints(one.speed, self.acceleration(one, control))

        return jax.lax.fori_loop(0, SUBSTEPS, lambda _, one: runge_kutta(rates, one, h), state)

    def output(self, state: Joints) -> Float[Array, "2"]:
        """Tool [m]."""
        return self.tool(state.angle)

    def acceleration(self, state: Joints, torque: Float[Array, "2"]) -> Float[Array, "2"]:
        """q'' under torques."""
        return jnp.linalg.solve(self.inertia_matrix(state.angle), torque - self._drag(state))

    def torque(self, state: Joints, acceleration: Float[Array, "2"]) -> Float[Array, "2"]:
        """Torques of a motion: the inverse dynamics [N m]."""
        return self.inertia_matrix(state.angle) @ acceleration + self._drag(state)

    def inertia_matrix(self, angle: Float[Array, "2"]) -> Float[Array, "2 2"]:
        """M(q)."""
        a1, a2, a3 = self._inertias()
        side = a3 + a2 * jnp.cos(angle[1])
        first = a1 + 2 * a2 * jnp.cos(angle[1])
        return jnp.stack([jnp.stack([first, side]), jnp.stack([side, a3])])

    def energy(self, state: Joints) -> Float[Array, ""]:
        """Kinetic energy [J]."""
        return state.speed @ self.inertia_matrix(state.angle) @ state.speed / 2

    def tool(self, angle: Float[Array, "2"]) -> Float[Array, "2"]:
        """Tool at these angles [m]."""
        both = jnp.cumsum(angle)
        return jnp.stack([self.length @ jnp.cos(both), self.length @ jnp.sin(both)])

    def jacobian(self, angle: Float[Array, "2"]) -> Float[Array, "2 2"]:
        """Speed of the tool by the speeds of the joints [m/rad]."""
        both = jnp.cumsum(angle)
        x, y = -self.length * jnp.sin(both), self.length * jnp.cos(both)
        return jnp.stack([jnp.stack([x[0] + x[1], x[1]]), jnp.stack([y[0] + y[1], y[1]])])

    def angles(self, tool: Float[Array, "2"]) -> Float[Array, "2"]:
        """Angles with the tool there, the elbow bent to the left.

        Raises:
            ValueError: it is out of reach; traced positions pass unchecked.
        """
        one, two = self.length[0], self.length[1]
        cosine = (tool @ tool - one**2 - two**2) / (2 * one * two)
        if is_concrete(cosine) and not abs(float(cosine)) < 1:
            raise ValueError(
                f"position: out of reach, {float(jnp.linalg.norm(tool)):.4g} m from the base; the "
                f"arm reaches from {float(abs(one - two)):.4g} to {float(one + two):.4g} m"
            )
        elbow = jnp.arccos(cosine)
        ahead = jnp.arctan2(two * jnp.sin(elbow), one + two * cosine)
        return jnp.stack([jnp.arctan2(tool[1], tool[0]) - ahead, elbow])

    def _inertias(self) -> tuple[Array, Array, Array]:
        a2 = self.mass[1] * self.length[0] * self.centre[1]
        a3 = self.inertia[1] + self.mass[1] * self.centre[1] ** 2
        a1 = self.inertia[0] + self.mass[0] * self.centre[0] ** 2
        return a1 + a3 + self.mass[1] * self.length[0] ** 2, a2, a3

    def _drag(self, state: Joints) -> Float[Array, "2"]:
        """c(q, q') + b q'."""
        _, a2, _ = self._inertias()
        turning = a2 * jnp.sin(state.angle[1])
        one, two = state.speed
        apart = turning * jnp.stack([-two * (2 * one + two), one**2])
        return apart + self.viscous * state.speed
