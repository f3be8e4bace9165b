"""Cross-coupled control: a compensator on the contour error corrects the velocity commands.

    e = r - y,   eps = K_x e_x + K_y e_y                                    (Yuan, Fig. 2.11)
    v_ref,i = k_pp e_i + k_ff dr_i/dt + C_i W(eps)
for a biaxial machine. With constant gains (Koren 1980) the contour is taken for its tangent, K = n,
and the correction is forwarded equally to both axes. The printed C_x = C_y = 1 is for the quadrant
of the figure; in the others C_i has the sign of n_i. With variable gains (Koren & Lo 1991) the
contour is taken for its circle of curvature and corrected at right angles to it:
K = C = n + kappa e / 2. W is a PID.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import checked_gain
from jcontour.controllers.contouring.path_frame import OnPath, PathFrame, PathPlan
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.motion.references import Reference

Axes = Float[Array, " 2"]
PARALLEL = 1e-6  # a line this close to an axis leaves it alone: rounding has no sign


class CrossGains(eqx.Module):
    """Gains of the compensator W = k_p + k_i / s + k_d s; all zero leave the plain cascade.

    It turns a contour error [m] into a speed [m/s].

    Args:
        proportional: k_p [1/s].
        integral: k_i [1/s^2].
        derivative: k_d [-].

    Raises:
        ValueError: a gain is negative or not finite.
    """

    proportional: Float[Array, ""]
    integral: Float[Array, ""]
    derivative: Float[Array, ""]

    def __init__(self, proportional, integral=0.0, derivative=0.0):
        self.proportional = checked_gain("proportional", proportional)
        self.integral = checked_gain("integral", integral)
        self.derivative = checked_gain("derivative", derivative)


class Coupling(eqx.Module):
    """Coupling gains K and C of the axes."""

    @abc.abstractmethod
    def vectors(self, frame: PathFrame, error: Axes) -> tuple[Axes, Axes]:
        """Gains (K, C) for the position error r - y [m].

        K'e is the contour error; C is the direction of its correction.
        """


class ConstantCoupling(Coupling):
    """Coupling K = n, C = sign n: constant along a straight line (Koren 1980)."""

    def vectors(self, frame: PathFrame, error: Axes) -> tuple[Axes, Axes]:
        """Gains of the tangent; the error is not used."""
        oblique = jnp.abs(frame.normal) > PARALLEL
        return frame.normal, jnp.where(oblique, jnp.sign(frame.normal), 0.0)


class VariableCoupling(Coupling):
    """Coupling K = C = n + kappa e / 2 (Koren & Lo 1991)."""

    def vectors(self, frame: PathFrame, error: Axes) -> tuple[Axes, Axes]:
        """Gains of the circle of curvature."""
        gains = frame.circular(error)
        return gains, gains


class CrossMemory(NamedTuple):
    """Memory of `CrossCoupled`."""

    cascade: Axes  # integrators of the cascade
    integral: Float[Array, ""]  # of the compensator, as a speed [m/s]
    error: Float[Array, ""]  # contour error one sample ago [m]


class CrossCoupled(OnPath):
    """A cascade whose axes are coupled by the contour error.

    Args:
        cascade: the axes.
        gains: gains of the compensator.
        coupling: `ConstantCoupling` or `VariableCoupling`.
    """

    cascade: Cascade
    gains: CrossGains
    coupling: Coupling

    def initial_memory(self, reference: Reference) -> CrossMemory:
        """Integrators and contour error at zero."""
        zero = jnp.zeros((), reference.position.dtype)
        return CrossMemory(self.cascade.initial_memory(reference), zero, zero)

    def step(self, memory: CrossMemory, plan: PathPlan, measurement) -> tuple[CrossMemory, Axes]:
        """Next memory and the control."""
        position, velocity = self.cascade.sensors.read(measurement)
        error = plan.command.position - position
        K, C = self.coupling.vectors(plan.frame, error)
        eps, gains, dt = K @ error, self.gains, self.cascade.dt
        integral = memory.integral + gains.integral * dt * eps
        damping = gains.derivative * (eps - memory.error) / dt
        correction = gains.proportional * eps + integral + damping
        wanted = self.cascade.speed_command(plan.command, position) + C * correction
        axes, control = self.cascade.drive(memory.cascade, wanted - velocity, plan.command.control)
        return CrossMemory(axes, integral, eps), control
