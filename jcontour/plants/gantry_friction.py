"""The gantry with dry friction in its three guide ways: of the head on the beam, and of both drives.

    M_z z'' = f(z, z', u) - F_f,     z = (x_h, y_1, y_2),   z' = J(q) q'
    M_z = J^-T M J^-1,   f = J^-T (Q - h - M (J^-1)' z')        from (5.7)-(5.9), F_f as in `friction`
The thesis's gantry has viscous friction only; the dry part is that of its chapter 3. In the motors' coordinates each slider is one number:
one that sticks is left out of the equation, neither its speed nor its position changes by a bit, and what its guide way has to hold
follows from the motion of the others, to which the mass matrix couples it.
"""

from collections.abc import Iterable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jcontour.friction import Friction
from jcontour.integrators import runge_kutta
from jcontour.linear import is_concrete
from jcontour.plant import Plant
from jcontour.plants.gantry import EquationOfMotion, Triple, substeps_of
from jcontour.plants.gantry_parameters import GantryParameters, Scalar, untwisted

SLIDERS = 3  # head, first and second drive

OfSliders = Float[Array, "3"]


class SliderMasses(NamedTuple):
    """M_z [kg], symmetric: of the head, of the first and of the second drive."""

    head: Scalar
    head_1: Scalar
    head_2: Scalar
    drive_1: Scalar
    drives: Scalar
    drive_2: Scalar

    def times(self, acceleration: Triple) -> Triple:
        """M_z z'' [N]."""
        x, first, second = acceleration
        return (
            self.head * x + self.head_1 * first + self.head_2 * second,
            self.head_1 * x + self.drive_1 * first + self.drives * second,
            self.head_2 * x + self.drives * first + self.drive_2 * second,
        )

    def solved(self, force: Iterable[Scalar]) -> Triple:
        """M_z^-1 f [m/s^2], by the adjugate."""
        a, b, c, d, e, f = self
        A, B, C = d * f - e**2, c * e - b * f, b * e - c * d
        D, E, F = a * f - c**2, b * c - a * e, a * d - b**2
        determinant = a * A + b * B + c * C
        x, first, second = force
        head, drive_1, drive_2 = A * x + B * first + C * second, B * x + D * first + E * second, C * x + E * first + F * second
        return head / determinant, drive_1 / determinant, drive_2 / determinant

    def solved_for(self, slips: Bool[Array, "3"], force: Iterable[Scalar]) -> Triple:
        """z'' [m/s^2] where only some sliders slip: that of the others is zero, to the bit."""
        x, first, second = slips
        free = SliderMasses(
            jnp.where(x, self.head, 1), jnp.where(x & first, self.head_1, 0), jnp.where(x & second, self.head_2, 0),
            jnp.where(first, self.drive_1, 1), jnp.where(first & second, self.drives, 0), jnp.where(second, self.drive_2, 1),
        )  # fmt: skip
        return free.solved(jnp.where(slip, f, 0) for slip, f in zip(slips, force, strict=True))


class SliderEquation(NamedTuple):
    """The equation of motion in the coordinates of the motors."""

    motion: EquationOfMotion
    half_span: Scalar  # L [m]

    @classmethod
    def of(cls, p: GantryParameters) -> "SliderEquation":
        """The equation of a machine."""
        return cls(EquationOfMotion.of(p), p.half_span)

    def masses_and_forces(self, z: OfSliders, v: OfSliders, control: OfSliders) -> tuple[SliderMasses, Triple]:
        """M_z [kg] and f [N]: what the motors, the springs and the motion itself exert on each slider, without dry friction.

        With e = 1 / (2 L cos theta) there is y_N' = (y_1' + y_2') / 2, theta' = e (y_2' - y_1') and
        theta'' = e (y_2'' - y_1'') + theta'^2 tan theta.
        """
        (x, first, second), (dx, d_first, d_second) = z, v
        sine = (second - first) / (2 * self.half_span)
        cosine = jnp.sqrt(1 - sine**2)
        e = 1 / (2 * self.half_span * cosine)
        omega = e * (d_second - d_first)
        q, rates = (x, (first + second) / 2, jnp.arcsin(sine)), (dx, (d_first + d_second) / 2, omega)
        (M_xx, M_xy, M_xt), (_, M_yy, M_yt), (_, _, M_tt) = self.motion.mass_matrix(q)
        masses = SliderMasses(
            M_xx, M_xy / 2 - e * M_xt, M_xy / 2 + e * M_xt, M_yy / 4 - e * M_yt + e**2 * M_tt, M_yy / 4 - e**2 * M_tt,
            M_yy / 4 + e * M_yt + e**2 * M_tt,
        )  # fmt: skip
        turn = omega**2 * sine / cosine
        parts = zip(self.motion.forces(q, rates, control), self.motion.bias(q, rates), (M_xt, M_yt, M_tt), strict=True)
        along, across, turning = (Q - h - M * turn for Q, h, M in parts)
        return masses, (along, across / 2 - e * turning, across / 2 + e * turning)


class SlidingMotion(NamedTuple):
    """Positions and speeds of the sliders (z, z') [m, m/s], and whether each sticks (0) or slips (-1, 1)."""

    motion: Float[Array, "6"]
    mode: Int[Array, "3"]


class _FrictionGantry(Plant):
    """What the true gantry and its smooth twin share: they integrate (z, z'), and measure (q, q') as `Gantry` does."""

    parameters: GantryParameters
    friction: Friction
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def __init__(self, parameters: GantryParameters, friction: Friction, dt: float, substeps: int | None = None):
        self.parameters, self.dt, self.substeps = parameters, float(dt), substeps_of(dt, substeps)
        self.friction = of_sliders(friction)

    def _start(self, position, increment) -> Float[Array, "6"]:
        return self.parameters.motors(untwisted(self.parameters, position, jnp.asarray(increment) / self.dt))

    def output(self, state) -> Float[Array, "2"]:
        """The tool [m]."""
        return self.parameters.tool(self.measure(state)[:3])


class StickSlipGantry(_FrictionGantry):
    """The gantry with stick and slip. It has no useful derivative where it sticks: tune on `SmoothFrictionGantry`.

    Between substeps a slider whose speed has turned sticks, unless what is on it takes it on the other way at once, and one at rest breaks
    loose where more than f_c + f_s is on it. What is on it depends on which of the others slip, so that they break loose one after another,
    the most overloaded first.

    Args:
        parameters: of the machine.
        friction: of head, first and second drive; its viscous part adds to that of the parameters.
        dt: sample period [s].
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: `dt` is not above zero, the substep does not divide it, or the friction is that of another number of sliders.
    """

    def initial_state(self, position, increment) -> SlidingMotion:
        """No twist, the tool through `position`, at rest and stuck or at a steady speed.

        Raises:
            ValueError: the head would be outside the beam.
        """
        motion = self._start(position, increment)
        return SlidingMotion(motion, jnp.sign(motion[3:]).astype(jnp.int32))

    def step(self, state: SlidingMotion, control) -> SlidingMotion:
        """Substeps of classical Runge-Kutta with the modes frozen in each."""
        equation, guides = SliderEquation.of(self.parameters), each(self.friction)

        def substep(_, state: SlidingMotion) -> SlidingMotion:
            motion, mode = state
            slips = mode != 0

            def rates(x):
                z, v = x[:3], x[3:]
                masses, forces = equation.masses_and_forces(z, v, control)
                left = [f - guide.slipping(s, speed) for f, guide, s, speed in zip(forces, guides, mode, v, strict=True)]
                return jnp.stack([*v, *masses.solved_for(slips, left)])

            return self._settled(equation, SlidingMotion(runge_kutta(rates, motion, self.dt / self.substeps), mode), control)

        return jax.lax.fori_loop(0, self.substeps, substep, self._settled(equation, state, control))

    def measure(self, state: SlidingMotion) -> Float[Array, "6"]:
        """(q, q')."""
        return self.parameters.coordinates(state.motion)

    def _settled(self, equation: SliderEquation, state: SlidingMotion, control) -> SlidingMotion:
        """Modes for what follows: sliders at rest, or whose speed has turned, stick or break loose in the direction of what is on them."""
        z, v = state.motion[:3], state.motion[3:]
        mode = jnp.where(state.mode * v > 0, state.mode, 0)
        speed = jnp.where(mode == 0, 0, v)
        masses, forces = equation.masses_and_forces(z, speed, control)
        for _ in range(SLIDERS):
            slipping = masses.solved_for(mode != 0, jnp.stack(forces) - self.friction.slipping(mode, speed))
            load = jnp.stack(forces) - jnp.stack(masses.times(slipping))
            excess = jnp.where(mode == 0, jnp.abs(load) - self.friction.dry(jnp.zeros(SLIDERS)), -jnp.inf)
            mode = jnp.where(jnp.arange(SLIDERS) == jnp.argmax(excess), self.friction.released(mode, load), mode)
        return SlidingMotion(jnp.concatenate([z, jnp.where(mode * v > 0, v, 0)]), mode)


class SmoothFrictionGantry(_FrictionGantry):
    """The differentiable twin: friction follows tanh(sharpness v).

    Args:
        parameters: as of the true gantry.
        friction: likewise.
        dt: sample period [s].
        sharpness: 1/speed [s/m] within which friction turns; stiff beyond 1 / substep times mass over force.
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: as `StickSlipGantry`, or the sharpness is not above zero.
    """

    sharpness: Scalar

    def __init__(
        self, parameters: GantryParameters, friction: Friction, dt: float, sharpness: float = 1e3, substeps: int | None = None  # 1 mm/s
    ):  # fmt: skip
        super().__init__(parameters, friction, dt, substeps)
        if is_concrete(sharpness) and not np.all(np.isfinite(sharpness) & (np.asarray(sharpness) > 0)):
            raise ValueError(f"sharpness: needs to be finite and above zero, received {sharpness}")
        self.sharpness = jnp.asarray(sharpness, float)

    def initial_state(self, position, increment) -> Float[Array, "6"]:
        """(z, z'): no twist, the tool through `position`, at rest or at a steady speed.

        Raises:
            ValueError: the head would be outside the beam.
        """
        return self._start(position, increment)

    def step(self, state, control) -> Float[Array, "6"]:
        """Substeps of classical Runge-Kutta."""
        equation, guides = SliderEquation.of(self.parameters), each(self.friction)

        @jax.checkpoint  # reverse mode computes a stage again instead of storing it
        def rates(x):
            z, v = x[:3], x[3:]
            masses, forces = equation.masses_and_forces(z, v, control)
            left = [f - guide.smooth(speed, self.sharpness) for f, guide, speed in zip(forces, guides, v, strict=True)]
            return jnp.stack([*v, *masses.solved(left)])

        h = self.dt / self.substeps
        return jax.lax.fori_loop(0, self.substeps, lambda _, x: runge_kutta(rates, x, h), state)

    def measure(self, state) -> Float[Array, "6"]:
        """(q, q')."""
        return self.parameters.coordinates(state)


def each(friction: Friction) -> list[Friction]:
    """Slider by slider."""
    return [jax.tree.map(lambda values, k=k: values[k], friction) for k in range(SLIDERS)]


def of_sliders(friction: Friction) -> Friction:
    """One value for each slider.

    Raises:
        ValueError: there is another number of them.
    """
    for name, values in vars(friction).items():
        if values.shape[-1] not in (1, SLIDERS):
            raise ValueError(f"friction: {name} needs one value, or one each for the head and the two drives, received {values.shape[-1]}")
    return jax.tree.map(lambda values: jnp.broadcast_to(values, (SLIDERS,)), friction)
