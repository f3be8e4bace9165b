"""The gantry with dry friction in its three guide ways: of the head on the beam and of both drives.

    M_z z'' = f(z, z', u) - F_f
with F_f as in `friction`. The thesis's gantry has
viscous friction only; the dry part is that of its chapter 3. A slider that sticks is left out of
the equation. The force on its guide way follows from the motion of the others, to which the mass
matrix couples it.

One number for the head and for each drive are the coordinates of the motors:

    z = (x_h, y_1, y_2),   z' = J(q) q'
    M_z = J^-T M J^-1,   f = J^-T (Q - h - M (J^-1)' z')        from (5.7)-(5.9)
Head and drives are the sliders. A slider that is held is left out of the equation: its speed and
its position then do not change by a bit.
"""

from collections.abc import Iterable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jcontour._arrays import check_signs
from jcontour.plants.friction import Friction, caught, runge_kutta
from jcontour.plants.gantry.gantry import (
    EquationOfMotion,
    GantryParameters,
    GantryPlant,
    Scalar,
    Triple,
)

SLIDERS = 3  # head, first and second drive
OfSliders = Float[Array, "3"]


class SliderMasses(NamedTuple):
    """Upper triangle of the symmetric M_z [kg]: head, first drive, second drive."""

    head: Scalar
    head_1: Scalar
    head_2: Scalar
    drive_1: Scalar
    drives: Scalar
    drive_2: Scalar

    def times(self, acceleration: Triple) -> Triple:
        """Forces M_z z'' [N]."""
        x, first, second = acceleration
        return (
            self.head * x + self.head_1 * first + self.head_2 * second,
            self.head_1 * x + self.drive_1 * first + self.drives * second,
            self.head_2 * x + self.drives * first + self.drive_2 * second,
        )

    def solved(self, force: Iterable[Scalar]) -> Triple:
        """Acceleration M_z^-1 f [m/s^2], by the adjugate."""
        a, b, c, d, e, f = self
        A, B, C = d * f - e**2, c * e - b * f, b * e - c * d
        D, E, F = a * f - c**2, b * c - a * e, a * d - b**2
        determinant = a * A + b * B + c * C
        x, first, second = force
        head = A * x + B * first + C * second
        drive_1 = B * x + D * first + E * second
        drive_2 = C * x + E * first + F * second
        return head / determinant, drive_1 / determinant, drive_2 / determinant

    def solved_for(self, slips: Bool[Array, "3"], force: Iterable[Scalar]) -> Triple:
        """Acceleration z'' [m/s^2] where only some sliders slip: exactly zero for the others."""
        x, first, second = slips
        free = SliderMasses(
            jnp.where(x, self.head, 1),
            jnp.where(x & first, self.head_1, 0),
            jnp.where(x & second, self.head_2, 0),
            jnp.where(first, self.drive_1, 1),
            jnp.where(first & second, self.drives, 0),
            jnp.where(second, self.drive_2, 1),
        )
        return free.solved(jnp.where(slip, f, 0) for slip, f in zip(slips, force, strict=True))


class SliderEquation(NamedTuple):
    """Equation of motion in the coordinates of the motors."""

    motion: EquationOfMotion
    half_span: Scalar  # L [m]

    @classmethod
    def of(cls, p: GantryParameters) -> "SliderEquation":
        """Equation of motion of a machine."""
        return cls(EquationOfMotion.of(p), p.half_span)

    def masses_and_forces(
        self, z: OfSliders, v: OfSliders, control: OfSliders
    ) -> tuple[SliderMasses, Triple]:
        """Masses M_z [kg] and forces f [N] on each slider, without dry friction.

        f is exerted by the motors, the springs and the motion itself. With e = 1 / (2 L cos theta)
        there is y_N' = (y_1' + y_2') / 2, theta' = e (y_2' - y_1') and
        theta'' = e (y_2'' - y_1'') + theta'^2 tan theta.
        """
        (x, first, second), (dx, d_first, d_second) = z, v
        sine = (second - first) / (2 * self.half_span)
        cosine = jnp.sqrt(1 - sine**2)
        e = 1 / (2 * self.half_span * cosine)
        omega = e * (d_second - d_first)
        q = (x, (first + second) / 2, jnp.arcsin(sine))
        rates = (dx, (d_first + d_second) / 2, omega)
        (M_xx, M_xy, M_xt), (_, M_yy, M_yt), (_, _, M_tt) = self.motion.mass_matrix(q)
        masses = SliderMasses(
            M_xx,
            M_xy / 2 - e * M_xt,
            M_xy / 2 + e * M_xt,
            M_yy / 4 - e * M_yt + e**2 * M_tt,
            M_yy / 4 - e**2 * M_tt,
            M_yy / 4 + e * M_yt + e**2 * M_tt,
        )
        turn = omega**2 * sine / cosine
        forces, bias = self.motion.forces(q, rates, control), self.motion.bias(q, rates)
        parts = zip(forces, bias, (M_xt, M_yt, M_tt), strict=True)
        along, across, turning = (Q - h - M * turn for Q, h, M in parts)
        return masses, (along, across / 2 - e * turning, across / 2 + e * turning)


class SlidingMotion(NamedTuple):
    """Motion of the sliders, and whether each sticks (0) or slips (-1, 1)."""

    sliders: Float[Array, "6"]  # positions and speeds (z, z') [m, m/s]
    mode: Int[Array, "3"]


class _FrictionGantry(GantryPlant):
    """Common part of the true gantry and its smooth twin.

    Both integrate (z, z'), and measure (q, q') as `Gantry` does.
    """

    friction: Friction

    def __init__(
        self,
        parameters: GantryParameters,
        friction: Friction,
        dt: float,
        substeps: int | float | None = None,
    ):
        super().__init__(parameters, dt, substeps)
        # Friction with one value for each slider
        for name, values in vars(friction).items():
            count = values.shape[-1]
            if count not in (1, SLIDERS):
                needed = "one value, or one each for the head and the two drives"
                raise ValueError(f"friction: {name} needs {needed}, received {count}")
        self.friction = jax.tree.map(lambda values: jnp.broadcast_to(values, (SLIDERS,)), friction)

    def _start(self, position, increment) -> Float[Array, "6"]:
        return self.parameters.motors(self.straight(position, increment))

    def output(self, state) -> Float[Array, "2"]:
        return self.parameters.tool(self.measure(state)[:3])


class StickSlipGantry(_FrictionGantry):
    """The gantry with stick and slip.

    It has no useful derivative where it sticks: tune on `SmoothFrictionGantry`. After each substep
    a slider whose velocity changed sign sticks, unless the force on it exceeds f_c + f_s; a slider
    at rest starts to slide when it does. The force on a slider depends on which of the others slip.
    So they break loose one after another, the most overloaded first.

    Args:
        parameters: of the machine.
        friction: friction of head, first and second drive; its viscous part adds to that of the
            parameters.
        dt: sample period [s].
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: `dt` is not above zero, the substep does not divide it, or the friction is that
            of another number of sliders.
    """

    def initial_state(self, position, increment) -> SlidingMotion:
        """State without twist, the tool through `position`, at rest and stuck or moving.

        Raises:
            ValueError: the head would be outside the beam.
        """
        sliders = self._start(position, increment)
        return SlidingMotion(sliders, jnp.sign(sliders[3:]).astype(jnp.int32))

    def step(self, state: SlidingMotion, control) -> SlidingMotion:
        equation, guides = SliderEquation.of(self.parameters), each(self.friction)

        def substep(_, state: SlidingMotion) -> SlidingMotion:
            sliders, mode = state
            slips = mode != 0

            def rates(x):
                z, v = x[:3], x[3:]
                masses, forces = equation.masses_and_forces(z, v, control)
                parts = zip(forces, guides, mode, v, strict=True)
                net = [f - guide.slipping(s, speed) for f, guide, s, speed in parts]
                return jnp.stack([*v, *masses.solved_for(slips, net)])

            moved = runge_kutta(rates, sliders, self.dt / self.substeps)
            return self._settled(equation, SlidingMotion(moved, mode), control)

        return jax.lax.fori_loop(0, self.substeps, substep, self._settled(equation, state, control))

    def measure(self, state: SlidingMotion) -> Float[Array, "6"]:
        """State (q, q') of `Gantry`."""
        return self.parameters.coordinates(state.sliders)

    def _settled(self, equation: SliderEquation, state: SlidingMotion, control) -> SlidingMotion:
        """State with the modes of the next substep."""
        z, v = state.sliders[:3], state.sliders[3:]
        mode = caught(state.mode, v)
        speed = _slipping(mode, v)
        masses, parts = equation.masses_and_forces(z, speed, control)
        forces, holding = jnp.stack(parts), self.friction.dry(jnp.zeros(SLIDERS))
        for _ in range(SLIDERS):
            net = forces - self.friction.slipping(mode, speed)
            load = forces - jnp.stack(masses.times(masses.solved_for(mode != 0, net)))
            excess = jnp.where(mode == 0, jnp.abs(load) - holding, -jnp.inf)
            most_overloaded = jnp.arange(SLIDERS) == jnp.argmax(excess)
            mode = jnp.where(most_overloaded, self.friction.released(mode, load), mode)
        return SlidingMotion(jnp.concatenate([z, _slipping(mode, v)]), mode)


class SmoothFrictionGantry(_FrictionGantry):
    """The differentiable twin of `StickSlipGantry`: friction follows tanh(sharpness v).

    Args:
        parameters: those of the true gantry.
        friction: that of the true gantry.
        dt: sample period [s].
        sharpness: inverse of the speed [s/m] within which friction turns. The equation is stiff
            beyond mass over force and substep.
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: as `StickSlipGantry`, or the sharpness is not above zero.
    """

    sharpness: Scalar

    def __init__(
        self,
        parameters: GantryParameters,
        friction: Friction,
        dt: float,
        sharpness: float | Scalar = 1e3,  # friction turns within 1 mm/s
        substeps: int | float | None = None,
    ):
        super().__init__(parameters, friction, dt, substeps)
        self.sharpness = jnp.asarray(sharpness, float)
        check_signs(self, positive=("sharpness",))

    def initial_state(self, position, increment) -> Float[Array, "6"]:
        """State (z, z') without twist."""
        return self._start(position, increment)

    def step(self, state, control) -> Float[Array, "6"]:
        equation, guides = SliderEquation.of(self.parameters), each(self.friction)

        @jax.checkpoint  # reverse mode computes a stage again instead of storing it
        def rates(x):
            z, v = x[:3], x[3:]
            masses, forces = equation.masses_and_forces(z, v, control)
            parts = zip(forces, guides, v, strict=True)
            net = [f - guide.smooth(speed, self.sharpness) for f, guide, speed in parts]
            return jnp.stack([*v, *masses.solved(net)])

        h = self.dt / self.substeps
        return jax.lax.fori_loop(0, self.substeps, lambda _, x: runge_kutta(rates, x, h), state)

    def measure(self, state) -> Float[Array, "6"]:
        """State (q, q') of `Gantry`."""
        return self.parameters.coordinates(state)


def _slipping(mode: Int[Array, "3"], speed: OfSliders) -> OfSliders:
    """Speeds of the sliders that move as their modes say, zero for the others; a NaN stays one."""
    return jnp.where(mode.astype(speed.dtype) * speed <= 0, 0, speed)


def each(friction: Friction) -> list[Friction]:
    """Friction of each slider."""
    return [jax.tree.map(lambda values, k=k: values[k], friction) for k in range(SLIDERS)]
