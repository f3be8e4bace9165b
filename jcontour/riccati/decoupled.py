"""Receding-horizon gains of machines with decoupled axes, without a sweep over the horizon.

An axis a with one input and one output, state x_a, sees over the window of samples k+1..k+N

    y_a = O_a x_a + G_a U_a,   row i of O_a: c_a A_a^i,   G_a[i, j] = h_a[i - j] = c_a A_a^(i-j) b_a
With D = diag(sqrt(stage)), e_a = D (y_a - y_d,a), r_i the tangent, v_i = sum_a r_ai e_ai the lag,
kappa = (alpha + beta) / rho and gamma = beta / (alpha + beta), the cost of `contouring_lq` over rho
is

    kappa sum_i (|e_i|^2 - gamma v_i^2) + |U|^2
and is stationary where U_a = -kappa G_a' D eta_a,  eta_a = e_a - gamma r_a v. With the free errors
eps_a = D (O_a x_a - y_d,a) this is

    eta_a = M_a (eps_a - gamma r_a v),   M_a = (I + kappa D G_a G_a' D)^-1
the same at all steps of a run. Multiplied by r_a and summed it leaves one system a step:

    S v = sum_a r_a (M_a eps_a),   S_ij = 1_ij (1 - gamma |r_i|^2) + gamma sum_a r_ai M_aij r_aj
    u_a = -kappa (M_a D h_a)' (eps_a - gamma r_a v)
S is positive definite. It is the Woodbury identity for the rank-one part of Q (McNab & Tsao, eq. 8,
with the output terminal), where their eqs. 12 and 13 take N stages of the size of the state. The
law is linear in x: gains come from S with one right-hand side for each input. A kernel that follows
a run (`jcontour._kernels`) solves for v instead.

Derivatives pass S by the implicit function theorem, dv = S^-1 (d(right) - dS v).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._devices import on_gpu
from jcontour.linear.plant import AffinePlan, LinearPlant, Pattern, decoupled_axes

LONGEST_WINDOW = 40  # samples: beyond, a sweep over the horizon is as fast
LONGEST_ON_GPU = 16  # samples: beyond, the systems of all steps fill its memory


class ContouringProblem(eqx.Module):
    """Receding-horizon contouring problem of a run: output terminal, control weight rho I."""

    model: LinearPlant  # A, B, C
    alpha: Float[Array, ""]  # weight on the tracking error
    beta: Float[Array, ""]  # weight on the contour error
    rho: Float[Array, ""]  # weight on the control
    stage: Float[Array, " N_p"] | None  # profile over the horizon; None for ones
    tangent: Float[Array, "S m"]  # of every sample, S = T + N_p
    y_d: Float[Array, "S m"]  # desired output at every sample [m]
    preview: int = eqx.field(static=True)  # N_p


class AxisWindow(NamedTuple):
    """Output of an axis over the window: y = O x + G U."""

    O: Float[Array, "N_p n"]  # noqa: E741
    G: Float[Array, "N_p N_p"]


def suits_decoupled(pattern: Pattern, preview: int) -> bool:
    """Whether the window is short, and every axis has an input and an output of its own."""
    axes = decoupled_axes(pattern)
    alone = all(len(axis.inputs) == len(axis.outputs) == 1 and axis.states for axis in axes)
    return alone and preview <= (LONGEST_ON_GPU if on_gpu() else LONGEST_WINDOW)


def axis_windows(model: LinearPlant, preview: int) -> list[AxisWindow]:
    """Free and forced response of every axis, in the order of the outputs."""
    windows = []
    for axis in decoupled_axes(model.pattern):
        (output,), (control,), states = axis.outputs, axis.inputs, np.array(axis.states)
        A, B, C = model.A[states][:, states], model.B[states, control], model.C[output, states]
        rows = [C]
        for _ in range(preview):
            rows.append(rows[-1] @ A)
        h = jnp.stack(rows[:-1]) @ B
        lag = np.subtract.outer(np.arange(preview), np.arange(preview))
        windows.append(AxisWindow(jnp.stack(rows[1:]), jnp.where(lag >= 0, h[lag], 0.0)))
    return windows


def decoupled_plan(problem: ContouringProblem) -> AffinePlan:
    """Gains F, f (u = f - F x) of every step of a run."""
    model, N = problem.model, problem.preview
    q, axes = problem.alpha + problem.beta, decoupled_axes(model.pattern)
    windows = axis_windows(model, N)
    G, kappa = jnp.stack([window.G for window in windows]), q / problem.rho
    if problem.stage is not None:
        G = jnp.sqrt(problem.stage)[None, :, None] * G
    M = jnp.linalg.inv(jnp.eye(N, dtype=G.dtype)[None] + kappa * G @ G.mT)
    Mh = kappa * jnp.einsum("aij,aj->ai", M, G[:, :, 0])  # kappa M_a D h_a of every axis
    steps = problem.tangent.shape[0] - N
    ahead = np.add.outer(np.arange(N), np.arange(1, steps + 1))
    tangent, y_d = problem.tangent.T[:, ahead], problem.y_d.T[:, ahead]
    weights = _weights(M, Mh, problem.alpha / q, problem.beta / q, tangent)
    if problem.stage is not None:
        weights = jnp.sqrt(problem.stage)[None, None, :, None] * weights
    inputs = np.array([axis.inputs[0] for axis in axes])
    F = jnp.zeros((steps, model.inputs, model.states), M.dtype)
    for b, (axis, window) in enumerate(zip(axes, windows, strict=True)):
        own = jnp.einsum("ait,in->tan", weights[:, b], window.O)
        F = F.at[:, inputs[:, None], np.array(axis.states)].set(-own)
    f = -jnp.einsum("abit,bit->ta", weights, y_d)
    return AffinePlan(F, f[:, np.argsort(inputs)])


def _weights(M, Mh, tracked, forgiven, r: Float[Array, "m N_p T"]) -> Float[Array, "m m N_p T"]:
    """Weights of the free errors of all axes (second) in the control of every axis (first)."""
    diagonal = tracked + forgiven * (1 - jnp.sum(r**2, axis=0))
    S = jnp.eye(r.shape[1], dtype=r.dtype)[..., None] * diagonal[None]
    for M_a, r_a in zip(forgiven * M, r, strict=True):
        S = S + M_a[..., None] * (r_a[:, None] * r_a[None])
    X = _solved(jnp.moveaxis(S, -1, 0), (r * Mh[..., None]).transpose(2, 1, 0)).transpose(2, 1, 0)
    weights = forgiven * jnp.einsum("bij,abjt->abit", M, r[None] * X[:, None])
    return weights - jnp.eye(len(M), dtype=M.dtype)[..., None, None] * Mh[:, None, :, None]


def _solved(S: Float[Array, "T N N"], right: Float[Array, "T N p"]) -> Float[Array, "T N p"]:
    """S^-1 right at every step, S symmetric and positive definite."""
    L = jnp.linalg.cholesky(jax.lax.stop_gradient(S), symmetrize_input=False)
    return jax.lax.custom_linear_solve(
        lambda X: S @ X,
        right,
        lambda _, right: jax.scipy.linalg.cho_solve((L, True), right),
        symmetric=True,
    )
