"""Feedback linearisation of the gantry: currents cancel the coupling of head and beam.

Yuan, section 5.4.2, with nominal parameters:

    i_x  = M_e / k_x       (-x_h theta'^2 + d theta'' + y_N'' s) + i'_x                 (5.30)
    i_y1 = M_e / k_y       (s x_h'' + d s theta'' - x_h s theta'^2 + 2 x_h' c theta'
                            + d theta'^2 c) + i'_y1                                     (5.32)
    i_y2 = M_e / (k_y L)   (d x_h'' + d s y_N'' + 2 theta' x_h' x_h) + i'_y2            (5.34)
No sensor measures q''. We take it from the model that is to remain, under i', with the head where
it is:

    M_e x_h'' + b_x x_h' = k_x i'_x                                                     (5.31)
    M_t y_N'' + 2 b_y y_N' + m theta'' = k_y i'_y1                                      (5.33)
    m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta = k_y L i'_y2                  (5.35)
with m = M_e x_h - M_d L; the thesis's k_y1 in (5.33) is k_y. This closes the algebraic loop. A
plant of the nominal parameters then moves as the model says, but for these terms on the left sides:

    across    (c - 1) m theta'' + M_d L s theta'^2
    turning   (c - 1) m y_N'' + 2 k_s L^2 s (1 - c) + (1 - c) k_y L i_y2
              - (1 - c^2) 2 b_y L^2 theta'
They come from cos theta = 1 in the coupling, the drives and the friction of the beam, from the
springs between drives and guides, and from M_d in the centrifugal force. All are of second order in
theta or of first order in M_d theta.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.plants.gantry.gantry import Coordinates, EquationOfMotion, GantryParameters, Triple
from jcontour.plants.gantry.linear_models import MotorEncoders


def coupling_currents(
    nominal: GantryParameters, q: Coordinates, v: Coordinates, acceleration: Triple
) -> Float[Array, "3"]:
    """Added currents (i_x, i_y1, i_y2) - i' [A] of (5.30), (5.32), (5.34)."""
    motion = EquationOfMotion.of(nominal)
    (x, _, theta), (dx, _, omega), (ddx, ddy, turning) = q, v, acceleration
    d, sine, cosine = motion.tool_offset, jnp.sin(theta), jnp.cos(theta)
    along = -x * omega**2 + d * turning + ddy * sine
    across = sine * (ddx + d * turning - x * omega**2) + cosine * omega * (2 * dx + d * omega)
    around = d * (ddx + sine * ddy) + 2 * omega * dx * x
    constants = jnp.stack([motion.head_constant, motion.beam_constant, motion.turning_constant])
    return motion.head_mass * jnp.stack([along, across, around]) / constants


def motor_currents(combined: Float[Array, "3"]) -> Float[Array, "3"]:
    """Motor currents (i_x, i_1, i_2) from the combined currents (i_x, i_y1, i_y2), eq. 5.44.

        i_1 = (i_y1 - i_y2) / 2,   i_2 = (i_y1 + i_y2) / 2
    The thesis's y_y2 is i_y2.
    """
    i_x, both, difference = combined
    return jnp.stack([i_x, (both - difference) / 2, (both + difference) / 2])


def uncoupled_acceleration(
    nominal: GantryParameters, q: Coordinates, v: Coordinates, control: Float[Array, "3"]
) -> Triple:
    """Acceleration q'' of (5.31), (5.33), (5.35) under currents i' = (i'_x, i'_1, i'_2).

    The head is taken where it is.
    """
    motion, (dx, dy, omega), (i_x, i_1, i_2) = EquationOfMotion.of(nominal), v, control
    across = motion.beam_constant * (i_1 + i_2) - motion.beam_viscous * dy
    driven = motion.turning_constant * (i_2 - i_1)
    turning = driven - motion.turning_viscous * omega - motion.joints * q[2]
    mass = motion.total_mass
    inertia = motion.inertia + motion.head_mass * q[0] ** 2
    m = motion.head_mass * q[0] - motion.imbalance
    determinant = mass * inertia - m**2
    head = (motion.head_constant * i_x - motion.head_viscous * dx) / motion.head_mass
    beam = (inertia * across - m * turning) / determinant
    return head, beam, (mass * turning - m * across) / determinant


def linearising_currents(
    nominal: GantryParameters, state: Float[Array, "6"], control: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Currents i_f of (5.44) [A], added to i' = (i'_x, i'_1, i'_2) in a state of `Gantry`."""
    q, v = state[:3], state[3:]
    acceleration = uncoupled_acceleration(nominal, q, v, control)
    return motor_currents(coupling_currents(nominal, q, v, acceleration))


class EncoderLinearisation(eqx.Module):
    """`linearising_currents` from the reading of `MotorEncoders`."""

    nominal: GantryParameters

    def __call__(self, reading: Float[Array, "6"], control: Float[Array, "3"]) -> Float[Array, "3"]:
        """Currents that are added to i' [A]."""
        state = MotorEncoders(self.nominal).state(reading)
        return linearising_currents(self.nominal, state, control)
