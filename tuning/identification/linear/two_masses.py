"""Masses of motor and load and the spring between them, from a model with the encoder at the motor.

    G(s) = F (m_2 s^2 + k) / (s^2 (m_1 m_2 s^2 + (m_1 + m_2) k)),
    w_a^2 = k / m_2,    w_r^2 = k (1 / m_1 + 1 / m_2)

with the antiresonance w_a below the resonance w_r, and F the force of one unit of the command. Well
below both, Re(1 / G) = -(m_1 + m_2) w^2 (1 - w^2 / w_r^2) / (1 - w^2 / w_a^2) / F: viscous friction
is in the imaginary part.
"""

from typing import NamedTuple

import numpy as np

from tuning.identification.linear.axis_model import AxisModel

RINGS = 0.3  # damping below which a pair of poles or zeros is a resonance or an antiresonance
BELOW = 3.0  # antiresonance over the frequency at which the total mass is read


class TwoMasses(NamedTuple):
    """Masses [kg] and stiffness [N/m] of an axis, of one that turns [kg m^2] and [N m/rad]."""

    motor: float
    load: float
    stiffness: float


def two_masses(model: AxisModel, force: float) -> TwoMasses | None:
    """Parameters of the first antiresonance and the resonance above it; None without such a pair.

    Args:
        model: from the command to the position of the motor.
        force: of one unit of the command [N or N m].
    """
    poles, zeros = (_ringing(one, model.dt) for one in (model.poles, np.roots(model.numerator)))
    w_a = zeros.min(initial=np.inf)
    above = poles[poles > w_a]
    if not model.integrators or not above.size:
        return None
    w_r, w = above.min(), w_a / BELOW
    late = np.exp(1j * w * model.dt * (model.delay + 0.5))  # the command is held over a sample
    inverse = 1 / (model.response(np.array([w])) * late)
    shape = w**2 * (1 - (w / w_r) ** 2) / (1 - (w / w_a) ** 2)
    total = float(-np.real(inverse)[0]) * force / shape
    load = total * (1 - (w_a / w_r) ** 2)
    return TwoMasses(total - load, load, float(w_a**2 * load))


def _ringing(roots: np.ndarray, dt: float) -> np.ndarray:
    """Natural frequencies [rad/s] of pairs of discrete poles or zeros that ring."""
    rates = np.log(roots[np.imag(roots) > 0]) / dt
    return np.abs(rates)[-np.real(rates) < RINGS * np.abs(rates)]
