"""What the gantry's linear model leaves out, as disturbances of it (Yuan, section 5.3.1).

    d_x = x_h'' + b_x / M_e x_h' - k_x / M_e i_x                                   [m/s^2]
    d_1 = M_t y_N'' + 2 b_y y_N' + m theta'' - k_y (i_1 + i_2)                     [N]
    d_2 = m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta - k_y L (i_2 - i_1)   [N m]
with the accelerations of (5.7)-(5.9), m and J those of the point of linearisation: so (5.13)-(5.15)
hold exactly under them. The thesis writes them out term by term, without those in x_h - xbar and
with a misprint (see `gantry_linear`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from scipy.optimize import minimize

from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.parameters import GantryParameters, check_on_beam

STARTS = 48  # of the search for the largest disturbance, corners of the box and points inside


def disturbances(
    parameters: GantryParameters, head, state: Float[Array, "6"], control: Float[Array, "3"]
) -> Float[Array, "3"]:
    """(d_x, d_1, d_2) of the model at the head position xbar = `head` [m], in a state of `Gantry` under currents (i_x, i_1, i_2).

    Raises:
        ValueError: the point of linearisation is outside the beam.
    """
    check_on_beam("head", head, parameters)
    motion, p = EquationOfMotion.of(parameters), parameters
    q, (x, y, turn), (i_x, i_1, i_2) = state[:3], state[3:], control
    ddx, ddy, ddturn = motion.acceleration(q, state[3:], control)
    m, J, L = p.head_mass * head - motion.imbalance, p.inertia(head), p.half_span
    d_x = ddx + (p.head_viscous * x - p.head_constant * i_x) / p.head_mass
    d_1 = p.total_mass * ddy + 2 * p.drive_viscous * y + m * ddturn - p.drive_constant * (i_1 + i_2)
    resisting = 2 * p.drive_viscous * L**2 * turn + 2 * p.joint_stiffness * q[2]
    return jnp.stack(
        [d_x, d_1, m * ddy + J * ddturn + resisting - p.drive_constant * L * (i_2 - i_1)]
    )


def disturbance_bounds(
    parameters: GantryParameters, head, low: Float[ArrayLike, "9"], high: Float[ArrayLike, "9"]
) -> Float[np.ndarray, "3"]:
    """Largest |d_x|, |d_1|, |d_2| over a box of states and currents, (x_h, y_N, theta, rates, i_x, i_1, i_2) from `low` to `high`.

    Raises:
        ValueError: the box is not one of nine finite intervals, or it or the point of linearisation
            leaves the beam.
    """
    return largest_over_box(
        lambda state, control: disturbances(parameters, head, state, control), parameters, low, high
    )


def largest_over_box(
    terms: Callable[[Array, Array], Array],
    parameters: GantryParameters,
    low: Float[ArrayLike, "9"],
    high: Float[ArrayLike, "9"],
) -> Float[np.ndarray, "3"]:
    """Largest absolute values of three `terms` of state and currents over a box of them.

    Found by climbing from corners and points of the box: nothing larger was met, which is no proof.

    Raises:
        ValueError: the box is not one of nine finite intervals, or it leaves the beam.
    """
    low, high = np.asarray(low, float), np.asarray(high, float)
    if (
        low.shape != (9,)
        or high.shape != (9,)
        or not np.all(np.isfinite(low) & np.isfinite(high) & (low <= high))
    ):
        raise ValueError(
            f"low, high: need nine finite numbers each with low <= high, received {low} and {high}"
        )
    check_on_beam("low, high", np.array([low[0], high[0]]), parameters)
    random = np.random.default_rng(0)
    shares = np.concatenate(
        [random.integers(0, 2, (STARTS // 2, 9)), random.random((STARTS // 2, 9))]
    )

    @jax.jit
    def fallen(share, which, sign):
        z = low + share * (high - low)
        return jax.value_and_grad(lambda z: -sign * terms(z[:6], z[6:])[which])(z)

    def climb(share, which, sign):
        def value(share):
            f, slope = fallen(share, which, sign)
            return float(f), np.asarray(slope) * (high - low)

        return -minimize(value, share, jac=True, bounds=[(0, 1)] * 9, method="L-BFGS-B").fun

    return np.array(
        [
            max(climb(share, which, sign) for share in shares for sign in (1.0, -1.0))
            for which in range(3)
        ]
    )
