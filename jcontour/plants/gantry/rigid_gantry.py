"""Two drives of a rigid gantry: its centre and its rotation alone (Yuan, eq. 2.5).

    M_t y'' = F_1 + F_2 - (b_1 + b_2) y' + (b_1 l_1 - b_2 l_2) theta'
    J_t theta'' = -F_1 l_1 + F_2 l_2 + (b_1 l_1 - b_2 l_2) y' - (b_1 l_1^2 + b_2 l_2^2) theta'
                  - K_theta theta
The outputs are the drives' positions, y - l_1 theta and y + l_2 theta. Neither the head's own
motion nor the lateral one is in it, which is why the thesis makes its own model: see `Gantry`.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.linear.transformations import zoh


class RigidGantry(NamedTuple):
    """Parameters of the rigid gantry.

    Attributes:
        mass: M_t [kg].
        inertia: J_t [kg m^2].
        arms: l_1, l_2 from the centre of mass to the drives [m].
        viscous: b_1, b_2 [N s/m].
        stiffness: K_theta of the joints [N m/rad].
    """

    mass: float
    inertia: float
    arms: tuple[float, float]
    viscous: tuple[float, float]
    stiffness: float

    def plant(self, dt: float) -> LinearPlant:
        """The plant; its state is (y, theta, y', theta'), its controls are the forces [N].

        Raises:
            ValueError: mass, inertia or stiffness is not above zero.
        """
        if not min(self.mass, self.inertia, self.stiffness) > 0:
            raise ValueError(f"gantry: needs mass, inertia, stiffness above zero, received {self}")
        arms = np.array([[1.0, -self.arms[0]], [1.0, self.arms[1]]])  # of the drives' positions
        weights = np.array([1 / self.mass, 1 / self.inertia])[:, None]
        A, B = np.zeros((4, 4)), np.zeros((4, 2))
        A[:2, 2:] = np.eye(2)
        A[2:, :2] = -weights * np.diag([0.0, self.stiffness])
        A[2:, 2:] = -weights * (arms.T @ np.diag(self.viscous) @ arms)
        B[2:] = weights * arms.T
        C = np.hstack([arms, np.zeros((2, 2))])
        both = jnp.array([[0.5, 0.5], [0.0, 0.0]])  # a straight gantry: both drives move alike
        none = jnp.zeros((2, 2))
        motion = SteadyMotion(jnp.concatenate([both, none]), jnp.concatenate([none, both / dt]))
        return LinearPlant(*zoh(A, B, dt), C, dt, motion=motion)
