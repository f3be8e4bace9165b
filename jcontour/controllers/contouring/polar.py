"""Contouring in polar coordinates, for closed curves around a centre (Chen, Liu & Ting 2002).

With the tool at (rho, theta) around the centre and the reference at (rho_d, theta_d), the contour
error is taken for the radial one at the tool's own angle,

    eps = rho_d + (d rho_d / d theta_d) (theta - theta_d) - rho
    v_ref = k_pp e + k_ff dr/dt + k (eps + 1/T_i integral eps) rho_hat,   e = r - y
and a PI controller of eps moves the tool along its own radius. On a circle around the centre eps is
the contour error, however far behind the tool is. The centre is that of the contour
where it is not given: the mean of points that are evenly spread along it.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import check_signs
from jcontour._tracing import is_concrete
from jcontour.controller import numbers
from jcontour.controllers.contouring.schemes import OnPath, PathPlan
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.motion.references import Reference

POINTS = 64  # along the contour, whose mean is its centre
ROUND = 1e-3  # of the farthest radius: a curve that comes nearer to its centre goes through it


class PolarPlan(PathPlan):
    """Plan of the cascade and the frame, the centre, and the slope d rho_d / d theta_d [m]."""

    centre: Float[Array, "*T 2"]
    slope: Float[Array, "*T"]


class PolarMemory(NamedTuple):
    """Integrators of the cascade, and of the radial error as a speed [m/s]."""

    cascade: Float[Array, " 2"]
    integral: Float[Array, ""]


class Polar(OnPath):
    """A cascade with a PI controller of the radial error.

    Args:
        cascade: the axes.
        radial: k [1/s].
        integral: k / T_i [1/s^2].
        centre: of the polar coordinates [m]; that of the contour when not given.

    Raises:
        ValueError: a gain is negative or not finite.
    """

    cascade: Cascade
    radial: Float[Array, ""] = eqx.field(converter=numbers)
    integral: Float[Array, ""] = eqx.field(converter=numbers, default=0.0)
    centre: Float[Array, " 2"] | None = eqx.field(converter=numbers, default=None)

    def __check_init__(self):
        check_signs(self, not_negative=("radial", "integral"))

    def prepare(self, reference: Reference) -> PolarPlan:
        """Commands, frames and slopes of all steps.

        Raises:
            ValueError: as `OnPath.prepare`, or the centre is on the curve.
        """
        path, contour = super().prepare(reference), reference.contour
        position = path.command.position
        centre = self.centre
        if centre is None:
            spread = contour.length * jnp.asarray(np.arange(POINTS) / POINTS)
            moved = position[0] - contour.position(reference.arc[0])  # of a part that was moved
            centre = jnp.mean(contour.position(spread), axis=0) + moved
        arm = position - centre[None]
        radius = _length(arm)
        if is_concrete(radius) and not np.min(radius) > ROUND * np.max(radius):
            raise ValueError(
                f"centre: {np.round(np.asarray(centre), 6)} is on the curve; "
                "needs a centre that the curve goes round"
            )
        outwards = jnp.sum(path.frame.tangent * arm, axis=1)  # rho (t . rho_hat)
        around = jnp.sum(path.frame.tangent * _turned(arm), axis=1)
        faced = jnp.abs(around) > ROUND * radius  # elsewhere the path runs along the radius
        slope = jnp.where(faced, radius * outwards / jnp.where(faced, around, 1.0), 0.0)
        around_it = jnp.broadcast_to(centre, position.shape)
        return PolarPlan(path.command, path.frame, around_it, slope)

    def initial_memory(self, reference: Reference) -> PolarMemory:
        return PolarMemory(self.cascade.initial_memory(reference), jnp.zeros(()))

    def step(
        self, memory: PolarMemory, plan: PolarPlan, measurement
    ) -> tuple[PolarMemory, Float[Array, " 2"]]:
        command, cascade = plan.command, self.cascade
        position, velocity = cascade.sensors.read(measurement)
        arm, wanted = position - plan.centre, command.position - plan.centre
        radius = _length(arm)
        apart = radius * _length(wanted) > 0
        along = jnp.where(apart, wanted @ arm, 1.0)
        behind = jnp.arctan2(_turned(wanted) @ arm, along)  # theta - theta_d
        eps = _length(wanted) + plan.slope * behind - radius
        integral = memory.integral + self.integral * cascade.dt * eps
        correction = (self.radial * eps + integral) * arm / jnp.where(radius > 0, radius, 1.0)
        speed = cascade.speed_command(command, position) + correction
        axes, control = cascade.drive(memory.cascade, speed - velocity, command.control)
        return PolarMemory(axes, integral), control


def _length(vector: Float[Array, "*T 2"]) -> Float[Array, "*T"]:
    """Length, with a derivative of zero at zero: at the centre there is no radius."""
    square = jnp.sum(vector**2, axis=-1)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def _turned(vector: Float[Array, "*T 2"]) -> Float[Array, "*T 2"]:
    """Vectors turned to the left by a right angle."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)
