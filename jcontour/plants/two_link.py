"""An arm of two links in a plane, a torque in each joint; numbers of a small assembly robot.

    M(q) q'' + c(q, q') + b q' = tau
The masses stand in the middle of the links, q_2 is measured from the first link, and the tool is
the end of the second one. The state is (q, q'), both measured.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.plant import Plant
from jcontour.plants.integrators import runge_kutta

LENGTH = np.array([0.4, 0.3])  # [m]
SUBSTEPS = 2
Angles = Float[Array, "2"]


class TwoLinkArm(Plant):
    """Two links of 0.4 and 0.3 m, elbow bent to the left.

    Args:
        mass: of each link [kg].
        inertia: about its middle [kg m^2].
        viscous: friction of each joint [N m s/rad].
        dt: sample period [s].
    """

    mass: tuple[float, float] = (8.0, 4.0)
    inertia: tuple[float, float] = (0.12, 0.04)
    viscous: tuple[float, float] = (0.5, 0.3)
    dt: float = eqx.field(static=True, default=2e-3)

    def initial_state(self, position: Angles, increment: Angles) -> tuple[Angles, Angles]:
        """Angles and their speeds with which the tool passes a place [m]."""
        angle = self.angles(position)
        return angle, jnp.linalg.solve(self.jacobian(angle), increment / self.dt)

    def step(self, state: tuple[Angles, Angles], control: Angles) -> tuple[Angles, Angles]:
        """State one sample later, by Runge-Kutta of order four."""
        for _ in range(SUBSTEPS):
            state = runge_kutta(lambda now: self._rates(now, control), state, self.dt / SUBSTEPS)
        return state

    def output(self, state: tuple[Angles, Angles]) -> Angles:
        """Tool [m]."""
        return self.tool(state[0])

    def tool(self, angle: Angles) -> Angles:
        """Tool at these angles [m]."""
        both = jnp.cumsum(angle)
        return jnp.stack([LENGTH @ jnp.cos(both), LENGTH @ jnp.sin(both)])

    def jacobian(self, angle: Angles) -> Float[Array, "2 2"]:
        """Speed of the tool by the speeds of the joints [m/rad]."""
        return jax.jacfwd(self.tool)(angle)

    def angles(self, tool: Angles) -> Angles:
        """Angles that hold the tool at a place [m]."""
        one, two = LENGTH
        elbow = jnp.arccos((tool @ tool - one**2 - two**2) / (2 * one * two))
        ahead = jnp.arctan2(two * jnp.sin(elbow), one + two * jnp.cos(elbow))
        return jnp.stack([jnp.arctan2(tool[1], tool[0]) - ahead, elbow])

    def _rates(self, state, torque: Angles):
        (_, elbow), speed = state
        v1, v2 = speed
        a2 = self.mass[1] * LENGTH[0] * LENGTH[1] / 2
        a3 = self.inertia[1] + self.mass[1] * LENGTH[1] ** 2 / 4
        a1 = self.inertia[0] + self.mass[0] * LENGTH[0] ** 2 / 4 + a3
        a1 = a1 + self.mass[1] * LENGTH[0] ** 2
        side = a3 + a2 * jnp.cos(elbow)
        M = jnp.stack([jnp.stack([a1 + 2 * a2 * jnp.cos(elbow), side]), jnp.stack([side, a3])])
        c = a2 * jnp.sin(elbow) * jnp.stack([-v2 * (2 * v1 + v2), v1**2])
        return speed, jnp.linalg.solve(M, torque - c - jnp.asarray(self.viscous) * speed)
