"""From a linear model, weights and a window of the reference to a QP in the controls alone.

With z = (u_0, ..., u_{N-1}) and what is known at the sample, s = (x_0, u_{-1}, w, d), everything
ahead is affine:

    x_{j+1} = A x_j + B v_j + w,    v_j = u_j + d
    x_j = Fx_j s + Gx_j z,    y_j = C x_j = Fy_j s + Gy_j z
`w` is a constant disturbance of the state, `d` one of the controls: v is what the machine feels.
Their values are the form's. The cost

    sum_{j=1}^{N-1} stage_j (y_j - y_d,j)' Q_j (y_j - y_d,j) + sum_j v_j' R v_j + du_j' S du_j +
    (xi_N - xi_d)' P (xi_N - xi_d)
becomes 1/2 z' H z + g' z, divided by one constant so that H is of order one; every row of limits is
divided by its largest entry.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour._compiled import compiled
from jcontour.linear.plant import LinearPlant
from jcontour.mpc.tracking.limits import Limits
from jcontour.qp.problem import QP

# of the largest entry of the same kind of row: limits on what the controls of the window cannot
# change are left out
NEGLIGIBLE = 1e-12
INVERTIBLE = 1e-6  # of A: rounding that its inverse may bring
# limits that softening reaches; control and increment are the actuator's own
SOFT = ("state", "output", "speed", "acceleration")


class Prediction(NamedTuple):
    """Maps from s (q,) and z (N p,) to the states and outputs ahead, j = 1..N."""

    Fx: Float[np.ndarray, "N n q"]
    Gx: Float[np.ndarray, "N n z"]
    Fy: Float[np.ndarray, "N m q"]
    Gy: Float[np.ndarray, "N m z"]


class Window(NamedTuple):
    """The reference over one horizon."""

    Q: Float[np.ndarray, "N-1 m m"]  # output weights, j = 1..N-1
    y_d: Float[np.ndarray, "N-1 m"]  # desired outputs, likewise
    P: Float[np.ndarray, "t t"]  # terminal weight, the stage profile included
    xi_d: Float[np.ndarray, " t"]  # its target
    # control that holds the machine where the run begins: it costs nothing
    held: Float[np.ndarray, " p"]


class TerminalMaps(NamedTuple):
    """Maps to xi_N = F s + G z, and a typical weight P on it."""

    F: Float[np.ndarray, "t q"]
    G: Float[np.ndarray, "t z"]
    P: Float[np.ndarray, "t t"]


class Cost(NamedTuple):
    """Constant parts of the cost, `scale` is what it is multiplied by."""

    base: Float[np.ndarray, "z z"]  # part of H that the controls and their increments cost, scaled
    gu: Float[np.ndarray, "z q"]  # part of g that u_{-1} and d bring, scaled: g = gu s +
    # Fy, Gy: maps to the outputs, j = 1..N-1
    Fy: Float[np.ndarray, "N-1 m q"]
    Gy: Float[np.ndarray, "N-1 m z"]
    stage: Float[np.ndarray, " N-1"]  # their profile
    # FT, GT: maps to xi_N
    FT: Float[np.ndarray, "t q"]
    GT: Float[np.ndarray, "t z"]
    scale: float  # 1 / the largest entry of a typical H


class Rows(NamedTuple):
    """Limits lower <= C z + F s <= upper."""

    # C, F: maps of z and s
    C: Float[np.ndarray, "r z"]
    F: Float[np.ndarray, "r q"]
    # lower, upper: bounds
    lower: Float[np.ndarray, " r"]
    upper: Float[np.ndarray, " r"]
    size: Float[np.ndarray, " r"]  # what each row was divided by
    soft: Bool[np.ndarray, " r"]  # rows that give way when there is a penalty


def predict(model: LinearPlant, horizon: int) -> Prediction:
    """The maps of a model over `horizon` samples."""
    A, B, C = (np.asarray(matrix, float) for matrix in (model.A, model.B, model.C))
    n, p = B.shape
    known = 2 * (n + p)
    Fx, Gx = np.zeros((horizon, n, known)), np.zeros((horizon, n, horizon * p))
    F, G = np.eye(n, known), np.zeros((n, horizon * p))
    for j in range(horizon):
        F, G = A @ F, A @ G
        F[:, n + p : -p] += np.eye(n)
        F[:, -p:] += B
        G[:, j * p : (j + 1) * p] += B
        Fx[j], Gx[j] = F, G
    return Prediction(Fx, Gx, C @ Fx, C @ Gx)


def difference_maps(
    horizon: int, inputs: int, states: int
) -> tuple[Float[np.ndarray, "N p q"], Float[np.ndarray, "N p z"]]:
    """Maps of s and z to du_0..du_{N-1}."""
    F = np.zeros((horizon, inputs, 2 * (states + inputs)))
    F[0, :, states : states + inputs] = -np.eye(inputs)
    G = np.eye(horizon * inputs) - np.eye(horizon * inputs, k=-inputs)
    return F, G.reshape(horizon, inputs, horizon * inputs)


def limit_rows(model: LinearPlant, prediction: Prediction, limits: Limits) -> Rows:
    """Rows of all limits (`full_limits`) but those on the control, which are the box."""
    kinds = [
        _rows_of(F, G, getattr(limits, name), name in SOFT)
        for name, (F, G) in limited_signals(model, prediction).items()
    ]
    C, F, lower, upper, size, soft = (np.concatenate(column) for column in zip(*kinds, strict=True))
    return Rows(C / size[:, None], F / size[:, None], lower / size, upper / size, size, soft)


def limited_signals(
    model: LinearPlant, prediction: Prediction
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Maps (F, G) of every limited signal but the control, by the name of its limit.

    The acceleration at the sample itself needs y_{-1}: the model gives it where A has an inverse.
    """
    n, m = model.states, model.axes
    horizon, _, q = prediction.Fx.shape
    now = np.concatenate([np.asarray(model.C, float), np.zeros((m, q - n))], axis=1)
    Fy = np.concatenate([now[None], prediction.Fy])
    Gy = np.concatenate([np.zeros((1, *prediction.Gy.shape[1:])), prediction.Gy])
    before = _output_before(model, q)
    Fa = np.concatenate([before, Fy])
    Ga = np.concatenate([np.zeros((len(before), *Gy.shape[1:])), Gy])
    return {
        "increment": difference_maps(horizon, model.inputs, n),
        "state": (prediction.Fx, prediction.Gx),
        "output": (prediction.Fy, prediction.Gy),
        "speed": (np.diff(Fy, axis=0) / model.dt, np.diff(Gy, axis=0) / model.dt),
        "acceleration": (
            np.diff(Fa, 2, axis=0) / model.dt**2,
            np.diff(Ga, 2, axis=0) / model.dt**2,
        ),
    }


def _output_before(model: LinearPlant, known: int) -> Float[np.ndarray, "k m q"]:
    """Map of s to y_{-1} = C A^-1 (x_0 - B (u_{-1} + d) - w), k = 1; k = 0 without an inverse.

    Delays are no loss there: what they hold back, the control of the sample does not change.
    """
    A, B, C = (np.asarray(matrix, float) for matrix in (model.A, model.B, model.C))
    if np.linalg.cond(A) * np.finfo(float).eps > INVERTIBLE:
        return np.zeros((0, len(C), known))
    back = np.linalg.solve(A.T, C.T).T
    return np.concatenate([back, -back @ B, -back, -back @ B], axis=1)[None]


def _rows_of(F: np.ndarray, G: np.ndarray, bounds: tuple, soft: bool) -> Rows:
    """Rows of one signal, not yet divided by their size, without those that nothing limits."""
    lower, upper = (np.tile(bound, len(G)) for bound in bounds)
    F, G = F.reshape(-1, F.shape[-1]), G.reshape(-1, G.shape[-1])
    size = np.abs(G).max(axis=1, initial=0.0)
    limited = np.isfinite(lower) | np.isfinite(upper)
    kept = limited & (size > NEGLIGIBLE * size.max(initial=0.0))
    gives = np.full(kept.sum(), soft)
    return Rows(G[kept], F[kept], lower[kept], upper[kept], size[kept], gives)


class Condensed:
    """The QP of a run: what is constant, from which `problem` makes the QP of a sample.

    Args:
        model: of the machine.
        R, S: weights on control and increment (p, p).
        stage: profile (N,), the last entry for the terminal.
        Q_typical: output weight (m, m) of typical size: it sets the constant that the cost is
            divided by.
        terminal: its maps and a typical P.
        limits: as `full_limits` gives them.
        penalty: cost of a unit of slack for soft rows, in the scaled problem; None keeps every row
            hard. With a penalty above the multipliers (of order one here) the answer is that of the
            hard problem wherever there is one: the exact penalty. One slack per sample and kind
            would not change that; one for each row is simplest.
    """

    def __init__(
        self,
        model: LinearPlant,
        R: Float[np.ndarray, "p p"],
        S: Float[np.ndarray, "p p"],
        stage: Float[np.ndarray, " N"],
        Q_typical: Float[np.ndarray, "m m"],
        terminal: TerminalMaps,
        limits: Limits,
        penalty: float | None = None,
    ):
        prediction = predict(model, len(stage))
        Fy, Gy = (np.ascontiguousarray(maps[:-1]) for maps in (prediction.Fy, prediction.Gy))
        FT, GT, P_typical = (np.ascontiguousarray(part) for part in terminal)
        profile = np.array(stage[:-1], float)
        Fu, Gu = difference_maps(len(stage), model.inputs, model.states)
        base = 2 * np.kron(np.eye(len(stage)), R) + 2 * np.einsum("jpa,pq,jqb->ab", Gu, S, Gu)
        typical = (
            base
            + 2 * np.einsum("j,jma,mk,jkb->ab", profile, Gy, Q_typical, Gy)
            + 2 * GT.T @ P_typical @ GT
        )
        scale = 1 / np.abs(typical).max()
        gu = 2 * scale * np.einsum("jpa,pq,jqb->ab", Gu, S, Fu)
        gu[:, -model.inputs :] += 2 * scale * np.tile(R, (len(stage), 1))
        self.cost = Cost(base * scale, gu, Fy, Gy, profile, FT, GT, float(scale))
        self.rows = limit_rows(model, prediction, limits)
        self._inputs = model.inputs
        self.moves = len(stage) * model.inputs
        gives = self.rows.soft if penalty is not None else np.zeros(len(self.rows.soft), bool)
        self._gives = np.flatnonzero(gives)
        self._C, self._F, self._low, self._high = _with_slack(self.rows, self._gives, self.moves)
        self._at_once = ~np.any(self._C[:, self._inputs : self.moves], axis=1)
        slacks = len(self._gives)
        assert limits.control is not None  # `full_limits` has filled it
        low, high = (np.tile(bound, len(stage)) for bound in limits.control)
        self._lower = np.concatenate([low, np.zeros(slacks)])
        self._upper = np.concatenate([high, np.full(slacks, np.inf)])
        self._penalty = 0.0 if penalty is None else penalty

    def problem(self, s: Float[np.ndarray, " q"], window: Window, out: QP | None = None) -> QP:
        """The QP of a sample, from s = (x_0, u_{-1}, w, d) and the reference ahead.

        Args:
            s: what is known.
            window: of the reference.
            out: an earlier QP of this object whose H, g and limits of rows are written over;
                new arrays when not given.
        """
        qp = out
        if qp is None:  # the slack has its cost, all other numbers are filled in
            n, r = self._lower.size, len(self._C)
            free = np.zeros((n, n)), np.full(n, self._penalty), self._C, np.empty(r), np.empty(r)
            qp = QP(*free, self._lower, self._upper)
        _fill_cost(qp.H, qp.g, self.cost, window, s)
        _fill_rows(qp.lower_rows, qp.upper_rows, self._low, self._high, self._F, s)
        return qp

    def slack(self, z: Float[np.ndarray, " n"]) -> float:
        """The largest violation of a soft limit, in the limit's own unit."""
        return float(np.max(z[self.moves :] * self.rows.size[self._gives], initial=0.0))

    def of_first_control(self, forces: Float[np.ndarray, " c"]) -> Float[np.ndarray, " k"]:
        """Of all multipliers, those of limits on what the first control alone decides."""
        bounds, rows = forces[: self._inputs], forces[len(self._lower) :]
        return np.concatenate([bounds, rows[self._at_once]])


def _with_slack(
    rows: Rows, gives: np.ndarray, moves: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(C, F, low, high) of the rows, those that give way split in two, each with its slack."""
    r, slacks = len(rows.size), np.arange(len(gives))
    C = np.zeros((r + len(gives), moves + len(gives)))
    C[:r, :moves] = rows.C
    C[r:, :moves] = rows.C[gives]
    C[gives, moves + slacks] = -1.0  # value - slack <= upper
    C[r + slacks, moves + slacks] = 1.0  # value + slack >= lower
    low = np.concatenate([rows.lower, rows.lower[gives]])
    high = np.concatenate([rows.upper, rows.upper[gives]])
    low[gives], high[r:] = -np.inf, np.inf
    return C, np.concatenate([rows.F, rows.F[gives]]), low, high


@compiled
def _fill_cost(H, g, cost, window, s):
    """Write H and the part of g that the controls have."""
    moves, m, t = cost.base.shape[0], window.Q.shape[1], window.P.shape[0]
    p = cost.gu.shape[0] // (cost.stage.size + 1)
    weighted = np.empty((max(m, t), moves))
    H[:moves, :moves] = cost.base
    g[:moves] = cost.gu @ s
    for j in range(cost.stage.size):
        free = cost.Fy[j] @ s - window.y_d[j]
        factor, reach = 2 * cost.scale * cost.stage[j], (j + 1) * p
        _add_square(H, g, cost.Gy[j], window.Q[j], free, factor, reach, weighted)
    free = cost.FT @ s - window.xi_d
    _add_square(H, g, cost.GT, window.P, free, 2 * cost.scale, moves, weighted)
    for a in range(moves):
        for b in range(a):
            H[b, a] = H[a, b]


@compiled
def _add_square(H, g, G, Q, free, factor, reach, weighted):
    """Lower half of H += factor G' Q G, and g += factor G' Q free."""
    # the columns of G are zero from `reach` on
    m = G.shape[0]
    for i in range(m):
        pull = 0.0
        for k in range(m):
            pull += Q[i, k] * free[k]
        for a in range(reach):
            total = 0.0
            for k in range(m):
                total += Q[i, k] * G[k, a]
            weighted[i, a] = factor * total
            g[a] += factor * G[i, a] * pull
    for i in range(m):
        for a in range(reach):
            left = G[i, a]
            if left != 0.0:
                for b in range(a + 1):
                    H[a, b] += left * weighted[i, b]


@compiled
def _fill_rows(lower_rows, upper_rows, low, high, F, s):
    free = F @ s
    for i in range(free.size):
        lower_rows[i], upper_rows[i] = low[i] - free[i], high[i] - free[i]
