"""Feedback linearisation of the gantry: currents that cancel the coupling between head and beam (Yuan, section 5.4.2).

    i_x  = M_e / k_x       (-x_h theta'^2 + d theta'' + y_N'' s) + i'_x
    (5.30) i_y1 = M_e / k_y       (s x_h'' + d s theta'' - x_h s theta'^2 + 2 x_h' c theta' + d
    theta'^2 c) + i'_y1     (5.32) i_y2 = M_e / (k_y L)   (d x_h'' + d s y_N'' + 2 theta' x_h' x_h)
    + i'_y2                                 (5.34)
with nominal parameters. Nobody measures q''. We take it from the model that is to remain, under i',
with the head where it is:
    M_e x_h'' + b_x x_h' = k_x i'_x                                                 (5.31)
    M_t y_N'' + 2 b_y y_N' + m theta'' = k_y i'_y1                                  (5.33), the
    thesis's k_y1 is k_y m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta = k_y L i'_y2
    (5.35)
with m = M_e x_h - M_d L. That closes the algebraic loop: a plant of the nominal parameters then
moves as the model says, but for
    across    ((c - 1) m theta'' + M_d L s theta'^2)
    turning   ((c - 1) m y_N'' + 2 k_s L^2 s (1 - c) + (1 - c) k_y L i_y2 - (1 - c^2) 2 b_y L^2
    theta')
on the left sides: cos theta = 1 in the coupling, drives and friction of the beam, the springs
between drives and guides, and M_d in the centrifugal force. All are of second order in theta or of
first order in M_d theta.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.plants.gantry.disturbances import disturbances, largest_over_box
from jcontour.plants.gantry.gantry import EquationOfMotion, Triple
from jcontour.plants.gantry.motor_coordinates import MotorEncoders
from jcontour.plants.gantry.parameters import Coordinates, GantryParameters


def coupling_currents(
    nominal: GantryParameters, q: Coordinates, v: Coordinates, acceleration: Triple
) -> Float[Array, "3"]:
    """(i_x, i_y1, i_y2) - i' [A] of (5.30), (5.32), (5.34)."""
    motion, (x, _, theta), (dx, _, omega), (ddx, ddy, turning) = (
        EquationOfMotion.of(nominal),
        q,
        v,
        acceleration,
    )
    d, sine, cosine = motion.tool_offset, jnp.sin(theta), jnp.cos(theta)
    along = -x * omega**2 + d * turning + ddy * sine
    across = sine * (ddx + d * turning - x * omega**2) + cosine * omega * (2 * dx + d * omega)
    around = d * (ddx + sine * ddy) + 2 * omega * dx * x
    constants = jnp.stack([motion.head_constant, motion.beam_constant, motion.turning_constant])
    return motion.head_mass * jnp.stack([along, across, around]) / constants


def motor_currents(combined: Float[Array, "3"]) -> Float[Array, "3"]:
    """(i_x, i_y1, i_y2) -> (i_x, i_1, i_2): i_1 = (i_y1 - i_y2) / 2, i_2 = (i_y1 + i_y2) / 2 (5.44), the thesis's y_y2 is i_y2."""
    i_x, both, difference = combined
    return jnp.stack([i_x, (both - difference) / 2, (both + difference) / 2])


def uncoupled_acceleration(
    nominal: GantryParameters, q: Coordinates, v: Coordinates, control: Float[Array, "3"]
) -> Triple:
    """q'' of (5.31), (5.33), (5.35) under currents i' = (i'_x, i'_1, i'_2), with the head where it is."""
    motion, (dx, dy, omega), (i_x, i_1, i_2) = EquationOfMotion.of(nominal), v, control
    across = motion.beam_constant * (i_1 + i_2) - motion.beam_viscous * dy
    turning = (
        motion.turning_constant * (i_2 - i_1)
        - motion.turning_viscous * omega
        - motion.joints * q[2]
    )
    mass, inertia, m = (
        motion.total_mass,
        motion.inertia + motion.head_mass * q[0] ** 2,
        motion.head_mass * q[0] - motion.imbalance,
    )
    determinant = mass * inertia - m**2
    head = (motion.head_constant * i_x - motion.head_viscous * dx) / motion.head_mass
    return (
        head,
        (inertia * across - m * turning) / determinant,
        (mass * turning - m * across) / determinant,
    )


def linearising_currents(
    nominal: GantryParameters, state: Float[Array, "6"], control: Float[Array, "3"]
) -> Float[Array, "3"]:
    """What the motors get beside i' = (i'_x, i'_1, i'_2) in a state of `Gantry` [A]: i_f of (5.44)."""
    q, v = state[:3], state[3:]
    return motor_currents(
        coupling_currents(nominal, q, v, uncoupled_acceleration(nominal, q, v, control))
    )


class EncoderLinearisation(eqx.Module):
    """`linearising_currents` from what `MotorEncoders` read."""

    nominal: GantryParameters

    def __call__(self, reading: Float[Array, "6"], control: Float[Array, "3"]) -> Float[Array, "3"]:
        """Currents to add to i' [A]."""
        return linearising_currents(
            self.nominal, MotorEncoders(self.nominal).state(reading), control
        )


def residuals(
    parameters: GantryParameters,
    nominal: GantryParameters,
    head,
    state: Float[Array, "6"],
    control: Float[Array, "3"],
) -> Float[Array, "3"]:
    """(eta_x [N], eta_1 [N], eta_2 [N m]): what (5.31), (5.33), (5.35) leave out under i' = `control` and the currents that linearise.

    Left sides less the currents' forces, with accelerations and parameters of the plant, m and J at
    xbar. The thesis's sums, which have eta_x = (k_x M_e' / k_x' - M_e) c_x(q'') for the bracket c_x
    of (5.30), take q'' as measured; the q'' of our model, a, leaves k_x M_e' / k_x' c_x(a) - M_e
    c_x(q''), which differs from them where the parameters do; so for eta_1, eta_2.

    Args:
        parameters: of the plant.
        nominal: of the compensation.
        head: xbar [m].
        state: of `Gantry`.
        control: i'.

    Raises:
        ValueError: the point of linearisation is outside the beam.
    """
    added = linearising_currents(nominal, state, control)
    d_x, d_1, d_2 = disturbances(parameters, head, state, control + added)
    (i_x, i_1, i_2), p = added, parameters
    beam = d_1 + p.drive_constant * (i_1 + i_2)
    return jnp.stack(
        [
            p.head_mass * d_x + p.head_constant * i_x,
            beam,
            d_2 + p.drive_constant * p.half_span * (i_2 - i_1),
        ]
    )


def residual_bounds(
    parameters: GantryParameters,
    nominal: GantryParameters,
    head,
    low: Float[ArrayLike, "9"],
    high: Float[ArrayLike, "9"],
) -> Float[np.ndarray, "3"]:
    """Largest |eta_x|, |eta_1|, |eta_2| over a box of states and currents i'; errors as `disturbance_bounds`."""
    return largest_over_box(
        lambda state, control: residuals(parameters, nominal, head, state, control),
        parameters,
        low,
        high,
    )
