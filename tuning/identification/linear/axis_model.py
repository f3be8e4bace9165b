"""One axis as a discrete transfer function from its command to its position.

    G(q) = q^-d  (b_1 q^-1 + ... + b_m q^-m) / ((1 + a_1 q^-1 + ... + a_n q^-n) (1 - q^-1)^i)

i integrators: none for a drive that takes a position, one for a speed (or a force against viscous
friction, whose pole is in a), two for a force without friction.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import newton


@dataclass(frozen=True)
class AxisModel:
    """A discrete axis."""

    denominator: Float[np.ndarray, " n"]  # a_1..a_n.
    # b_1..b_m [position per unit of command, summed over the integrators].
    numerator: Float[np.ndarray, " m"]
    integrators: int  # i
    delay: int  # d [samples] beside the one that every sampled axis has
    dt: float  # sample period [s]

    @property
    def order(self) -> int:
        """States without the delay."""
        return len(self.denominator) + self.integrators

    @property
    def below(self) -> Float[np.ndarray, " _"]:
        """All of the denominator, with the integrators."""
        polynomial = np.concatenate([[1.0], self.denominator])
        for _ in range(self.integrators):
            polynomial = np.convolve(polynomial, [1.0, -1.0])
        return polynomial

    @property
    def above(self) -> Float[np.ndarray, " _"]:
        """All of the numerator, with the delay."""
        return np.concatenate([np.zeros(self.delay + 1), self.numerator])

    @property
    def poles(self) -> Complex[np.ndarray, " n"]:
        """Roots of a: all poles but the integrators."""
        return np.roots(np.concatenate([[1.0], self.denominator])).astype(complex)

    def response(self, frequency: Float[np.ndarray, " F"]) -> Complex[np.ndarray, " F"]:
        """Complex transfer over frequency [rad/s]."""
        return np.exp(self.log_terms(frequency)[0])

    def log_terms(
        self, frequency: Float[np.ndarray, " F"]
    ) -> tuple[Complex[np.ndarray, " F"], Complex[np.ndarray, "F p"]]:
        """ln G and its slopes over (a, b), over frequency [rad/s]."""
        back = np.exp(-1j * np.asarray(frequency) * self.dt)[:, None]
        n, m = len(self.denominator), len(self.numerator)
        a = back ** np.arange(1, n + 1)
        b = back ** np.arange(1, m + 1)
        below, above = 1 + a @ self.denominator, b @ self.numerator
        back = back[:, 0]
        with np.errstate(divide="ignore"):
            value = np.log(above / below * back**self.delay / (1 - back) ** self.integrators)
        return value, np.concatenate([-a / below[:, None], b / above[:, None]], axis=1)

    def realisation(
        self, line: int = 0
    ) -> tuple[Float[np.ndarray, "s s"], Float[np.ndarray, "s 1"], Float[np.ndarray, "1 s"]]:
        """A, B, C of the axis with `line` samples of delay.

        Observer form in d = (z - 1) / h, h the distance of the farthest pole from one: poles of an
        axis that is sampled fast lie close to one, and powers of z hardly tell them apart
        (Middleton & Goodwin, Digital Control and Estimation, 1990). x_1 is the position, and the
        delayed commands come last.
        """
        size = max(self.order, len(self.numerator))
        away, late = self.poles - 1, np.zeros(size - self.order)  # these have ended in a sample
        h = float(np.max(np.abs(away), initial=0.0)) or 1.0
        slow = np.zeros(self.integrators)
        below = np.real(np.poly(np.concatenate([away, slow, late - 1]) / h))
        above, last = np.zeros(1), size - len(self.numerator)
        for number in [*self.numerator, *np.zeros(last)]:  # Horner's rule in 1 + h d
            above = np.polyadd(np.polymul(above, [h, 1.0]), [number])
        A = np.zeros((size + line, size + line))
        A[:size, :size] = np.eye(size) + h * np.eye(size, k=1)
        A[:size, 0] -= h * below[1:]
        column = np.pad(above, (size, 0))[-size:] * h ** (1 - size)
        B = np.zeros((size + line, 1))
        if line:
            A[:size, size + line - 1] = column
            A[size + 1 :, size : size + line - 1] = np.eye(line - 1)
            B[size] = 1.0
        else:
            B[:size, 0] = column
        return A, B, np.eye(1, size + line)


RINGS = 0.3  # damping below which a pair of poles or zeros is a resonance or an antiresonance
BELOW = np.array([3.0, 5.0])  # antiresonance over frequencies at which the total mass is read
ALIKE = 1.25  # ratio of the two that is that of a free mass


class TwoMasses(NamedTuple):
    """Masses [kg] and stiffness [N/m] of an axis, of one that turns [kg m^2] and [N m/rad]."""

    motor: float
    load: float
    stiffness: float


def two_masses(model: AxisModel, force: float) -> TwoMasses | None:
    """Parameters of the first antiresonance and the resonance above it; None without such a pair.

        G(s) = F (m_2 s^2 + k) / (s^2 (m_1 m_2 s^2 + (m_1 + m_2) k)),
        w_a^2 = k / m_2,    w_r^2 = k (1 / m_1 + 1 / m_2)
    with the encoder at the motor m_1, and F the force of one unit of the command. Well below both,
    Re(1 / G) = -(m_1 + m_2) w^2 (1 - w^2 / w_r^2) / (1 - w^2 / w_a^2) / F: viscous friction is in
    the imaginary part.

    Args:
        model: from the command to the position of the motor.
        force: of one unit of the command [N or N m].
    """
    both = model.poles, np.roots(model.numerator)
    poles, zeros = (np.abs(_rates(one, model.dt)) for one in both)
    w_a = zeros.min(initial=np.inf)
    above = poles[poles > w_a]
    if not above.size:
        return None
    w_r, w = above.min(), w_a / BELOW
    late = np.exp(1j * w * model.dt * (model.delay + 0.5))  # the command is held over a sample
    shape = w**2 * (1 - (w / w_r) ** 2) / (1 - (w / w_a) ** 2)
    total, lower = -np.real(1 / (model.response(w) * late)) * force / shape
    if not 1 / ALIKE < total / lower < ALIKE or total < 0:  # a loop holds the axis
        return None
    load = float(total * (1 - (w_a / w_r) ** 2))
    return TwoMasses(float(total) - load, load, float(w_a**2 * load))


def _rates(roots: np.ndarray, dt: float) -> np.ndarray:
    """Rates ln(z) / dt of pairs of discrete poles or zeros that ring, the slowest first."""
    rates = np.log(roots[np.imag(roots) > 0]) / dt
    rates = rates[-np.real(rates) < RINGS * np.abs(rates)]
    return rates[np.argsort(np.abs(rates))]


STIFFNESS = np.linspace(0.0, 0.9, 10) ** 2  # shares of it that a gap leaves: modes 10 % apart
# of a load that dry friction holds, c / (m w_a); where it is more, it holds the motor too
DAMPING = np.geomspace(0.125, 2.0, 9)
SPAN, PLACES = 4.0, 16  # times both frequencies of a coupling, as far as it matters; how many
FOUND = 0.3  # relative distance of a root from where it was looked for
BESIDE = np.array([-3.0, -1.0, 0.0, 1.0, 3.0])  # half widths of a peak


def other_amplitudes(
    model: AxisModel, highest: float
) -> tuple[Float[np.ndarray, " F"], Complex[np.ndarray, " F"]]:
    """How far the response is off at other amplitudes: through a gap, or with a load held.

    An oscillation that crosses a gap meets a share N of the stiffness behind it, between 0 and 1
    (describing function of a dead zone; Slotine & Li, Applied Nonlinear Control, section 5.3), and
    dry friction F of the load damps it by c = 4 F / (pi w a) at the amplitude a: the less, the more
    it moves. A loop that is stable with every N and every c does not keep an oscillation up. A
    motor that is measured has

        1 / T = 1 + d s + Z(s),    Z ~ s^k (s^2 + 2 z_r w_r s + w_r^2) / (s^2 + 2 z_a w_a s + w_a^2)
    with T its speed over that at rest, k = 1 and d = 0, or its position under a drive's loops,
    k = 2. Both frequencies go with sqrt(N), which makes Z / R of Z. With the load damped

        Z ~ s^(k - 1) (r s + q (s + g) / (s^2 + g s + q)),    q = 2 z_a w_a s + w_a^2
    instead, g the damping over the load's mass, which is 1 / r = (w_r / w_a)^2 - 1 of the motor's.

    Args:
        model: from the command to the position.
        highest: frequency to which it was measured [rad/s].

    Returns:
        Frequencies [rad/s] and relative errors; none where no antiresonance comes before the first
        resonance, or that was not measured: the encoder is not before a coupling, or none is seen.
    """
    size = max(len(model.denominator), len(model.numerator)) + 1
    below, above = np.zeros(size), np.zeros(size)
    below[: len(model.denominator) + 1] = [1.0, *model.denominator]
    above[1 : len(model.numerator) + 1] = model.numerator
    above *= below.sum() / above.sum()
    held = 0.0 if model.integrators == 2 else 1.0  # a mass without friction has no speed at rest
    d = model.dt * float(np.arange(size) @ (above - below)) / float(above.sum())
    d = d if model.integrators == 0 else 0.0

    def masses(s):
        back = np.exp(-s * model.dt)
        return np.polyval(below[::-1], back) / np.polyval(above[::-1], back) - held - d * s

    zeros = _rates(np.roots(model.numerator), model.dt)
    rigid = np.convolve(above, [held + d / model.dt, -d / model.dt])
    poles = _rates(np.roots(np.append(below, 0.0) - rigid), model.dt)
    # without the double one at rest
    poles = poles[np.abs(poles) > np.abs(zeros).min(initial=np.inf) / SPAN]
    if not (poles.size and abs(zeros[0]) < abs(poles[0])):
        return np.zeros(0), np.zeros(0, complex)
    zero, pole = zeros[0], newton(masses, poles[0], full_output=True, disp=False)[0]
    if not (abs(pole - poles[0]) < FOUND * abs(poles[0]) and abs(pole) < highest):
        return np.zeros(0), np.zeros(0, complex)
    ends, frequencies, ratios = (abs(zero) / SPAN, abs(pole) * SPAN), [], []
    load = 1 / (abs(pole / zero) ** 2 - 1)  # the motor's mass over the load's
    # a controller may be sharp where the model is
    sharp = np.concatenate([abs(one) + BESIDE * one.real for one in (zero, pole)])
    for share, damping in [*product(STIFFNESS, [0.0]), *product([1.0], DAMPING)]:
        soft = np.sqrt(share)
        w = np.unique(np.concatenate([np.geomspace(*ends, PLACES), sharp, soft * sharp]))
        w = w[(w > 0) & (w * model.dt < np.pi)]
        pairs = [_pair(1j * w, part * one) for part in (1.0, soft) for one in (zero, pole)]
        free, damped = (
            _damped(1j * w, soft * zero, load, one * abs(zero)) for one in (0.0, damping)
        )
        frequencies.append(w)  # and Z over what it is instead
        ratios.append(pairs[1] / pairs[0] * pairs[2] / pairs[3] * free / damped)
    w = np.concatenate(frequencies)
    rest, left = held + 1j * d * w, masses(1j * w)
    return w, (rest + left) / (rest + left / np.concatenate(ratios)) - 1


def _damped(s: np.ndarray, zero: complex, r: float, g: float) -> np.ndarray:
    """r s + q (s + g) / (s^2 + g s + q) of a motor and its load."""
    q = abs(zero) ** 2 - 2 * zero.real * s
    return r * s + q * (s + g) / (s**2 + g * s + q)


def _pair(s: Complex[np.ndarray, " F"], root: complex) -> Complex[np.ndarray, " F"]:
    """s^2 + 2 z w s + w^2 of a pair of roots."""
    return s**2 - 2 * root.real * s + abs(root) ** 2
