"""The gantry in the coordinates of its motors: one number for the head and for each drive.

    M_z z'' = f(z, z', u),   z = (x_h, y_1, y_2),   z' = J(q) q'
    M_z = J^-T M J^-1,   f = J^-T (Q - h - M (J^-1)' z')        from (5.7)-(5.9)
Head and drives are the sliders. A slider that is held is left out of the equation: its speed and
its position then do not change by a bit.
"""

from collections.abc import Iterable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jcontour.plants.gantry.gantry import EquationOfMotion, Triple
from jcontour.plants.gantry.parameters import GantryParameters, Scalar

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
