"""Terms that the gantry's linear model leaves out, as disturbances of it (Yuan, section 5.3.1).

    d_x = x_h'' + b_x / M_e x_h' - k_x / M_e i_x                                   [m/s^2]
    d_1 = M_t y_N'' + 2 b_y y_N' + m theta'' - k_y (i_1 + i_2)                     [N]
    d_2 = m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta - k_y L (i_2 - i_1)   [N m]
with the accelerations of (5.7)-(5.9), and m and J at the point of linearisation. Under them
(5.13)-(5.15) hold exactly. The thesis writes them out term by term, without the terms in
x_h - xbar and with a misprint (see `linear_models`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Shaped

from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.parameters import GantryParameters, check_on_beam

STARTS = 48  # of the search for the largest disturbance, corners of the box and points inside


def disturbances(
    parameters: GantryParameters, head, state: Float[Array, "6"], control: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Disturbances (d_x, d_1, d_2) of the linear model at a head position.

    Args:
        parameters: of the machine.
        head: xbar [m].
        state: state of `Gantry`.
        control: currents (i_x, i_1, i_2) [A].

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
    d_2 = m * ddy + J * ddturn + resisting - p.drive_constant * L * (i_2 - i_1)
    return jnp.stack([d_x, d_1, d_2])


def disturbance_bounds(
    parameters: GantryParameters,
    head,
    low: Shaped[ArrayLike, "..."],
    high: Shaped[ArrayLike, "..."],
) -> Float[np.ndarray, "3"]:
    """Largest |d_x|, |d_1|, |d_2| over a box of states and currents.

    Args:
        parameters: of the machine.
        head: xbar [m].
        low: corner (9,) of the box: (x_h, y_N, theta, rates, i_x, i_1, i_2).
        high: the opposite corner.

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
    low: Shaped[ArrayLike, "..."],
    high: Shaped[ArrayLike, "..."],
) -> Float[np.ndarray, "3"]:
    """Largest absolute values of three `terms` of state and currents over a box of them.

    They are found by climbing from corners and points of the box. Nothing larger was met, which is
    no proof.

    Raises:
        ValueError: the box is not one of nine finite intervals, or it leaves the beam.
    """
    # SciPy's optimisers take half a second to import: only a search needs them
    from scipy.optimize import minimize

    low, high = np.asarray(low, float), np.asarray(high, float)
    nine = low.shape == high.shape == (9,)
    if not nine or not np.all(np.isfinite(low) & np.isfinite(high) & (low <= high)):
        raise ValueError(
            f"low, high: need nine finite numbers each with low <= high, received {low} and {high}"
        )
    check_on_beam("low, high", np.array([low[0], high[0]]), parameters)
    random = np.random.default_rng(0)
    corners = random.integers(0, 2, (STARTS // 2, 9))
    shares = np.concatenate([corners, random.random((STARTS // 2, 9))])

    @jax.jit
    def fallen(share, which, sign):
        z = low + share * (high - low)
        return jax.value_and_grad(lambda z: -sign * terms(z[:6], z[6:])[which])(z)

    def climb(share, which, sign):
        def value(share):
            f, slope = fallen(share, which, sign)
            return float(f), np.asarray(slope) * (high - low)

        return -minimize(value, share, jac=True, bounds=[(0, 1)] * 9, method="L-BFGS-B").fun

    def largest(which):
        return max(climb(share, which, sign) for share in shares for sign in (1.0, -1.0))

    return np.array([largest(which) for which in range(3)])
