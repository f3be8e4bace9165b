"""Machines whose motors are not the axes of the tool.

The in-parallel manipulator of Smith & Lee (1990) has three legs that change their length. They
stand between a base and a platform: pin joints at the base, ball joints at the platform, all at psi
= 0, 120, 240 degrees. Legs keep to the planes of their pins, so the platform has three degrees of
freedom: height z and a tilt by beta towards alpha, without torsion. With n_i = (cos psi_i, sin
psi_i, 0), base radius r and platform radius h:

    Q = Rz(alpha) Ry(beta) Rz(-alpha)
    c = (-h/2 (1 - cos beta) cos 2 alpha,  h/2 (1 - cos beta) sin 2 alpha,  z)
    ball_i = c + h Q n_i,     l_i = |ball_i - r n_i|
A pose is (z, beta cos alpha, beta sin alpha) in m and rad: unlike (z, alpha, beta) it is smooth at
zero tilt. The paper prints neither radii nor the path's numbers: those here are chosen.

An arm of two links in a plane has a torque in each joint, and numbers of an assembly robot:

    M(q) q'' + c(q, q') + b q' = tau
The masses stand in the middle of the links, q_2 is measured from the first link, and the tool is
the end of the second one. The state is (q, q'), both measured.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial.transform import Rotation

from jcontour.plant import Plant
from jcontour.plants.friction import runge_kutta

BASE_RADIUS, PLATFORM_RADIUS = 0.2, 0.12  # r, h [m]
LVDT_QUANTUM = 43e-6  # [m], the paper's sensor of a leg with its converter
SERVO_GAIN = 16.359  # [m/s^2 per unit of control], the paper's 16359 with y in mm
SERVO_POLE = 567.5  # [rad/s]; 567 in print, which does not give the printed controller
PATH_DURATION = 6.0  # [s]
PATH_TILT = np.deg2rad(8.0)
_PATH_TIMES = (0.0, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.0)  # [s]
_PATH_HEIGHTS = (0.400, 0.400, 0.440, 0.440, 0.370, 0.410, 0.400, 0.400)  # [m]


def leg_lengths(poses: Float[np.ndarray, "S 3"]) -> Float[np.ndarray, "S 3"]:
    """Lengths of the manipulator's legs, from pin to ball: the inverse kinematics [m].

    Level, at a height of 400 mm:

    >>> (1e3 * leg_lengths(np.array([[0.4, 0.0, 0.0]]))).round(3).tolist()
    [[407.922, 407.922, 407.922]]
    """
    height, x, y = poses.T
    psi = 2 * np.pi * np.arange(3) / 3
    legs = np.stack([np.cos(psi), np.sin(psi), np.zeros(3)], axis=-1)
    # beta about (-sin alpha, cos alpha, 0)
    tilt = Rotation.from_rotvec(np.stack([-y, x, np.zeros_like(x)], axis=-1)).as_matrix()
    # (1 - cos beta) / beta^2 = sinc(beta/2)^2 / 2, with beta^2 (cos, sin)(2 alpha) beside it
    share = PLATFORM_RADIUS / 4 * np.sinc(np.hypot(x, y) / (2 * np.pi)) ** 2
    centre = np.stack([-share * (x**2 - y**2), share * 2 * x * y, height], axis=-1)
    balls = centre[:, None] + PLATFORM_RADIUS * legs @ tilt.transpose(0, 2, 1)
    return np.linalg.norm(balls - BASE_RADIUS * legs, axis=-1)


def manipulator_path(times: Float[np.ndarray, " S"]) -> Float[np.ndarray, "S 3"]:
    """Poses along the path, at rest before and after: z goes through corners, the tilt turns once.

        alpha = 2 pi t / 6,   beta = 8 degrees sin^2(pi t / 6)
    The form follows Fig. 7 of the paper, whose numbers are not printed. The error of a leg is
    taken from the length at the start.

    >>> manipulator_path(np.array([0.0, 3.0]))[:, 0].tolist()
    [0.4, 0.405]

    Args:
        times: instants [s] of the 6 s of the path.
    """
    t = np.clip(np.asarray(times, float), 0.0, PATH_DURATION)
    alpha, beta = 2 * np.pi * t / PATH_DURATION, PATH_TILT * np.sin(np.pi * t / PATH_DURATION) ** 2
    height = np.interp(t, _PATH_TIMES, _PATH_HEIGHTS)
    return np.stack([height, beta * np.cos(alpha), beta * np.sin(alpha)], axis=-1)


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
