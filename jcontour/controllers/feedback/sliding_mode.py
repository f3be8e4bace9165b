"""Laws that hold a machine on a surface of its error.

Sliding mode control is that of a sampled linear machine. The surface is s = S (x - x_d), scaled so
that S B = I: s has the unit of the control. With

    u = S (x_d(k+1) - A x) + n(s)
the model moves to s(k+1) = n(s(k)) in one sample. n is the reaching law, and n = 0 leaves the
equivalent control. A load d of the controls makes it s(k+1) = n + d.

The integral surface (Utkin & Shi 1996) counts what the model with the gain K does not explain,

    sigma(k) = sigma(k-1) + S (e(k) - (A - B K) e(k-1)),   e = x - x_d
    u = S (x_d(k+1) - A x_d) - K e + n(sigma) - sigma
so that it holds from the first sample on, with the poles of A - B K. The surface S = B'P with P of
a Riccati equation is stable: what is left of x'P x on it falls as fast as under the best control.

Dynamic surface control of the axes of a cascade (Swaroop, Hedrick, Yip & Gerdes 2000) is
backstepping whose virtual control passes a lag, so that it needs no derivative:

    v* = r' + k_1 (r - y)
    tau alpha' + alpha = v*
    u = k_a alpha' + k_v r' + k_c sgn r' + k_2 (alpha - v),   alpha' = (v* - alpha) / tau
k_1, k_2, k_a, k_v, k_c are the position gain, the velocity gain and the feedforward gains of the
cascade; its integral time is not used. The lag is exact for a v* that is held over the sample.

Adaptive robust control of the axes of a cascade (Yao & Tomizuka 1996) has desired compensation:

    p = v - r' + k_1 (y - r),   psi = (r'', r', sgn r', 1)
    u = theta . psi - k_a k_1 (v - r') - k_2 p
    theta' = Proj(-gamma psi p)
theta = (k_a, k_v, k_c, load) begins at the feedforward gains of the cascade, k_1 and k_2 are its
position and velocity gains. The projection keeps every estimate within its bounds, so that the
error keeps its robust bound whether they converge or not. The regressors are those of the reference
alone: noise of the encoders teaches nothing. At a limit of the control nothing is learned.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import check_signs, is_concrete
from jcontour.controller import Axes, Controller, numbers
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan, commanded, direction
from jcontour.controllers.feedback.state_feedback import TargetPlan, moving_target
from jcontour.controllers.wrappers.adapters import WithoutLearning
from jcontour.linear.plant import LinearPlant
from jcontour.linear.small_matrices import small_solve
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain

Controls = Float[Array, " p"]
LARGE = 1e30  # beyond any surface, in the unit of the control


class Reaching(eqx.Module):
    """How the surface is reached, component by component."""

    @abc.abstractmethod
    def next(self, integral: Controls, surface: Controls) -> tuple[Controls, Controls]:
        """Integral of the law and n(s), from those of now."""

    def sliding(self) -> "Reaching":
        """The law near the surface, where margins are looked at; itself if it is linear there."""
        return self


class BoundaryLayer(Reaching):
    """Reaching law of Gao with a boundary layer: n = (1 - rate) s - size sat(s / width).

    Args:
        rate: part of s that goes in a sample.
        size: switched part, in the unit of the control.
        width: of the layer in which it is linear, likewise.

    Raises:
        ValueError: a number is negative or not finite, or the width is zero.
    """

    rate: Float[Array, ""] = eqx.field(converter=numbers)
    size: Float[Array, ""] = eqx.field(converter=numbers)
    width: Float[Array, ""] = eqx.field(converter=numbers)

    def __check_init__(self):
        check_signs(self, positive=("width",), not_negative=("rate", "size"))

    def next(self, integral: Controls, surface: Controls) -> tuple[Controls, Controls]:
        """No integral."""
        switched = jnp.clip(surface / self.width, -1.0, 1.0)
        return jnp.zeros_like(integral), (1 - self.rate) * surface - self.size * switched


class SuperTwisting(Reaching):
    """Super-twisting law (Levant 1993), implicit Euler: it does not chatter by itself.

        n = s - k_1 |n|^(1/2) sgn n + w+,   w+ = w - k_2 sgn n
    The set-valued sgn 0 = [-1, 1] has the answer n = 0, w+ = -s where |s + w| <= k_2.

    Args:
        root: k_1, root of the unit of the control.
        twist: k_2, unit of the control per sample.

    Raises:
        ValueError: a number is negative or not finite.
    """

    root: Float[Array, ""] = eqx.field(converter=numbers)
    twist: Float[Array, ""] = eqx.field(converter=numbers)

    def __check_init__(self):
        check_signs(self, not_negative=("root", "twist"))

    def sliding(self) -> "SuperTwisting":
        """On the surface, |s + w| <= k_2, what is left of s is zero in a sample."""
        return SuperTwisting(self.root, LARGE)

    def next(self, integral: Controls, surface: Controls) -> tuple[Controls, Controls]:
        """Solution of the quadratic equation for |n|^(1/2)."""
        total = surface + integral
        beyond = jnp.abs(total) - self.twist
        outside = beyond > 0
        left = jnp.where(outside, beyond, 1.0)  # a root without a derivative at zero
        size = 2 * left / (self.root + jnp.sqrt(self.root**2 + 4 * left))
        reached = jnp.where(outside, jnp.sign(total) * size**2, 0.0)
        return jnp.where(outside, integral - self.twist * jnp.sign(total), -surface), reached


class SlidingMemory(NamedTuple):
    """Integral of the reaching law, and what the surface has gathered before this sample."""

    integral: Controls
    gathered: Controls


class SlidingMode(Controller):
    """Sliding mode control; the measurement is the state of the model, true or estimated.

    Args:
        model: A, B, C.
        surface: S (p, n) in any scale; see `riccati_surface`.
        reaching: law by which it is reached.
        gain: K (p, n) of an integral surface; None for the plain one.

    Raises:
        ValueError: as `moving_target`; or the surface has another shape, or S B is singular.
    """

    model: LinearPlant
    surface: Float[Array, "p n"]
    reaching: Reaching
    gain: Float[Array, "p n"] | None
    preview: int = eqx.field(static=True, default=2)  # x_d(k+1) needs r(k+2)

    def __init__(
        self,
        model: LinearPlant,
        surface: Float[ArrayLike, "p n"],
        reaching: Reaching,
        gain: Float[ArrayLike, "p n"] | None = None,
    ):
        surface = jnp.asarray(surface, float)
        gain = None if gain is None else jnp.asarray(gain, float)
        wanted = (model.inputs, model.states)
        for name, matrix in (("surface", surface), ("gain", gain)):
            if matrix is not None and matrix.shape != wanted:
                raise ValueError(f"{name}: needs shape {wanted}, received {matrix.shape}")
        acting = surface @ model.B
        if is_concrete(acting) and not np.linalg.cond(np.asarray(acting)) * 1e-12 < 1:
            raise ValueError(
                "surface: needs relative degree one, a control acts on it later (S B is singular)"
            )
        self.model, self.reaching, self.gain = model, reaching, gain
        self.surface, self.preview = small_solve(acting, surface), 2

    def prepare(self, reference: Reference) -> TargetPlan:
        """Targets x_d, and the equivalent control S (x_d(k+1) - A x_d) of every step."""
        steps, target = reference.steps, moving_target(self.model)
        y = reference.position[: steps + 2]
        state = y[:-1] @ target.state.T + jnp.diff(y, axis=0) @ target.state_moving.T
        ahead = state[1:] - state[:-1] @ self.model.A.T
        return TargetPlan(state[:-1], ahead @ self.surface.T)

    def initial_memory(self, reference: Reference) -> SlidingMemory:
        """On the surface: the machine starts as the reference says."""
        nothing = jnp.zeros(self.model.inputs, self.surface.dtype)
        return SlidingMemory(nothing, nothing)

    def without_planned_limits(self) -> "SlidingMode":
        """The same near its surface: what reaches it from afar is no linear loop."""
        return eqx.tree_at(lambda one: one.reaching, self, self.reaching.sliding())

    def step(
        self, memory: SlidingMemory, plan: TargetPlan, measurement: Float[Array, " n"]
    ) -> tuple[SlidingMemory, Controls]:
        S, A, B = self.surface, self.model.A, self.model.B
        error = measurement - plan.state
        sigma = S @ error + memory.gathered
        integral, reached = self.reaching.next(memory.integral, sigma)
        moved = A @ error
        if self.gain is None:
            plain = SlidingMemory(integral, jnp.zeros_like(memory.gathered))
            return plain, plan.control - S @ moved + reached
        fed_back = self.gain @ error
        gathered = sigma - S @ (moved - B @ fed_back)
        return SlidingMemory(integral, gathered), plan.control - fed_back + reached - sigma


def riccati_surface(
    model: LinearPlant, Q: Float[ArrayLike, "n n"], R: Float[ArrayLike, "p p"]
) -> tuple[Float[Array, "p n"], Float[Array, "p n"]]:
    """Stable surface B'P of the Riccati equation with weights Q and R, and its gain K.

    Raises:
        ValueError: the equation has no stabilising solution.
    """
    Q, R = jnp.asarray(Q, float), jnp.asarray(R, float)
    check_dare(model.A, model.B, Q, R)
    P = dare(model.A, model.B, Q, R)
    return model.B.T @ P, lqr_gain(model.A, model.B, P, R)


class DynamicSurface(Controller):
    """Dynamic surface control of every axis, on measured positions and speeds.

    Args:
        cascade: gains, sensors and limits of the axes.
        lag: tau [s], one number or one for each axis.

    Raises:
        ValueError: the lag is not above zero.
    """

    cascade: Cascade
    lag: Float[Array, ""] | Float[Array, " m"] = eqx.field(converter=numbers)
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        check_signs(self, positive=("lag",))

    def prepare(self, reference: Reference) -> CascadePlan:
        """Commands of the axes; the control holds no inertia, alpha' has it."""
        plan, gains = self.cascade.prepare(reference), self.cascade.gains
        control = jnp.atleast_2d(gains.viscous) * plan.velocity
        control = control + jnp.atleast_2d(gains.coulomb) * direction(
            plan.velocity * self.cascade.dt
        )
        return CascadePlan(plan.position, plan.velocity, control)

    def initial_memory(self, reference: Reference) -> Axes:
        """Filtered speed: that with which the machine enters [m/s]."""
        return reference.start_increment / self.cascade.dt

    def step(self, memory: Axes, plan: CascadePlan, measurement) -> tuple[Axes, Axes]:
        gains, cascade = self.cascade.gains, self.cascade
        position, velocity = cascade.sensors.read(measurement)
        wanted = plan.velocity + gains.position * (plan.position - position)
        slope = (wanted - memory) / self.lag
        control = gains.inertia * slope + plan.control + gains.velocity * (memory - velocity)
        filtered = wanted + jnp.exp(-cascade.dt / self.lag) * (memory - wanted)
        hold = cascade.holding * plan.position
        return filtered, jnp.clip(control + hold, -cascade.limit, cascade.limit)


ACCELERATION, SPEED = 1.0, 0.1  # [m/s^2], [m/s] at which each estimate learns as fast as the load


class RobustPlan(eqx.Module):
    """Commands of the axes, and the regressors of every step."""

    command: CascadePlan
    regressors: Float[Array, "*T m 4"]


class Bounds(NamedTuple):
    """Bounds of the estimates (m, 4)."""

    low: Float[Array, "m 4"]
    high: Float[Array, "m 4"]


class AdaptiveRobust(Controller):
    """Adaptive robust control of every axis, on measured positions and speeds.

    Args:
        cascade: gains, sensors and limits of the axes.
        adaptation: 1/T_i [1/s]: the estimate of a load grows as the integral of a PI with T_i.
        share: part of inertia and viscous friction by which their estimates may be off.
        load: bound of the estimated load, and of dry friction beside its first estimate.

    Raises:
        ValueError: a number is negative or not finite.
    """

    cascade: Cascade
    adaptation: Float[Array, ""] = eqx.field(converter=numbers)
    share: Float[Array, ""] = eqx.field(converter=numbers)
    load: Float[Array, ""] = eqx.field(converter=numbers)
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        check_signs(self, not_negative=("adaptation", "share", "load"))

    def prepare(self, reference: Reference) -> RobustPlan:
        """Commands, and accelerations, speeds and their signs."""
        cascade = self.cascade
        plan, motion = cascade.prepare(reference), commanded(reference, cascade.sensors, cascade.dt)
        ones = jnp.ones_like(motion.velocity)
        columns = motion.acceleration, motion.velocity, jnp.sign(motion.velocity), ones
        return RobustPlan(plan, jnp.stack(columns, axis=-1))

    def bounds(self) -> Bounds:
        """Bounds of the estimates around the first ones."""
        first, reach = self._first(), self.load * jnp.ones(self.cascade.sensors.axes)
        off = jnp.stack([*(self.share * first[:, i] for i in (0, 1)), reach, reach], axis=1)
        return Bounds(first - off, first + off)

    def initial_memory(self, reference: Reference) -> Float[Array, "m 4"]:
        """First estimates; a load that holds the axes where the reference begins."""
        held = self.cascade.holding * reference.position[0]
        return self._first().at[:, 3].add(held)

    def without_planned_limits(self) -> WithoutLearning:
        return WithoutLearning(self)

    def step(
        self, memory: Float[Array, "m 4"], plan: RobustPlan, measurement
    ) -> tuple[Float[Array, "m 4"], Axes]:
        gains, cascade, psi = self.cascade.gains, self.cascade, plan.regressors
        position, velocity = cascade.sensors.read(measurement)
        faster = velocity - plan.command.velocity
        p = faster + gains.position * (position - plan.command.position)
        free = jnp.sum(memory * psi, axis=1) - gains.velocity * p
        free = free - gains.inertia * gains.position * faster
        control = jnp.clip(free, -cascade.limit, cascade.limit)
        rates = np.array([ACCELERATION**-2, SPEED**-2, 1.0, 1.0])
        learning = (
            self.adaptation * gains.velocity * p * (control == free).astype(float) * cascade.dt
        )
        bounds, held = self.bounds(), (cascade.holding * plan.command.position)[:, None]
        centre = held * np.array([[0.0, 0.0, 0.0, 1.0]])
        moved = memory - learning[:, None] * rates[None] * psi
        return jnp.clip(moved, bounds.low + centre, bounds.high + centre), control

    def _first(self) -> Float[Array, "m 4"]:
        gains, axes = self.cascade.gains, self.cascade.sensors.axes
        values = gains.inertia, gains.viscous, gains.coulomb, jnp.zeros(())
        return jnp.stack([jnp.broadcast_to(one, (axes,)) for one in values], axis=1)
