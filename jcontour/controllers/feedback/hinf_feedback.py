"""H-infinity feedback by mixed sensitivity, around a moving target.

    z = (W_S (C x + w_2), effort g u),   x+ = A x + B (u + load w_1 / g),   y = C x + w_2
With S = (I - G K)^-1 this bounds W_S S, effort g K S and, by the load w_1, W_S S G and K S G: a
controller that only bounded S and K S would cancel the resonances of the machine. g is the gain of
the machine at the bandwidth w_b. The weight on the sensitivity is

    W_S = (s / M + w_b) / (s + w_b / 1000)     by Tustin's rule
Below gamma = 1, |S| is below M everywhere and below w / w_b beneath the bandwidth. The feedback
acts on what the machine is off its motion, and integrates down to w_b / 1000.

Discrete H-infinity synthesis by two Riccati equations.

    x+ = A x + B1 w + B2 u,   z = C1 x + D11 w + D12 u,   y = C2 x + D21 w
The control u = K(y), with y of now, keeps the norm from w to z below gamma. The first equation
completes the square of |z|^2 - gamma^2 |w|^2:

    |T'(u - u*)|^2 - |N'(w - w*)|^2,   w* = F x
The second one estimates u* from y while r = N'(w - w*) disturbs, at the level one (Green &
Limebeer, Linear Robust Control, 1995, appendix B). Derivatives pass both.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, check_limit, numbers
from jcontour.controllers.feedback.state_feedback import TargetPlan, accelerated_targets
from jcontour.linear.plant import LinearPlant, spectral_radius
from jcontour.linear.small_matrices import small_solve
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import DOUBLINGS
from jcontour.sensors import row

LEVELLED = 1e-3  # of the bandwidth: where the weight on the sensitivity levels off
MOST, CLOSE = 100.0, 1e-7  # largest gamma that is looked for, and how close the least is found
# of a zero eigenvalue: what rounding leaves of it, over the largest, and where all are small
ROUNDED, SMALL = 1e-9, 1e-12


class Generalised(NamedTuple):
    """Plant from disturbances w and controls u to performance z and measurements y."""

    A: Float[Array, "n n"]
    B1: Float[Array, "n w"]
    B2: Float[Array, "n u"]
    C1: Float[Array, "z n"]
    D11: Float[Array, "z w"]
    D12: Float[Array, "z u"]
    C2: Float[Array, "y n"]
    D21: Float[Array, "y w"]


class Central(NamedTuple):
    """Central controller in observer form, with the innovation e = y - C x.

    u = F x + D e,   x+ = A x + B u + L e
    """

    A: Float[Array, "n n"]
    B: Float[Array, "n u"]
    C: Float[Array, "y n"]
    F: Float[Array, "u n"]
    D: Float[Array, "u y"]
    L: Float[Array, "n y"]


class Conditions(NamedTuple):
    """What decides whether a level is met: both solutions, their loops and their pivots."""

    solutions: tuple[Float[Array, "n n"], Float[Array, "n n"]]
    loops: tuple[Float[Array, "n n"], Float[Array, "n n"]]
    positive: tuple[Float[Array, "u u"], Float[Array, "w w"], Float[Array, "y y"], Array]

    def met(self) -> bool:
        """Whether the norm of the closed loop is below the level."""
        numbers = jax.tree.map(np.asarray, self)
        if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(numbers)):
            return False
        values = [np.linalg.eigvalsh(one) for one in numbers.solutions]
        return (
            all(one[0] >= -ROUNDED * one[-1] - SMALL for one in values)
            and all(np.linalg.eigvalsh(one)[0] > 0 for one in numbers.positive)
            and all(float(spectral_radius(one)) < 1 for one in numbers.loops)
        )


def _stationary(A, B, Q, S, R):
    """Stabilising X of x'Q x + 2 x'S v + v'R v, its pivot M and the row L of v = -M^-1 L x."""
    X = _stabilising(A, B, Q, S, R)
    return X, R + B.T @ X @ B, S.T + B.T @ X @ A


@jax.custom_jvp
def _stabilising(A, B, Q, S, R) -> Float[Array, "n n"]:
    """SciPy's solution: doubling breaks down at levels between, where R is indefinite."""
    return jax.pure_callback(_solved, A, A, B, Q, S, R, vmap_method="sequential")


def _solved(*matrices) -> np.ndarray:
    A, B, Q, S, R = (np.asarray(matrix) for matrix in matrices)
    try:
        return scipy.linalg.solve_discrete_are(A, B, Q, R, s=S)
    except (np.linalg.LinAlgError, ValueError):
        return np.full_like(A, np.nan)


@_stabilising.defjvp
def _slope(primals, tangents):
    """dX = A_c' dX A_c + the change of the stage's cost under v = -K x, which is stationary."""
    A, B, Q, S, R = primals
    dA, dB, dQ, dS, dR = tangents
    X = _stabilising(A, B, Q, S, R)
    K = small_solve(R + B.T @ X @ B, S.T + B.T @ X @ A)
    loop, moved = A - B @ K, dA - dB @ K
    stage = dQ - dS @ K - K.T @ dS.T + K.T @ dR @ K + moved.T @ X @ loop + loop.T @ X @ moved

    def double(carry, _):
        power, total = carry
        return (power @ power, total + power.T @ total @ power), None

    (_, dX), _ = jax.lax.scan(double, (loop, stage), length=DOUBLINGS)
    return X, dX


@jax.jit
def central_controller(plant: Generalised, gamma: Float[Array, ""]) -> tuple[Central, Conditions]:
    """Central controller of a level gamma, and what decides whether the level is met."""
    A, B1, B2, C1, D11, D12, C2, D21 = plant
    w, inputs = B1.shape[1], B2.shape[1]
    B, D = jnp.concatenate([B1, B2], axis=1), jnp.concatenate([D11, D12], axis=1)
    level = jnp.diag(jnp.concatenate([jnp.full(w, gamma**2), jnp.zeros(inputs)]))
    X, M, row = _stationary(A, B, C1.T @ C1, C1.T @ D, D.T @ D - level)
    M_uu, M_uw = M[w:, w:], M[w:, :w]
    pivot = -(M[:w, :w] - M_uw.T @ small_solve(M_uu, M_uw))
    worst = small_solve(pivot, row[:w] - M_uw.T @ small_solve(M_uu, row[w:]))
    T, N = jnp.linalg.cholesky(M_uu), jnp.linalg.cholesky(pivot)
    inwards = small_solve(N, jnp.eye(w)).T  # w = w* + N^-T r
    back = small_solve(T, jnp.eye(inputs))
    A_t, C_t, B_t, D_t = A + B1 @ worst, C2 + D21 @ worst, B1 @ inwards, D21 @ inwards
    wanted, direct = back @ (row[w:] + M_uw @ worst), back @ M_uw @ inwards
    C, E = jnp.concatenate([wanted, C_t]), jnp.concatenate([direct, D_t])
    one = jnp.diag(jnp.concatenate([jnp.ones(inputs), jnp.zeros(C2.shape[0])]))
    Y, S, column = _stationary(A_t.T, C.T, B_t @ B_t.T, B_t @ E.T, E @ E.T - one)
    S_yy, S_uy = S[inputs:, inputs:], S[:inputs, inputs:]
    at_y = small_solve(S_yy, jnp.eye(len(S_yy)))
    missed = S_uy @ at_y @ S_uy.T - S[:inputs, :inputs]
    law = Central(A_t, B2, C_t, -back.T @ wanted, -back.T @ S_uy @ at_y, column[inputs:].T @ at_y)
    loops = A - B @ small_solve(M, row), A_t - column.T @ small_solve(S, C)
    return law, Conditions((X, Y), loops, (M_uu, pivot, S_yy, missed))


def least_gamma(plant: Generalised) -> float:
    """Least level that a controller meets, by bisection: at most 1e-7 of it too large.

    Raises:
        ValueError: no level below 100 is met.
    """
    synthesis = partial(central_controller, plant)

    def meets(level):
        return synthesis(jnp.asarray(float(level)))[1].met()

    if not meets(MOST):
        raise ValueError(
            f"weights: no controller meets them at a level below {MOST:g}; ask for less bandwidth, "
            "a larger peak or more effort, and see that every mode is reached and seen"
        )
    low, high = np.log(1e-6), np.log(MOST)
    while high - low > CLOSE:
        middle = (low + high) / 2
        low, high = (low, middle) if meets(np.exp(middle)) else (middle, high)
    return float(np.exp(high))


class MixedWeights(NamedTuple):
    """Weights of the mixed sensitivity.

    Attributes:
        bandwidth: w_b [rad/s].
        peak: M, bound on the peak sensitivity at the level one.
        effort: weight on g K S.
        load: load that is borne beside the noise, over that of the machine's gain.
    """

    bandwidth: ArrayLike
    peak: ArrayLike
    effort: ArrayLike
    load: ArrayLike


def gain_at(model: LinearPlant, measured: ArrayLike, bandwidth: float) -> float:
    """Gain g of the machine at a frequency [rad/s], the smallest of its axes."""
    A, B = np.asarray(model.A), np.asarray(model.B)
    z = np.exp(1j * bandwidth * model.dt)
    G = np.asarray(measured) @ np.linalg.solve(z * np.eye(len(A)) - A, B)
    return float(np.linalg.svd(G, compute_uv=False)[-1])


def mixed_sensitivity(
    model: LinearPlant, measured: Float[ArrayLike, "q n"], weights: MixedWeights, gain: float
) -> Generalised:
    """Generalised plant of the weights; `gain` is g, see `gain_at`."""
    A, C, dt = model.A, jnp.asarray(measured, model.A.dtype), model.dt
    (n, p), q = model.B.shape, C.shape[0]
    w_b, M = jnp.asarray(weights.bandwidth, float), jnp.asarray(weights.peak, float)
    slow = w_b * LEVELLED * dt / 2
    pole, direct = (1 - slow) / (1 + slow), (1 / M + w_b * dt / 2) / (1 + slow)
    through = (w_b * dt / 2 - 1 / M) / (1 + slow) + pole * direct  # of the weight's state
    B = model.B / gain
    none = jnp.zeros
    block = [[A, none((n, q))], [through * C, pole * jnp.eye(q)]]
    return Generalised(
        A=jnp.block(block),
        B1=jnp.block([[weights.load * B, none((n, q))], [none((q, p)), through * jnp.eye(q)]]),
        B2=jnp.concatenate([B, none((q, p))]),
        C1=jnp.block([[direct * C, jnp.eye(q)], [none((p, n)), none((p, q))]]),
        D11=jnp.block([[none((q, p)), direct * jnp.eye(q)], [none((p, p)), none((p, q))]]),
        D12=jnp.concatenate([none((q, p)), weights.effort * jnp.eye(p)]),
        C2=jnp.concatenate([C, none((q, q))], axis=1),
        D21=jnp.concatenate([none((q, p)), jnp.eye(q)], axis=1),
    )


class HInfinityFeedback(Controller):
    """Output feedback u = u_d + K (y - C x_d) on the measured positions.

    Args:
        model: of the machine, which its target follows.
        read: rows (q, measured) of the measurement that K reads.
        measured: C (q, n) of what it reads.
        law: central controller of `mixed_sensitivity`, its control in units of 1 / g.
        gain: g.
        limit: limit of the control, +-: the observer in the law is driven by what acts.

    Raises:
        ValueError: as `moving_target`, or a limit is not above zero.
    """

    model: LinearPlant
    read: Float[Array, "q r"] = eqx.field(converter=numbers)
    measured: Float[Array, "q n"] = eqx.field(converter=numbers)
    law: Central
    gain: Float[Array, ""] = eqx.field(converter=numbers)
    limit: Float[Array, "*p"] = eqx.field(converter=numbers, default=np.inf)
    preview: int = eqx.field(static=True, init=False, default=2)  # the acceleration needs r(k+2)

    def __check_init__(self):
        check_limit(self.limit)

    def prepare(self, reference: Reference) -> TargetPlan:
        """Measurements C x_d and controls u_d of the motion at every step."""
        plan = accelerated_targets(self.model, reference)
        return TargetPlan(plan.state @ self.measured.T, plan.control)

    def initial_memory(self, reference: Reference) -> Float[Array, " n"]:
        return jnp.zeros(self.law.A.shape[0], self.law.A.dtype)

    def step(
        self, memory: Float[Array, " n"], plan: TargetPlan, measurement
    ) -> tuple[Float[Array, " n"], Float[Array, " p"]]:
        law, off = self.law, self.read @ row(measurement) - plan.state
        innovation = off - law.C @ memory
        free = (law.F @ memory + law.D @ innovation) / self.gain
        control = jnp.clip(plan.control + free, -self.limit, self.limit)
        acted = (control - plan.control) * self.gain
        return law.A @ memory + law.B @ acted + law.L @ innovation, control
