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

from jcontour._arrays import is_concrete
from jcontour.plant import Plant
from jcontour.plants.friction import runge_kutta

LVDT_QUANTUM = 43e-6  # [m], the paper's sensor of a leg with its converter
SERVO_GAIN = 16.359  # [m/s^2 per unit of control], the paper's 16359 with y in mm
SERVO_POLE = 567.5  # [rad/s]; 567 in print, which does not give the printed controller
PATH_DURATION = 6.0  # [s]
PATH_TILT = np.deg2rad(8.0)
_PATH_TIMES = (0.0, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.0)  # [s]
_PATH_HEIGHTS = (0.400, 0.400, 0.440, 0.440, 0.370, 0.410, 0.400, 0.400)  # [m]


def _legs() -> np.ndarray:
    """Directions n_i of the legs (3, 3)."""
    angle = 2 * np.pi * np.arange(3) / 3
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=-1)


class ThreeLink(eqx.Module):
    """Geometry of the manipulator; lengths are distances from pin to ball.

    Level, at a height of 400 mm:

    >>> (1e3 * ThreeLink().legs(jnp.array([0.4, 0.0, 0.0]))).round(3).tolist()
    [407.922, 407.922, 407.922]

    Args:
        base_radius: r [m].
        platform_radius: h [m].
        shortest: length of a leg that is drawn in [m].
        longest: length of a leg that is driven out [m].

    Raises:
        ValueError: a radius is not above zero, or the stroke is empty.
    """

    base_radius: float | Array = 0.2  # chosen: the paper prints none
    platform_radius: float | Array = 0.12  # chosen
    shortest: float = eqx.field(static=True, default=0.25)  # room around the path's 0.35 m
    longest: float = eqx.field(static=True, default=0.6)  # and its 0.46 m

    def __check_init__(self):
        for name in ("base_radius", "platform_radius"):
            radius = getattr(self, name)
            if is_concrete(radius) and not (np.isfinite(radius) and np.all(np.asarray(radius) > 0)):
                raise ValueError(f"{name}: needs to be above zero, received {radius}")
        if not 0 <= self.shortest < self.longest:
            raise ValueError(
                f"shortest: needs to be below longest, received {self.shortest} and {self.longest}"
            )

    @jax.jit
    def balls(self, pose: Float[Array | np.ndarray, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
        """Ball joints, (leg, coordinate) [m]."""
        pose = jnp.asarray(pose)
        turned = _tilt(pose[..., 1:]) @ jnp.asarray(_legs().T, pose.dtype)
        # Centre of the platform; it shifts sideways with the tilt [m]
        x, y = pose[..., 1], pose[..., 2]
        # (1 - cos beta) / beta^2 = sinc(beta/2)^2 / 2, with beta^2 (cos, sin)(2 alpha) beside it
        share = self.platform_radius / 4 * _sinc(jnp.sqrt(_square(x, y)) / 2) ** 2
        centre = jnp.stack([-share * (x**2 - y**2), share * 2 * x * y, pose[..., 0]], axis=-1)
        return centre[..., None, :] + self.platform_radius * jnp.swapaxes(turned, -1, -2)

    def legs(self, pose: Float[Array | np.ndarray, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Lengths of the legs at a pose: the inverse kinematics [m].

        Raises:
            ValueError: a leg is not long or not short enough; traced poses pass unchecked.
        """
        lengths = self._lengths(jnp.asarray(pose))
        self._check_stroke(lengths)
        return lengths

    @jax.jit
    def _lengths(self, pose: Array) -> Array:
        pins = self.base_radius * jnp.asarray(_legs(), pose.dtype)
        offset = self.balls(pose) - jnp.expand_dims(pins, tuple(range(pose.ndim - 1)))
        return jnp.linalg.norm(offset, axis=-1)

    def _check_stroke(self, lengths: Array) -> None:
        """Raise ValueError unless every leg can be as long."""
        if not is_concrete(lengths):
            return
        values = np.asarray(lengths)
        if not np.all((values >= self.shortest) & (values <= self.longest)):
            raise ValueError(
                f"legs: out of reach, needed are {np.min(values):.6g} to {np.max(values):.6g} m, "
                f"the legs have {self.shortest} to {self.longest} m"
            )


def _square(x: Array, y: Array) -> Array:
    """beta^2, kept above zero: its root has a finite slope there."""
    return jnp.maximum(x**2 + y**2, 1e-30)


def _sinc(angle: Array) -> Array:
    """sin(a) / a, 1 at zero."""
    return jnp.sinc(angle / jnp.pi)


def _tilt(tilt: Array) -> Array:
    """Rotation Q of a tilt (beta cos alpha, beta sin alpha), by Rodrigues' formula."""
    x, y = tilt[..., 0], tilt[..., 1]
    zero = jnp.zeros_like(x)
    rows = [[zero, zero, x], [zero, zero, y], [-x, -y, zero]]  # the axis is (-sin, cos, 0) alpha
    K = jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
    beta = jnp.sqrt(_square(x, y))
    first, second = _sinc(beta), _sinc(beta / 2) ** 2 / 2
    unit = jnp.broadcast_to(jnp.eye(3, dtype=K.dtype), K.shape)
    return unit + first[..., None, None] * K + second[..., None, None] * (K @ K)


def manipulator_path(times: Float[np.ndarray, " S"]) -> Float[np.ndarray, "S 3"]:
    """Poses along the path, at rest before and after: z goes through corners, the tilt turns once.

        alpha = 2 pi t / 6,   beta = 8 degrees sin^2(pi t / 6)
    The form follows Fig. 7 of the paper, whose numbers are not printed. The error of a leg is
    taken from the length at the start: `ThreeLink().legs(path) - ThreeLink().legs(path[0])`.

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
