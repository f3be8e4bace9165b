"""The quadratic program of model predictive contouring control, condensed.

What is constant is made once, the rest at every step, compiled. At sample k, along estimates
theta_b of the path parameter at the evaluation points, with p(theta) ~ p_b + p'_b (theta -
theta_b),

    e_b = y_b - p_b - p'_b (theta - theta_b),   t_b = p'_b / |p'_b|
    J = sum_b w_b (q_c |e_b|^2 + (q_l - q_c) (t_b . e_b)^2) - q_theta sum_i theta_i h / T + sum_b
    r_b ((du_b)' R_u du_b + R_v dv_b^2)
is Lam et al., eqs. (13)-(15), in one to three axes, as a path has: in the plane |e|^2 - (t . e)^2
is the square of the contour error (14). Errors and theta count at the samples 1..N, du and dv at
0..N-1 (the print has both at 1..N); the costs carry no 1/2.

The horizon is cut into blocks of l_b samples, over which controls and path speed are held. Errors
are evaluated at the blocks' ends only, each for the whole block, theta at every sample: w_b = l_b
h / T, r_b = T / (h (l_b-1 + l_b) / 2) with T the period that the weights are stated for. Blocks of
one sample of T are the paper's problem; other blocks approximate the same integrals over time.

Variables are z = [v (B), u (B, p)] with v in length per T and absolute u: the limits are then
bounds, and one row keeps theta within the path (theta falls short of its start nowhere, because v
>= 0).
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jcontour._arrays import check_signs
from jcontour._compiled import compiled
from jcontour.geometry.contour import Contour
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import velocity_form
from jcontour.qp.problem import check_weight


@dataclass(frozen=True)
class ContouringWeights:
    """Weights of (12) in Lam et al., the defaults are the paper's.

    They hold in a unit of length and for a sample period. At another sample period the same
    integrals over time are weighed: nothing needs to be restated.

    Attributes:
        contour_error: q_c, per length_unit^2.
        lag: q_l, per length_unit^2.
        progress: q_theta, per length_unit; more of it is faster and less accurate.
        control_change: R_x, R_y: one number, one for each input, or a matrix (p, p); per A^2.
        speed_change: R_v, per (length_unit per period)^2.
        length_unit: [m]; the QP is solved in it.
        period: [s].

    Raises:
        ValueError: a weight is negative or not finite, the changes' are zero, or unit or period is
            not above zero.
    """

    contour_error: float = 100.0
    lag: float = 200.0
    progress: float = 0.3  # the middle of the paper's range 0.03 .. 5
    control_change: Any = 60.0
    speed_change: float = 200.0
    length_unit: float = 1e-3
    period: float = 4e-3

    def __post_init__(self):
        check_signs(self, not_negative=("contour_error", "lag", "progress"))
        check_signs(self, positive=("speed_change", "length_unit", "period"))

    def control_matrix(self, inputs: int) -> Float[np.ndarray, "p p"]:
        """R_u as a matrix.

        Raises:
            ValueError: it has another shape, or is not symmetric and positive definite.
        """
        R = np.asarray(self.control_change, float)
        if R.ndim < 2:
            if R.size not in (1, inputs):
                raise ValueError(
                    f"control_change: needs one number or one for each of {inputs} inputs, "
                    f"received shape {R.shape}"
                )
            R = np.diag(np.broadcast_to(R, (inputs,)))
        if R.shape != (inputs, inputs):
            raise ValueError(f"control_change: needs shape {(inputs, inputs)}, received {R.shape}")
        check_weight("control_change", R)
        if not np.linalg.eigvalsh(R).min() > 0:
            raise ValueError(
                "control_change: needs to be positive definite, received a singular matrix"
            )
        return R


class ContouringConstants(NamedTuple):
    """The parts that stay the same during a run, lengths in the unit of the QP."""

    output: Float[np.ndarray, "m n"]  # C of the model
    # y at the evaluation points without a change of the control, from [dx, du(k-1), y, u(k-1)]: (B,
    # m, n + 2 p + m)
    free: Float[np.ndarray, "B m f"]
    forced: Float[np.ndarray, "B m Bp"]  # y from the controls u of the blocks, absolute (B, m, B p)
    # forced' w q_c forced and the increments' weights: the constant part of H / 2 in u, (B p, B p)
    curvature: Float[np.ndarray, "Bp Bp"]
    ends: Int[np.ndarray, " B"]  # first sample after each block
    # w_b, the part of T for which each evaluation point counts; also the theta that v_b = 1 gains
    # over its block
    share: Float[np.ndarray, " B"]
    change: Float[np.ndarray, " B"]  # r_b R_v for dv_b
    push: Float[np.ndarray, "p p"]  # r_0 R_u, which ties u_0 to u(k-1): (p, p)
    reward: Float[np.ndarray, " B"]  # what v_b = 1 gains in q_theta sum_i theta_i h / T
    weights: Float[np.ndarray, "2"]  # q_c, q_l


class Sample(NamedTuple):
    """The state of a run at sample k."""

    theta: float  # path parameter now
    plan: Float[np.ndarray, " B"]  # v of the blocks solved one sample before
    control: Float[np.ndarray, " p"]  # u(k-1)
    before: Float[np.ndarray, " p"]  # u(k-2)
    state: Float[np.ndarray, " n"]  # x(k-1)
    measurement: Float[np.ndarray, " n"]  # x(k)


def contouring_constants(
    model: LinearPlant, weights: ContouringWeights, blocks: Int[np.ndarray, " B"]
) -> ContouringConstants:
    """The constant parts for a model, weights and blocks [samples]."""
    C, count = model.C / weights.length_unit, len(blocks)
    ends = np.cumsum(blocks)
    free, forced = _output_maps(LinearPlant(model.A, model.B, C, model.dt), blocks)
    share = blocks * model.dt / weights.period
    middles = np.append((1 + blocks[0]) / 2, (blocks[:-1] + blocks[1:]) / 2)
    gaps = middles * model.dt / weights.period
    R = weights.control_matrix(model.inputs)
    difference = np.eye(count) - np.eye(count, k=-1)
    curvature = np.einsum("bmi,b,bmj->ij", forced, weights.contour_error * share, forced)
    curvature += np.kron(difference.T @ np.diag(1 / gaps) @ difference, R)
    reward = weights.progress * (model.dt / weights.period) ** 2
    reward = reward * blocks * ((blocks + 1) / 2 + ends[-1] - ends)
    return ContouringConstants(
        output=np.asarray(model.C) / weights.length_unit,
        free=free,
        forced=forced,
        curvature=curvature,
        ends=ends,
        share=share,
        change=weights.speed_change / gaps,
        push=R / gaps[0],
        reward=reward,
        weights=np.array([weights.contour_error, weights.lag], float),
    )


def _output_maps(
    model: LinearPlant, blocks: Int[np.ndarray, " B"]
) -> tuple[Float[np.ndarray, "B m f"], Float[np.ndarray, "B m Bp"]]:
    """Maps `free` and `forced` to the outputs at the blocks' ends."""
    form, p, m, count = velocity_form(model), model.inputs, model.axes, len(blocks)
    A, B, C = (np.asarray(matrix) for matrix in (form.A, form.B, form.C))
    ends = np.cumsum(blocks)
    starts = ends - blocks
    outputs = [C]  # C A^i: y after i samples without a change
    for _ in range(ends[-1]):
        outputs.append(outputs[-1] @ A)
    # y at the end of b after a unit change of u at the start of c
    changes = np.zeros((count, m, count + 1, p))
    for b in range(count):
        for c in range(b + 1):
            changes[b, :, c] = outputs[ends[b] - starts[c] - 1] @ B
    free = np.concatenate([np.array([outputs[end] for end in ends]), -changes[:, :, 0]], axis=2)
    forced = (changes[:, :, :-1] - changes[:, :, 1:]).reshape(count, m, count * p)
    return free, forced


@compiled
def write_step(constants, path, sample, H, g, upper_rows) -> None:
    """Write all that changes in the QP of a step: H, g and the room that theta has left.

    Args:
        constants: `ContouringConstants`.
        path: `Path`.
        sample: `Sample`.
        H: written, (B + B p, B + B p).
        g: written, (B + B p,).
        upper_rows: written, (1,).
    """
    theta_hat = np.empty(constants.ends.size)
    scale = constants.share[0] / constants.ends[0]
    write_estimates(constants.ends, sample.plan, scale, sample.theta, theta_hat)
    start = _start(constants.output, sample)
    write_qp(constants, path, theta_hat, sample.theta, start, sample.plan[0], H, g)
    upper_rows[0] = max(-sample.theta, 0.0)


@compiled
def _start(output, sample):
    """[dx, du(k-1), y, u(k-1)] of the velocity form."""
    n, p, m = sample.measurement.size, sample.control.size, output.shape[0]
    start = np.empty(n + 2 * p + m)
    for i in range(n):
        start[i] = sample.measurement[i] - sample.state[i]
    for i in range(p):
        start[n + i] = sample.control[i] - sample.before[i]
        start[n + p + m + i] = sample.control[i]
    for a in range(m):
        y = 0.0
        for i in range(n):
            y += output[a, i] * sample.measurement[i]
        start[n + p + a] = y
    return start


@compiled
def write_estimates(ends, plan, scale, theta, theta_hat) -> None:
    """Write theta at the evaluation points along the plan one sample on.

    Its last speed goes on, and the path's end ends it. `plan` is v of the blocks solved one sample
    before, `scale` the theta gained per sample at v = 1.
    """
    block, begun, travelled = 0, 0, 0.0  # of the old plan, up to `begun`
    last = ends.size - 1
    for b in range(ends.size):
        until = ends[b] + 1
        while block < last and ends[block] < until:
            travelled += scale * (ends[block] - begun) * plan[block]
            begun = ends[block]
            block += 1
        ahead = scale * ((until - begun) * plan[block] - plan[0])
        theta_hat[b] = min(theta + travelled + ahead, 0.0)


@compiled
def write_qp(constants, path, theta_hat, theta, start, previous, H, g) -> None:
    """Write H and g of 1/2 z'Hz + g'z.

    Args:
        constants: `ContouringConstants`.
        path: `Path`.
        theta_hat: estimates at the evaluation points (B,), in [-L, 0].
        theta: now.
        start: [dx, du(k-1), y, u(k-1)].
        previous: v before, per T.
        H: written, (B + B p, B + B p).
        g: written.
    """
    count, m, columns = constants.forced.shape
    slope, error, along = np.empty(m), np.empty(m), np.empty(columns)
    _write_constant_part(constants, H, g)
    for b in range(count):
        speed, lag = _error_at(constants, path, b, theta_hat[b], theta, start, slope, error)
        _add_controls(constants, b, lag, slope, error, along, H, g)
        _add_speeds(constants, b, speed, lag, along, H, g)
    _add_changes(constants, start, previous, H, g)
    for i in range(H.shape[0]):
        for j in range(i):
            H[j, i] = H[i, j]


@compiled
def _write_constant_part(constants, H, g):
    """Lower half of H and g before any error counts."""
    count, columns = constants.share.size, constants.curvature.shape[0]
    for i in range(columns):
        for j in range(i + 1):
            H[count + i, count + j] = 2 * constants.curvature[i, j]
    H[:, :count] = 0.0
    g[:count], g[count:] = -constants.reward, 0.0


@compiled
def _error_at(constants, path, b, estimate, theta, start, slope, error):
    """|p'_b| and the lag t_b . e_b; writes t_b and e_b with z = 0."""
    m, point = slope.size, np.empty(slope.size)
    arc = estimate + path.start[-1]
    path_at(path.polynomial, path.waves, path.rate, path.start, arc, point, slope)
    speed = 0.0
    for a in range(m):
        speed += slope[a] * slope[a]
    speed = np.sqrt(speed)
    lag = 0.0
    for a in range(m):
        slope[a] /= speed
        error[a] = -point[a] - speed * slope[a] * (theta - estimate)
        for i in range(start.size):
            error[a] += constants.free[b, a, i] * start[i]
        lag += slope[a] * error[a]
    return speed, lag


@compiled
def _add_controls(constants, b, lag, tangent, error, along, H, g):
    """The part of the error b that the controls have; writes t_b . forced_b into `along`."""
    count, m, columns = constants.forced.shape
    q_c, q_l = constants.weights
    twist, pull = 2 * constants.share[b] * (q_l - q_c), 2 * constants.share[b] * q_c
    here = (b + 1) * (columns // count)  # later blocks do not act yet
    for i in range(here):
        along[i], force = 0.0, 0.0
        for a in range(m):
            along[i] += tangent[a] * constants.forced[b, a, i]
            force += error[a] * constants.forced[b, a, i]
        g[count + i] += pull * force + twist * lag * along[i]
    for i in range(here):
        turned = twist * along[i]
        for j in range(i + 1):
            H[count + i, count + j] += turned * along[j]


@compiled
def _add_speeds(constants, b, speed, lag, along, H, g):
    """The part of the error b that the path speeds have: e_b falls by p'_b share_c v_c."""
    count, columns, share = constants.share.size, constants.curvature.shape[0], constants.share
    here = (b + 1) * (columns // count)
    stiff = 2 * share[b] * constants.weights[1] * speed
    for c in range(b + 1):
        g[c] -= share[c] * stiff * lag
        for i in range(here):
            H[count + i, c] -= stiff * share[c] * along[i]
        for d in range(c + 1):
            H[c, d] += stiff * speed * share[c] * share[d]


@compiled
def _add_changes(constants, start, previous, H, g):
    """The cost of changing speed and control, against what acts now."""
    count, change, push = constants.share.size, constants.change, constants.push
    for c in range(count):
        H[c, c] += 2 * change[c]
        if c + 1 < count:
            H[c, c] += 2 * change[c + 1]
            H[c + 1, c] -= 2 * change[c + 1]
    g[0] -= 2 * change[0] * previous
    p = push.shape[0]
    held = start.size - p
    for i in range(p):
        for j in range(p):
            g[count + i] -= 2 * push[i, j] * start[held + j]


class Path(NamedTuple):
    """Pieces of a path in one unit of length, s from the start of each.

    p(s) = sum_i polynomial[i] s^i + cosine cos(rate s) + sine sin(rate s); `waves` holds cosine and
    sine.
    """

    polynomial: Float[np.ndarray, "P 6 m"]
    waves: Float[np.ndarray, "P 2 m"]
    rate: Float[np.ndarray, " P"]
    start: Float[np.ndarray, " P+1"]

    @property
    def length(self) -> float:
        """Largest path parameter."""
        return float(self.start[-1])

    @property
    def axes(self) -> int:
        """Number of axes m."""
        return self.polynomial.shape[-1]

    def at(self, arc: float) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Position and its derivative at a path parameter, which ends where the path does."""
        position, slope = np.empty(self.axes), np.empty(self.axes)
        path_at(*self, min(max(arc, 0.0), self.length), position, slope)
        return position, slope


def path_of(contour: Contour, unit: float) -> Path:
    """The path of one contour in units of `unit` [m].

    Raises:
        ValueError: the unit is not above zero, or the contour is a stack or has no length.
    """
    if not (np.isfinite(unit) and unit > 0):
        raise ValueError(f"length_unit: needs to be above zero, received {unit}")
    mask = np.asarray(contour.mask)
    if mask.ndim != 1:
        raise ValueError(
            f"contour: needs a single contour, received a stack of shape {mask.shape[:-1]}"
        )
    polynomial, cosine, sine, rate, _, extent = (
        np.asarray(rows, float)[mask] for rows in contour.pieces
    )
    if not (extent.size and extent.sum() > 0):
        raise ValueError("contour: a path needs a length above zero, received zero")
    powers = unit ** (np.arange(polynomial.shape[1]) - 1.0)
    start = np.append(0.0, np.cumsum(extent / unit))
    return Path(
        polynomial * powers[:, None], np.stack([cosine, sine], axis=1) / unit, rate * unit, start
    )


@compiled
def path_at(polynomial, waves, rate, start, arc, position, slope) -> None:
    """Write p(arc) and dp/darc, of the piece that begins at or before `arc`.

    The last piece goes on beyond the end.
    """
    low, high = 0, rate.size - 1
    while low < high:
        middle = (low + high + 1) // 2
        if start[middle] <= arc:
            low = middle
        else:
            high = middle - 1
    s, m = arc - start[low], polynomial.shape[2]
    for a in range(m):
        value, change = 0.0, 0.0
        for i in range(polynomial.shape[1] - 1, -1, -1):
            change = change * s + value
            value = value * s + polynomial[low, i, a]
        position[a], slope[a] = value, change
    if rate[low] != 0:
        cos, sin = np.cos(rate[low] * s), np.sin(rate[low] * s)
        for a in range(m):
            cosine, sine = waves[low, 0, a], waves[low, 1, a]
            position[a] += cosine * cos + sine * sin
            slope[a] += rate[low] * (sine * cos - cosine * sin)
