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
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour._arrays import check_signs
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
        return jnp.stack([-self.tangent[..., 1], self.tangent[..., 0]], axis=-1)

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

    cascade: Cascade

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
