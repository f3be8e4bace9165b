"""Contouring schemes around the cascade of a biaxial machine, and the frame of the path.

The unit tangent is t = (t_x, t_y), the normal to its left n = (-t_y, t_x), and dt/ds = kappa n.

Cross-coupled position command shaping (CPSCS): the contour error corrects the position commands.

    eps = c'(r - y),   command: r + k eps n        (Yuan, section 2.3.3)
Unlike pre-compensation it has no memory. Unlike cross-coupled control it needs no access to the
drives: it may run beside the numerical control. Inside a cascade it makes the position loop stiffer
across the path, k_pp (1 + k) in place of k_pp. A steady contour error is divided by 1 + k when both
axes have the same k_pp.

Cross-coupled pre-compensation (CCPM): the contour error corrects the velocity commands.

    eps = c'(r - y),   da/dt = k eps
    command: r + a n,   its velocity: (1 - kappa a) dr/dt + k eps n
After Chin & Lin 1997 (Yuan, section 2.3.3). The correction acts before the velocity commands are
integrated to positions. The offset a stays on the normal as the path turns, so that the feed of the
command changes by 1 - kappa a: slower on the inside of a curve, faster on its outside. Where a
comes to rest no error is left, eps = 0: on lines for any axes, on circles at constant feed for
equal axes.

Tangential-contouring control: a cascade whose position loop works in the frame of the path.

    v_ref = k_along t (t'e) + k_across n (n'e) + k_ff dr/dt,   e = r - y
Lo & Chung 1999, for biaxial machines with t and n of the reference point; Chiu & Tomizuka 2001 call
it the task coordinate frame (Yuan, section 2.3.2). Errors along and across the path are decoupled
as far as the axes are alike. The velocity loops stay with the axes, and make them alike.

Cross-coupled control: a compensator on the contour error corrects the velocity commands.

    e = r - y,   eps = K_x e_x + K_y e_y                                    (Yuan, Fig. 2.11)
    v_ref,i = k_pp e_i + k_ff dr_i/dt + C_i W(eps)
for a biaxial machine. With constant gains (Koren 1980) the contour is taken for its tangent, K = n,
and the correction is forwarded equally to both axes. The printed C_x = C_y = 1 is for the quadrant
of the figure; in the others C_i has the sign of n_i. With variable gains (Koren & Lo 1991) the
contour is taken for its circle of curvature and corrected at right angles to it:
K = C = n + kappa e / 2. W is a PID.

Contouring in polar coordinates, for closed curves around a centre (Chen, Liu & Ting 2002). With the
tool at (rho, theta) around the centre and the reference at (rho_d, theta_d), the contour error is
taken for the radial one at the tool's own angle,

    eps = rho_d + (d rho_d / d theta_d) (theta - theta_d) - rho
    v_ref = k_pp e + k_ff dr/dt + k (eps + 1/T_i integral eps) rho_hat
and a PI controller of eps moves the tool along its own radius. On a circle around the centre eps is
the contour error, however far behind the tool is. A centre that is not given is the mean of points
that are evenly spread along the contour.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import check_signs, is_concrete
from jcontour.controller import Controller, numbers
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference


class PathFrame(eqx.Module):
    """Tangent and curvature [1/m] at every step of a reference; positive in a turn to the left."""

    tangent: Float[Array, "*T 2"]
    curvature: Float[Array, "*T"]

    @property
    def normal(self) -> Float[Array, "*T 2"]:
        """Tangent turned to the left by a right angle."""
        return _turned(self.tangent)

    def circular(self, error: Float[Array, " 2"]) -> Float[Array, " 2"]:
        """Gains c = n + kappa e / 2 for an error e = r - y [m].

        c'e is the distance to the circle of curvature, to second order in e. Koren & Lo 1991: C_x =
        sin theta - e_x / 2R, C_y = cos theta + e_y / 2R for their e = y - r on the left turn.
        """
        return self.normal + self.curvature * error / 2

    def contour_error(self, error: Float[Array, " 2"]) -> Float[Array, ""]:
        """Contour error eps = c'e [m], positive where the tool is to the right of the path."""
        return self.circular(error) @ error


class PathPlan(eqx.Module):
    """Commands of the axes, and the frame of the path there."""

    command: CascadePlan
    frame: PathFrame


class OnPath(Controller):
    """Common part of the contouring schemes around the cascade of a biaxial machine."""

    cascade: eqx.AbstractVar[Cascade]

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.cascade.preview

    def prepare(self, reference: Reference) -> PathPlan:
        """Commands and frames of all steps.

        Raises:
            ValueError: as `Cascade.prepare`, or the reference has not two axes.
        """
        axes, steps = reference.position.shape[-1], reference.steps
        if axes != 2:
            raise ValueError(f"reference: contouring schemes need two axes, received {axes}")
        tangent = reference.tangent[:steps]
        bend = reference.contour.curvature_vector(reference.arc[:steps])
        curvature = tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]
        return PathPlan(self.cascade.prepare(reference), PathFrame(tangent, curvature))

    def initial_memory(self, reference: Reference) -> Any:
        return self.cascade.initial_memory(reference)


class CommandShaped(OnPath):
    """A cascade behind CPSCS.

    Args:
        cascade: the axes.
        gain: k [-]; zero leaves the plain cascade.

    Raises:
        ValueError: the gain is negative or not finite.
    """

    cascade: Cascade
    gain: Float[Array, ""] = eqx.field(converter=numbers)

    def __check_init__(self):
        check_signs(self, not_negative=("gain",))

    def step(
        self, memory, plan: PathPlan, measurement
    ) -> tuple[Float[Array, " 2"], Float[Array, " 2"]]:
        command, frame = plan.command, plan.frame
        position, _ = self.cascade.sensors.read(measurement)
        error = frame.contour_error(command.position - position)
        shaped = CascadePlan(
            command.position + self.gain * error * frame.normal, command.velocity, command.control
        )
        return self.cascade.step(memory, shaped, measurement)


class PrecompensationMemory(NamedTuple):
    """Integrators of the cascade, and the offset of the command."""

    cascade: Float[Array, " 2"]
    offset: Float[Array, ""]  # a [m], positive to the left of the path


class Precompensated(OnPath):
    """A cascade behind CCPM.

    Args:
        cascade: the axes.
        gain: k [1/s]; zero leaves the plain cascade. Stable while it is well below the bandwidth of
            the position loops.

    Raises:
        ValueError: the gain is negative or not finite.
    """

    cascade: Cascade
    gain: Float[Array, ""] = eqx.field(converter=numbers)

    def __check_init__(self):
        check_signs(self, not_negative=("gain",))

    def initial_memory(self, reference: Reference) -> PrecompensationMemory:
        zero = jnp.zeros((), reference.position.dtype)
        return PrecompensationMemory(self.cascade.initial_memory(reference), zero)

    def step(
        self, memory: PrecompensationMemory, plan: PathPlan, measurement
    ) -> tuple[PrecompensationMemory, Float[Array, " 2"]]:
        command, frame = plan.command, plan.frame
        position, _ = self.cascade.sensors.read(measurement)
        rate = self.gain * frame.contour_error(command.position - position)
        offset = memory.offset + self.cascade.dt * rate
        shifted = CascadePlan(
            command.position + offset * frame.normal,
            (1 - frame.curvature * offset) * command.velocity + rate * frame.normal,
            command.control,
        )
        axes, control = self.cascade.step(memory.cascade, shifted, measurement)
        return PrecompensationMemory(axes, offset), control


class TaskFrame(OnPath):
    """A cascade whose position gains hold along and across the path.

    With equal gains it is the plain cascade.

    Args:
        cascade: the axes; the two entries of its position gain are k_along and k_across [1/s].
    """

    cascade: Cascade

    def step(
        self, memory, plan: PathPlan, measurement
    ) -> tuple[Float[Array, " 2"], Float[Array, " 2"]]:
        position, velocity = self.cascade.sensors.read(measurement)
        gains, frame = self.cascade.gains, jnp.stack([plan.frame.tangent, plan.frame.normal])
        error = frame @ (plan.command.position - position)
        wanted = (gains.position * error) @ frame + gains.feedforward * plan.command.velocity
        return self.cascade.drive(memory, wanted - velocity, plan.command.control)


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

    proportional: Float[Array, ""] = eqx.field(converter=numbers)
    integral: Float[Array, ""] = eqx.field(converter=numbers, default=0.0)
    derivative: Float[Array, ""] = eqx.field(converter=numbers, default=0.0)

    def __check_init__(self):
        check_signs(self, not_negative=("proportional", "integral", "derivative"))


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
        zero = jnp.zeros((), reference.position.dtype)
        return CrossMemory(self.cascade.initial_memory(reference), zero, zero)

    def step(self, memory: CrossMemory, plan: PathPlan, measurement) -> tuple[CrossMemory, Axes]:
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
