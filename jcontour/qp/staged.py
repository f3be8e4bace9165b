"""A quadratic program over the stages of a horizon, in JAX: the form of optimal control problems.

    minimise    sum_j 1/2 v_j' H_j v_j + h_j' v_j  +  1/2 x_N' H_N x_N + h_N' x_N
    subject to  x_{j+1} = A x_j + B u_j + c_j,    x_0 given,    lower_j <= D v_j <= upper_j

v_j = (x_j, u_j), j = 0..N-1. `QP` of `problem` is the same with the states eliminated, for solvers
on the host; here they stay, and the work of a Newton step grows with N instead of N^3.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float


class StagedQP(NamedTuple):
    """The numbers of one problem; limits may be infinite, and differ from stage to stage."""

    # A, B, c: model of a stage, and what is added to its next state
    A: Float[Array, "n n"]
    B: Float[Array, "n p"]
    c: Float[Array, "N n"]
    x0: Float[Array, " n"]  # first state
    # H, h: cost of the stages; of H its symmetric part counts, whose part of the controls is
    # positive definite where nothing behind makes it so
    H: Float[Array, "N v v"]
    h: Float[Array, "N v"]
    # H_end, h_end: cost of the last state
    H_end: Float[Array, "n n"]
    h_end: Float[Array, " n"]
    D: Float[Array, "r v"]  # rows that are limited
    # lower, upper: their limits
    lower: Float[Array, "N r"]
    upper: Float[Array, "N r"]
    # cost of a unit beyond a limit, by row; infinite where the limit is hard
    penalty: Float[Array, " r"]


class Trajectory(NamedTuple):
    """States and controls of a horizon, and its last state."""

    stages: Float[Array, "N v"]
    end: Float[Array, " n"]


class Factors(NamedTuple):
    """Feedback law of a backward sweep: u_j = -R^-1 (Y x_j + y) with R'R = H_uu + B' P B."""

    Y: Float[Array, "N p n"]  # R'^-1 (H_ux + B' P A)
    y: Float[Array, "N p"]  # R'^-1 (h_u + B' q)
    R: Float[Array, "N p p"]  # by its rows, with the inverse of the diagonal in its place


def rollout(qp: StagedQP, controls: Float[Array, "N p"]) -> Trajectory:
    """States that the controls lead to."""
    x, end = _led(qp, qp.x0, controls, qp.c)
    return Trajectory(jnp.concatenate([x, controls], axis=1), end)


def factorised(
    qp: StagedQP, H: Float[Array, "N v v"], h: Float[Array, "N v"], h_end: Float[Array, " n"]
) -> Factors:
    """Backward sweep of the steps dv from a trajectory that minimise 1/2 dv' H dv + h' dv.

    The steps obey dx_{j+1} = A dx_j + B du_j, dx_0 = 0.
    """
    n, p = qp.B.shape
    model = jnp.concatenate([qp.A, qp.B], axis=1)

    def back(behind, stage):
        P, q = behind
        H, h = stage
        T = H + model.T @ (P @ model)
        t = h + model.T @ q
        G = T[n:, n:]
        R = jnp.stack([jnp.stack(row) for row in cholesky(G)])
        Y, y = _eliminated(R, T[n:, :n]), _eliminated(R, t[n:])
        return (T[:n, :n] - Y.T @ Y, t[:n] - Y.T @ y), Factors(Y, y, R)

    return lax.scan(back, (qp.H_end, h_end), (H, h), reverse=True)[1]


def step_of(qp: StagedQP, factors: Factors) -> Trajectory:
    """The step that a sweep has prepared."""
    p = qp.B.shape[1]

    def on(x, stage):
        u = -jnp.stack(returned(stage.R, stage.Y @ x + stage.y))
        return qp.A @ x + qp.B @ u, (x, u)

    end, (x, u) = lax.scan(on, jnp.zeros_like(qp.x0), factors)
    return Trajectory(jnp.concatenate([x, u.reshape(-1, p)], axis=1), end)


def another_step(
    qp: StagedQP, factors: Factors, h: Float[Array, "N v"], h_end: Float[Array, " n"]
) -> Trajectory:
    """The step for another h, from the factors of the same H; linear in h."""
    n = qp.x0.size
    model = jnp.concatenate([qp.A, qp.B], axis=1)

    def back(q, stage):
        h, Y, R = stage
        t = h + model.T @ q
        y = _eliminated(R, t[n:])
        return t[:n] - Y.T @ y, y

    y = lax.scan(back, h_end, (h, factors.Y, factors.R), reverse=True)[1]
    return step_of(qp, factors._replace(y=y))


def slopes(qp: StagedQP, at: Trajectory) -> Trajectory:
    """Slope of the cost with every v_j, and with x_N."""
    return Trajectory(
        jnp.einsum("jab,jb->ja", qp.H, at.stages) + qp.h, qp.H_end @ at.end + qp.h_end
    )


def summed(one: Trajectory, other: Trajectory) -> Trajectory:
    """Both trajectories, or slopes, added."""
    return Trajectory(one.stages + other.stages, one.end + other.end)


def costates(qp: StagedQP, slope: Trajectory) -> Float[Array, "N n"]:
    """Multipliers of the model's equations, of x_1 to x_N, at which no state moves the Lagrangian.

    Args:
        qp: the problem.
        slope: of cost and limits.
    """
    n = qp.x0.size

    def back(costate, slope):
        return slope[:n] + qp.A.T @ costate, costate

    return lax.scan(back, slope.end, slope.stages, reverse=True)[1]


def drifted(
    qp: StagedQP, start: Float[Array, " n"], added: Float[Array, "N n"]
) -> tuple[Float[Array, "N n"], Float[Array, " n"]]:
    """States without controls from another start, with other numbers added."""
    return _led(qp, start, jnp.zeros((added.shape[0], qp.B.shape[1]), added.dtype), added)


def _led(qp: StagedQP, start, controls, added):
    def on(x, stage):
        u, c = stage
        return qp.A @ x + qp.B @ u + c, x

    end, x = lax.scan(on, start, (controls, added))
    return x, end


# A small matrix is worked on number by number: a `vmap` then makes loops over the batch of it.
# Divisions by the pivots are multiplications by what stands on the diagonal of R.


def _eliminated(R: Float[Array, "p p"], rows: Float[Array, "p *q"]) -> Float[Array, "p *q"]:
    return jnp.stack(eliminated(R, rows))


def cholesky(G) -> list[list]:
    """Rows of R of G = R'R, upper triangular, with the inverse of its diagonal in its place.

    Args:
        G: its rows; as for the functions below, lists of numbers or arrays do.
    """
    p = len(G)
    R: list[list] = [[0.0] * p for _ in range(p)]
    for i in range(p):
        R[i][i] = lax.rsqrt(G[i][i] - _sum(R[k][i] ** 2 for k in range(i)))
        for j in range(i + 1, p):
            R[i][j] = (G[i][j] - _sum(R[k][i] * R[k][j] for k in range(i))) * R[i][i]
    return R


def eliminated(R, rows) -> list:
    """Solution X of R' X = rows, by its rows."""
    solution: list[Array] = []
    for i in range(len(R)):
        solution.append((rows[i] - _sum(R[k][i] * solution[k] for k in range(i))) * R[i][i])
    return solution


def returned(R, values) -> list:
    """Solution x of R x = values."""
    p = len(R)
    solution: list[Array] = [values[0]] * p
    for i in reversed(range(p)):
        solution[i] = (values[i] - _sum(R[i][k] * solution[k] for k in range(i + 1, p))) * R[i][i]
    return solution


def _sum(terms):
    return sum(terms, start=0.0)
