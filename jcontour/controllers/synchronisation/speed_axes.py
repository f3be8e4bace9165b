"""Axes whose speed follows the control with one lag, as adaptive synchronisation sees them.

w' = -a w + b (u + d)                          Tomizuka et al. (1990), eq. 1
w(k+1) = a_d w(k) + b_d (u(k) + d),   a_d = exp(-a T),  b_d = (b / a) (1 - a_d)        eq. 10

Adaptive synchronisation of two axes in continuous time (eqs. 6-8), with C = [[1 + beta, -beta],
[-beta, 1 + beta]]:

    w_i' = -a_i w_i + b_i (u_i + d_i),     e_i = w_d - w_i,     e* = C e
    u_i = k_c,i e*_i + theta_i . phi,      theta_i' = gamma phi e*_i,     phi = (w_d, w_d', v_c)
The speeds start at w_d, the estimates where they fit the axes without load.

Three bounds tell how strongly two axes may be coupled. In continuous time beta has to keep (9)
positive definite,

    [[a_1/b_1 + (1 + beta) k_c1,  -beta (k_c1 + k_c2)/2],
     [-beta (k_c1 + k_c2)/2,      a_2/b_2 + (1 + beta) k_c2]] > 0.
Sampled, with K = max (gamma/2) phi.phi, it is enough that (17) is strictly positive real,

    (A_c0 - A_c1 z^-1)^-1,   A_c0 = B^-1 - K C,   A_c1 = B^-1 A - diag(k_c) C
with A = diag(a_d), B = diag(b_d). That is sufficient
only. With a steady reference the loop is linear, and stable exactly while its radius is below one:

    e(k+1) = (A - B diag(k_c) C) e(k) - B s(k),   s(k+1) = s(k) + 2 K C e(k+1).
"""

import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

from jcontour._arrays import check_above_zero
from jcontour.linear.plant import spectral_radius


class SpeedAxes(NamedTuple):
    """Poles and gains of the axes.

    >>> axes = speed_axes(pole=10.0, gain=[50.0, 40.0])
    >>> axes.feedforward().tolist()
    [[0.2, 0.02, 0.0], [0.25, 0.025, 0.0]]
    """

    pole: Float[np.ndarray, " m"]  # a [rad/s]
    gain: Float[np.ndarray, " m"]  # b [speed per second and unit of control]

    def sampled(self, dt: float) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """(a_d, b_d) under zero-order hold."""
        lost = -np.expm1(-self.pole * dt)
        return 1 - lost, self.gain / self.pole * lost

    def feedforward(self, dt: float | None = None) -> Float[np.ndarray, "m 3"]:
        """Estimates that fit the axes without load.

        Continuous: (a/b, 1/b, 0) for (w_d, w_d', v_c); sampled: (-a_d/b_d, 1/b_d, 0) for (w_d(k),
        w_d(k+1), v_c). Appendix A prints -1/b_d.
        """
        none = np.zeros_like(self.pole)
        if dt is None:
            return np.stack([self.pole / self.gain, 1 / self.gain, none], axis=-1)
        a_d, b_d = self.sampled(dt)
        return np.stack([-a_d / b_d, 1 / b_d, none], axis=-1)


def speed_axes(pole, gain) -> SpeedAxes:
    """Axes with these poles [rad/s] and gains; one number stands for all axes.

    Raises:
        ValueError: a number is not finite or not above zero.
    """
    pole, gain = np.broadcast_arrays(np.atleast_1d(pole), np.atleast_1d(gain))
    check_above_zero(pole=pole, gain=gain)
    return SpeedAxes(np.array(pole, float), np.array(gain, float))


ACCURACY = 1e-12  # relative and absolute, of the integrator: results are good to 1e-10


class ContinuousGains(NamedTuple):
    """Gains of the law."""

    proportional: Float[np.ndarray, "2"]  # k_c of every axis (2,)
    adaptation: float  # gamma
    coupling: float  # beta
    bias: float = 1.0  # v_c


class Motion(NamedTuple):
    """What happens to the axes."""

    speed: Callable[[float], float]  # w_d at a time [s]
    slope: Callable[[float], float]  # its derivative
    load: Callable[[float], Float[np.ndarray, "2"]]  # d of both axes at a time, in units of control
    # times at which one of them jumps; the integrator starts anew there
    jumps: Sequence[float] = ()


class Response(NamedTuple):
    """Errors and estimates of both axes at the instants asked for."""

    times: Float[np.ndarray, " S"]  # [s]
    error: Float[np.ndarray, "S 2"]
    estimate: Float[np.ndarray, "S 2 3"]


def coupling_matrix(coupling: float) -> Float[np.ndarray, "2 2"]:
    """C = [[1 + beta, -beta], [-beta, 1 + beta]]."""
    return np.eye(2) + coupling * np.array([[1.0, -1.0], [-1.0, 1.0]])


def continuous_response(
    axes: SpeedAxes, gains: ContinuousGains, motion: Motion, times: Float[np.ndarray, " S"]
) -> Response:
    """Response from time zero, at the instants `times` [s].

    >>> from jcontour.controllers.synchronisation.speed_axes import speed_axes
    >>> steady = Motion(lambda t: 1.0, lambda t: 0.0, lambda t: np.array([0.0, 1.0]))
    >>> gains = ContinuousGains(np.array([0.3, 0.3]), 11.0, 0.0)
    >>> run = continuous_response(speed_axes(10.0, [50.0, 50.0]), gains, steady, np.array([0.0]))
    >>> run.error.tolist()
    [[0.0, 0.0]]

    Raises:
        ValueError: there are not two axes, or the times do not increase from zero on.
        RuntimeError: the integrator gives up.
    """
    times = np.asarray(times, float)
    if len(axes.pole) != 2:
        raise ValueError(f"axes: synchronisation needs two, received {len(axes.pole)}")
    if times.size == 0 or times[0] < 0 or np.any(np.diff(times) <= 0):
        raise ValueError("times: need to increase, from zero on")
    slopes = _slopes(axes, gains, motion)
    start = np.concatenate([np.full(2, motion.speed(0.0)), axes.feedforward().ravel()])
    ends = [jump for jump in sorted(motion.jumps) if 0 < jump < times[-1]]
    rows, begin = [], 0.0
    for end in (*ends, times[-1]):
        inside = times[(times >= begin) & (times < end)]
        states = _integrated(slopes, start, begin, end, inside)
        rows.append(states[:-1])
        start, begin = states[-1], end
    state = np.concatenate([*rows, start[None]])
    wanted = np.array([motion.speed(t) for t in times])
    return Response(times, wanted[:, None] - state[:, :2], state[:, 2:].reshape(-1, 2, 3))


def _slopes(axes: SpeedAxes, gains: ContinuousGains, motion: Motion):
    """Right side of the differential equation; the load at a jump is that of after it."""
    C = coupling_matrix(gains.coupling)

    def slopes(t, state):
        speed, estimate = state[:2], state[2:].reshape(2, 3)
        signals = np.array([motion.speed(t), motion.slope(t), gains.bias])
        error = C @ (signals[0] - speed)
        control = gains.proportional * error + estimate @ signals
        acceleration = -axes.pole * speed + axes.gain * (control + motion.load(t))
        return np.concatenate([acceleration, np.outer(gains.adaptation * error, signals).ravel()])

    return slopes


def _integrated(slopes, start, begin: float, end: float, inside) -> Float[np.ndarray, "S n"]:
    """States at the instants inside, and at the end."""
    before = np.nextafter(end, begin)  # a load that jumps at the end has not jumped yet

    def held(t, state):
        return slopes(min(t, before), state)

    if end <= begin:
        return start[None]
    at = np.append(inside, end)
    solution = solve_ivp(held, (begin, end), start, "DOP853", at, rtol=ACCURACY, atol=ACCURACY)
    if not solution.success:
        raise RuntimeError(f"synchronisation: the integrator stopped: {solution.message}")
    return solution.y.T


STRONGEST = 1e9  # couplings beyond are not looked at
GRID = 400  # couplings in which the first crossing is looked for


class SampledLoop(NamedTuple):
    """Two sampled axes under the law, all but beta."""

    a_d: Float[np.ndarray, "2"]  # poles (2,)
    b_d: Float[np.ndarray, "2"]  # gains (2,)
    proportional: Float[np.ndarray, "2"]  # k_c (2,)
    adaptation: float  # K = max (gamma/2) phi.phi


def sampled_loop(
    axes: SpeedAxes, proportional, adaptation: float, speed: float, dt: float, bias: float = 1.0
) -> SampledLoop:
    """Loop of two axes whose reference is at most this fast.

        K = (gamma/2) (2 speed^2 + v_c^2)                                              (18)

    >>> from jcontour.controllers.synchronisation.speed_axes import speed_axes
    >>> loop = sampled_loop(speed_axes(10.0, [50.0, 50.0]), 0.3, 0.022, speed=1.0, dt=2e-3)
    >>> round(loop.adaptation, 6), round(exact_bound(loop), 4)
    (0.033, 29.531)

    Args:
        axes: the two axes.
        proportional: k_c, one number or two.
        adaptation: gamma.
        speed: largest speed of the reference.
        dt: sample period [s].
        bias: v_c.

    Raises:
        ValueError: there are not two axes, or a number is negative or not finite.
    """
    if len(axes.pole) != 2:
        raise ValueError(f"axes: synchronisation needs two, received {len(axes.pole)}")
    numbers = {"proportional": proportional, "adaptation": adaptation, "speed": speed, "dt": dt}
    for name, value in numbers.items():
        if not np.all(np.isfinite(value) & (np.asarray(value) >= 0)):
            raise ValueError(f"{name}: needs to be at least zero, received {value}")
    gains = np.broadcast_to(np.asarray(proportional, float), (2,))
    strength = adaptation / 2 * (2 * speed**2 + bias**2)
    return SampledLoop(*axes.sampled(dt), gains, float(strength))


def continuous_bound(axes: SpeedAxes, proportional) -> float:
    """Largest beta with (9) positive definite; infinite where the gains k_c are equal.

        det = A_1 A_2 + beta (A_1 k_c2 + A_2 k_c1) - beta^2 (k_c1 - k_c2)^2 / 4
    with A_i = a_i/b_i + k_ci.
    """
    first, second = np.broadcast_to(np.asarray(proportional, float), (2,))
    one, two = axes.pole / axes.gain + np.array([first, second])
    bend, slope = (first - second) ** 2 / 4, one * second + two * first
    if bend == 0:
        return np.inf
    return float((slope + np.sqrt(slope**2 + 4 * bend * one * two)) / (2 * bend))


def positive_real_margin(loop: SampledLoop, coupling: float) -> float:
    """Smallest eigenvalue, over all frequencies, of the Hermitian part of (17)'s inverse.

    With c = cos w and A_c1 = S + N, symmetric and skew with N_12 = n, it is A_c0 - S c + j n
    sqrt(1 - c^2) [[0, 1], [-1, 0]]: its smaller eigenvalue is t(c) - sqrt(q(c)), t of the first
    degree and q of the second. The minimum is at c = 1, at c = -1 or where 4 q t'^2 = q'^2.
    Condition (17) asks for a margin above zero, and for stable poles A_c0^-1 A_c1.
    """
    first, second = _matrices(loop, coupling)
    S, n = (second + second.T) / 2, (second[0, 1] - second[1, 0]) / 2
    at_zero, slope = (np.array([(M[0, 0] - M[1, 1]) / 2, M[0, 1]]) for M in (first, S))
    q = np.poly1d([slope @ slope - n**2, -2 * at_zero @ slope, at_zero @ at_zero + n**2])
    t = np.poly1d([-np.trace(S) / 2, np.trace(first) / 2])
    turning = np.roots((4 * q * t.deriv() ** 2 - q.deriv() ** 2).coeffs).real
    cosine = np.clip(np.concatenate([turning, [-1.0, 1.0]]), -1, 1)
    return float(np.min(t(cosine) - np.sqrt(np.maximum(q(cosine), 0))))


def loop_radius(loop: SampledLoop, coupling: float) -> float:
    """Spectral radius of the exact loop under a steady reference; of e alone without adaptation."""
    C, B = coupling_matrix(coupling), np.diag(loop.b_d)
    F = np.diag(loop.a_d) - B @ np.diag(loop.proportional) @ C
    if loop.adaptation == 0:  # the estimates stay where they are
        return float(spectral_radius(F))
    learnt = 2 * loop.adaptation * C
    return float(spectral_radius(np.block([[F, -B], [learnt @ F, np.eye(2) - learnt @ B]])))


def positive_real_bound(loop: SampledLoop) -> float:
    """Smallest beta above zero where the margin of (17) is zero; zero where no beta has a margin.

    The margin is concave in beta: (17) holds for every beta below this one.
    """
    return _first_crossing(lambda beta: positive_real_margin(loop, beta))


def exact_bound(loop: SampledLoop) -> float:
    """Smallest beta above zero where the radius of the exact loop is one."""
    return _first_crossing(lambda beta: 1 - loop_radius(loop, beta))


def check_coupling(loop: SampledLoop, coupling: float) -> None:
    """Warn, with the bound, where beta is above it.

    Above the bound of the exact loop the axes diverge. Between that and the bound of (17), they
    settle under a steady reference and nothing is proven for another one.
    """
    exact, proven = exact_bound(loop), positive_real_bound(loop)
    if coupling >= exact:
        words = f"at {exact:.4g} and above the axes diverge"
    elif coupling >= proven:
        words = f"stability is proven below {proven:.4g} only; the axes diverge from {exact:.4g} on"
    else:
        return
    warnings.warn(f"coupling: beta is {coupling:.4g}, {words}", stacklevel=2)


def _matrices(loop: SampledLoop, coupling: float):
    """A_c0 and A_c1 of (17)."""
    C, inverse = coupling_matrix(coupling), np.diag(1 / loop.b_d)
    first = inverse - loop.adaptation * C
    return first, inverse @ np.diag(loop.a_d) - np.diag(loop.proportional) @ C


def _first_crossing(margin) -> float:
    """Smallest beta above zero at which a margin falls to zero; zero where it starts there."""
    if not margin(0.0) > 0:
        return 0.0
    high = 1.0
    while margin(high) > 0:
        high *= 2
        if high > STRONGEST:
            return np.inf
    grid = np.linspace(0, high, GRID)
    end = next(k for k, beta in enumerate(grid) if not margin(beta) > 0)
    bracket = (grid[end - 1], grid[end])
    return float(root_scalar(margin, bracket=bracket, method="brentq", xtol=1e-13).root)
