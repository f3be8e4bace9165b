"""The quadratic program of model predictive contouring control, condensed: what is constant once, the rest at every step, compiled.

At sample k, along estimates theta_b of the path parameter at the evaluation points, with p(theta) ~
p_b + p'_b (theta - theta_b),
    e_b = y_b - p_b - p'_b (theta - theta_b),   t_b = p'_b / |p'_b|
    J = sum_b w_b (q_c |e_b|^2 + (q_l - q_c) (t_b . e_b)^2) - q_theta sum_i theta_i h / T + sum_b
    r_b ((du_b)' R_u du_b + R_v dv_b^2)
is Lam et al., eqs. (13)-(15), in any number of axes: in the plane |e|^2 - (t . e)^2 is the square
of the contour error (14). Errors and theta count at the samples 1..N, du and dv at 0..N-1 (the
print has both at 1..N); the costs carry no 1/2.

The horizon is cut into blocks of l_b samples, over which controls and path speed are held; errors
are evaluated at the blocks' ends
only, each for the whole block, theta at every sample: w_b = l_b h / T, r_b = T / (h (l_b-1 + l_b) /
2) with T the period that the weights are stated for. Blocks of one sample of T are the paper's
problem; other blocks approximate the same integrals over time. Variables are z = [v (B), u (B, p)]
with v in length per T and absolute u: the limits are then bounds, and one row keeps theta within
the path (theta falls short of its start nowhere, because v >= 0).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jcontour.linear.plant import LinearPlant
from jcontour.linear.velocity_form import velocity_form
from jcontour.mpc.compiled_path import path_at
from jcontour.qp.compiled import compiled


class Condensed(NamedTuple):
    """What does not change between the steps of a run, lengths in the unit of the QP.

    Attributes:
        free: y at the evaluation points without a change of the control, from [dx, du(k-1), y,
            u(k-1)]: (B, m, n + 2 p + m).
        forced: y from the controls u of the blocks, absolute (B, m, B p).
        curvature: forced' w q_c forced and the increments' weights: the constant part of H / 2 in
            u, (B p, B p).
        ends: first sample after each block.
        share: w_b, the part of T for which each evaluation point counts; also the theta that v_b =
            1 gains over its block.
        change: r_b R_v for dv_b.
        push: r_0 R_u, which ties u_0 to u(k-1): (p, p).
        reward: what v_b = 1 gains in q_theta sum_i theta_i h / T.
        weights: q_c, q_l.
    """

    free: Float[np.ndarray, "B m f"]
    forced: Float[np.ndarray, "B m Bp"]
    curvature: Float[np.ndarray, "Bp Bp"]
    ends: Int[np.ndarray, " B"]
    share: Float[np.ndarray, " B"]
    change: Float[np.ndarray, " B"]
    push: Float[np.ndarray, "p p"]
    reward: Float[np.ndarray, " B"]
    weights: Float[np.ndarray, "2"]


def condensed(
    model: LinearPlant,
    unit: float,
    blocks: Int[np.ndarray, " B"],
    contour_error: float,
    lag: float,
    progress: float,
    control_change: Float[np.ndarray, "p p"],
    speed_change: float,
    period: float,
) -> Condensed:
    """The constant parts for a model and weights; blocks in samples, errors count in `unit` [m], the weights hold at `period` [s]."""
    form, p, m, count = (
        velocity_form(LinearPlant(model.A, model.B, model.C / unit, model.dt)),
        model.inputs,
        model.axes,
        len(blocks),
    )
    A, B, C = (np.asarray(matrix) for matrix in (form.A, form.B, form.C))
    ends = np.cumsum(blocks)
    starts = ends - blocks
    outputs = [C]  # C A^i: y after i samples without a change
    for _ in range(ends[-1]):
        outputs.append(outputs[-1] @ A)
    changes = np.zeros(
        (count, m, count + 1, p)
    )  # y at the end of b after a unit change of u at the start of c
    for b in range(count):
        for c in range(b + 1):
            changes[b, :, c] = outputs[ends[b] - starts[c] - 1] @ B
    free = np.concatenate([np.array([outputs[end] for end in ends]), -changes[:, :, 0]], axis=2)
    forced = (changes[:, :, :-1] - changes[:, :, 1:]).reshape(count, m, count * p)
    share = blocks * model.dt / period
    gaps = np.append((1 + blocks[0]) / 2, (blocks[:-1] + blocks[1:]) / 2) * model.dt / period
    difference = np.eye(count) - np.eye(count, k=-1)
    curvature = np.einsum("bmi,b,bmj->ij", forced, contour_error * share, forced)
    curvature += np.kron(difference.T @ np.diag(1 / gaps) @ difference, control_change)
    reward = progress * (model.dt / period) ** 2 * blocks * ((blocks + 1) / 2 + ends[-1] - ends)
    return Condensed(
        free,
        forced,
        curvature,
        ends,
        share,
        speed_change / gaps,
        control_change / gaps[0],
        reward,
        np.array([contour_error, lag], float),
    )


@compiled
def write_qp(constant, path, theta_hat, theta, start, previous, H, g) -> None:
    """Write H and g of 1/2 z'Hz + g'z.

    Args:
        constant: `Condensed`.
        path: `Path`.
        theta_hat: estimates at the evaluation points (B,), in [-L, 0].
        theta: now.
        start: [dx, du(k-1), y, u(k-1)].
        previous: v before, per T.
        H: written, (B + B p, B + B p).
        g: written.
    """
    free, forced, share, change = constant.free, constant.forced, constant.share, constant.change
    count, m, columns = forced.shape
    p = columns // count
    q_c, q_l = constant.weights
    length = path.start[-1]
    point, slope, error = np.empty(m), np.empty(m), np.empty(m)
    along = np.empty(columns)
    for i in range(columns):
        for j in range(i + 1):
            H[count + i, count + j] = 2 * constant.curvature[i, j]
    H[:, :count] = 0.0
    g[:count], g[count:] = -constant.reward, 0.0
    for b in range(count):
        path_at(
            path.polynomial, path.waves, path.rate, path.start, theta_hat[b] + length, point, slope
        )
        speed = 0.0
        for a in range(m):
            speed += slope[a] * slope[a]
        speed = np.sqrt(speed)
        lag = 0.0
        for a in range(m):
            slope[a] /= speed
            error[a] = -point[a] - speed * slope[a] * (theta - theta_hat[b])
            for i in range(start.size):
                error[a] += free[b, a, i] * start[i]
            lag += slope[a] * error[a]
        here = (b + 1) * p  # later blocks do not act yet
        twist, pull = 2 * share[b] * (q_l - q_c), 2 * share[b] * q_c
        for i in range(here):
            along[i], force = 0.0, 0.0
            for a in range(m):
                along[i] += slope[a] * forced[b, a, i]
                force += error[a] * forced[b, a, i]
            g[count + i] += pull * force + twist * lag * along[i]
        for i in range(here):
            turned = twist * along[i]
            for j in range(i + 1):
                H[count + i, count + j] += turned * along[j]
        stiff = 2 * share[b] * q_l * speed
        for c in range(b + 1):  # e_b falls by p'_b share_c v_c
            g[c] -= share[c] * stiff * lag
            for i in range(here):
                H[count + i, c] -= stiff * share[c] * along[i]
            for d in range(c + 1):
                H[c, d] += stiff * speed * share[c] * share[d]
    for c in range(count):
        H[c, c] += 2 * change[c]
        if c + 1 < count:
            H[c, c] += 2 * change[c + 1]
            H[c + 1, c] -= 2 * change[c + 1]
    g[0] -= 2 * change[0] * previous
    held = start.size - p
    for i in range(p):
        for j in range(p):
            g[count + i] -= 2 * constant.push[i, j] * start[held + j]
    for i in range(H.shape[0]):
        for j in range(i):
            H[j, i] = H[i, j]


@compiled
def write_estimates(ends, plan, scale, theta, theta_hat) -> None:
    """Write theta at the evaluation points along the plan one sample on: its last speed goes on, and the path's end ends it.

    `plan` is v of the blocks solved one sample before, `scale` the theta gained per sample at v =
    1.
    """
    block, begun, travelled = 0, 0, 0.0  # of the old plan, up to `begun`
    last = ends.size - 1
    for b in range(ends.size):
        until = ends[b] + 1
        while block < last and ends[block] < until:
            travelled += scale * (ends[block] - begun) * plan[block]
            begun = ends[block]
            block += 1
        theta_hat[b] = min(
            theta + travelled + scale * ((until - begun) * plan[block] - plan[0]), 0.0
        )


@compiled
def write_step(
    constant,
    path,
    output,
    theta,
    plan,
    control,
    before,
    state,
    measurement,
    theta_hat,
    H,
    g,
    upper_rows,
) -> None:
    """Everything of one step's QP that changes: H, g and the room theta has left, in place.

    Args:
        constant: `Condensed`.
        path: `Path`.
        output: C of the model in the unit of the QP.
        theta: path parameter now.
        plan: v of the blocks solved one sample before.
        control: u(k-1).
        before: u(k-2).
        state: x(k-1).
        measurement: x(k).
        theta_hat: written, (B,).
        H: written.
        g: written.
        upper_rows: written, (1,).
    """
    n, p, m = measurement.size, control.size, output.shape[0]
    start = np.empty(n + 2 * p + m)
    for i in range(n):
        start[i] = measurement[i] - state[i]
    for i in range(p):
        start[n + i] = control[i] - before[i]
        start[n + p + m + i] = control[i]
    for a in range(m):
        y = 0.0
        for i in range(n):
            y += output[a, i] * measurement[i]
        start[n + p + a] = y
    write_estimates(constant.ends, plan, constant.share[0] / constant.ends[0], theta, theta_hat)
    write_qp(constant, path, theta_hat, theta, start, plan[0], H, g)
    upper_rows[0] = max(-theta, 0.0)
