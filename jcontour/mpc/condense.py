"""From a linear model, weights and a window of the reference to a QP in the controls alone.

With z = (u_0, ..., u_{N-1}) and what is known at the sample, s = (x_0, u_{-1}, w), everything ahead
is affine:
    x_{j+1} = A x_j + B u_j + w      ->      x_j = Fx_j s + Gx_j z,    y_j = C x_j = Fy_j s + Gy_j z
`w` is a constant state disturbance, zero in the absolute form. The cost
    sum_{j=1}^{N-1} stage_j (y_j - y_d,j)' Q_j (y_j - y_d,j) + sum_j u_j' R u_j + du_j' S du_j +
    (xi_N - xi_d)' P (xi_N - xi_d)
becomes 1/2 z' H z + g' z, divided by one constant so that H is of order one; every row of limits is
divided by its largest entry.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.linear.plant import LinearPlant
from jcontour.mpc.limits import Limits
from jcontour.qp.compiled import compiled
from jcontour.qp.problem import QP

# of the largest entry of the same kind of row: limits on what the controls of the window cannot
# change are left out
NEGLIGIBLE = 1e-12
SOFT = (
    "state",
    "output",
    "speed",
    "acceleration",
)  # limits that softening reaches; control and increment are the actuator's own


class Prediction(NamedTuple):
    """Maps from s (q,) and z (N p,) to the states and outputs ahead, j = 1..N."""

    Fx: Float[np.ndarray, "N n q"]
    Gx: Float[np.ndarray, "N n z"]
    Fy: Float[np.ndarray, "N m q"]
    Gy: Float[np.ndarray, "N m z"]


class Rows(NamedTuple):
    """Limits lower <= C z + F s <= upper, `size` is what each row was divided by, `soft` which give way."""

    C: Float[np.ndarray, "r z"]
    F: Float[np.ndarray, "r q"]
    lower: Float[np.ndarray, " r"]
    upper: Float[np.ndarray, " r"]
    size: Float[np.ndarray, " r"]
    soft: np.ndarray


def predict(model: LinearPlant, horizon: int) -> Prediction:
    """The maps of a model over `horizon` samples."""
    A, B, C = (np.asarray(matrix, float) for matrix in (model.A, model.B, model.C))
    n, p = B.shape
    Fx, Gx = np.zeros((horizon, n, 2 * n + p)), np.zeros((horizon, n, horizon * p))
    F, G = np.hstack([np.eye(n), np.zeros((n, n + p))]), np.zeros((n, horizon * p))
    for j in range(horizon):
        F, G = A @ F, A @ G
        F[:, n + p :] += np.eye(n)
        G[:, j * p : (j + 1) * p] += B
        Fx[j], Gx[j] = F, G
    return Prediction(Fx, Gx, C @ Fx, C @ Gx)


def limit_rows(model: LinearPlant, prediction: Prediction, limits: Limits) -> Rows:
    """Rows of all limits (`full_limits`) but those on the control, which are the box."""
    n, p, m = model.states, model.inputs, model.axes
    horizon, _, q = prediction.Fx.shape
    here = np.concatenate([np.asarray(model.C, float), np.zeros((m, q - n))], axis=1)[None]
    Fy, Gy = (
        np.concatenate([here, prediction.Fy]),
        np.concatenate([np.zeros((1, m, horizon * p)), prediction.Gy]),
    )
    Fu, Gu = difference_maps(horizon, p, n)
    signals = {
        "increment": (Fu, Gu),
        "state": (prediction.Fx, prediction.Gx),
        "output": (prediction.Fy, prediction.Gy),
        "speed": (np.diff(Fy, axis=0) / model.dt, np.diff(Gy, axis=0) / model.dt),
        "acceleration": (
            np.diff(Fy, 2, axis=0) / model.dt**2,
            np.diff(Gy, 2, axis=0) / model.dt**2,
        ),
    }
    parts = []
    for name, (F, G) in signals.items():
        lower, upper = (np.tile(bound, len(G)) for bound in getattr(limits, name))
        F, G = F.reshape(-1, q), G.reshape(-1, horizon * p)
        size = np.abs(G).max(axis=1, initial=0.0)
        kept = (np.isfinite(lower) | np.isfinite(upper)) & (
            size > NEGLIGIBLE * size.max(initial=0.0)
        )
        parts.append(
            (
                G[kept],
                F[kept],
                lower[kept],
                upper[kept],
                size[kept],
                np.full(kept.sum(), name in SOFT),
            )
        )
    C, F, lower, upper, size, soft = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Rows(C / size[:, None], F / size[:, None], lower / size, upper / size, size, soft)


def difference_maps(horizon: int, inputs: int, states: int) -> tuple[np.ndarray, np.ndarray]:
    """Maps of (s, z) to du_0..du_{N-1}: (N, p, q) and (N, p, N p)."""
    F = np.zeros((horizon, inputs, 2 * states + inputs))
    F[0, :, states : states + inputs] = -np.eye(inputs)
    G = np.eye(horizon * inputs) - np.eye(horizon * inputs, k=-inputs)
    return F, G.reshape(horizon, inputs, horizon * inputs)


class Condensed:
    """The QP of a run: what is constant is built here once, `update` fills the rest in place.

    Args:
        model: of the machine.
        R, S: weights on control and increment (p, p).
        stage: profile (N,), the last entry for the terminal.
        Q_typical: output weight (m, m) of typical size: it sets the constant that the cost is
            divided by.
        terminal: maps (F (t, q), G (t, N p)) from s and z to xi_N, and a typical P.
        limits: as `full_limits` gives them.
        penalty: cost of a unit of slack for soft rows, in the scaled problem; None keeps every row
            hard. With a penalty above the multipliers (of order one here) the answer is that of the
            hard problem wherever there is one: the exact penalty. One slack per sample and kind
            would not change that; one for each row is simplest.
        soft: which kinds give way when there is a penalty.
    """

    def __init__(
        self,
        model: LinearPlant,
        R,
        S,
        stage,
        Q_typical,
        terminal,
        limits: Limits,
        penalty: float | None = None,
        soft=SOFT,
    ):
        self.horizon, self.inputs = len(stage), model.inputs
        prediction = predict(model, self.horizon)
        self._Fy, self._Gy = (
            np.ascontiguousarray(prediction.Fy[:-1]),
            np.ascontiguousarray(prediction.Gy[:-1]),
        )
        self._FT, self._GT, P_typical = (np.ascontiguousarray(part) for part in terminal)
        self._stage = np.array(stage[:-1], float)
        Fu, Gu = difference_maps(self.horizon, self.inputs, model.states)
        base = 2 * np.kron(np.eye(self.horizon), R) + 2 * np.einsum("jpa,pq,jqb->ab", Gu, S, Gu)
        typical = (
            base
            + 2 * np.einsum("j,jma,mk,jkb->ab", self._stage, self._Gy, Q_typical, self._Gy)
            + 2 * self._GT.T @ P_typical @ self._GT
        )
        self.scale = 1 / np.abs(typical).max()
        self._base, self._gu = (
            base * self.scale,
            2 * self.scale * np.einsum("jpa,pq,jqb->ab", Gu, S, Fu),
        )
        self.rows = limit_rows(model, prediction, limits)
        self._allocate(limits, penalty)

    def _allocate(self, limits: Limits, penalty: float | None) -> None:
        moves, rows = self.horizon * self.inputs, self.rows
        gives = np.flatnonzero(rows.soft) if penalty is not None else np.zeros(0, int)
        n, r = moves + len(gives), len(rows.size)
        C = np.zeros((r + len(gives), n))
        C[:r, :moves] = rows.C
        C[r:, :moves] = rows.C[gives]
        C[gives, moves + np.arange(len(gives))] = -1.0  # value - slack <= upper
        C[r + np.arange(len(gives)), moves + np.arange(len(gives))] = 1.0  # value + slack >= lower
        self._low, self._high = (
            np.concatenate([rows.lower, rows.lower[gives]]),
            np.concatenate([rows.upper, rows.upper[gives]]),
        )
        self._low[gives], self._high[r:] = -np.inf, np.inf
        self._F = np.concatenate([rows.F, rows.F[gives]])
        lower = np.concatenate([np.tile(limits.control[0], self.horizon), np.zeros(len(gives))])  # type: ignore
        upper = np.concatenate(
            [np.tile(limits.control[1], self.horizon), np.full(len(gives), np.inf)]
        )  # type: ignore
        H, g = np.zeros((n, n)), np.zeros(n)
        g[moves:] = 0.0 if penalty is None else penalty
        self.moves, self._gives = moves, gives
        self.qp = QP(H, g, C, np.zeros(len(C)), np.zeros(len(C)), lower, upper)

    def update(self, s, Q, y_d, P, xi_d) -> QP:
        """The problem of this sample, in arrays that the next call overwrites.

        Args:
            s: (x_0, u_{-1}, w).
            Q: output weights (N-1, m, m), j = 1..N-1.
            y_d: desired outputs (N-1, m).
            P: terminal weight (t, t), the stage profile included.
            xi_d: its target (t,).
        """
        qp = self.qp
        _fill_cost(
            qp.H,
            qp.g,
            self._base,
            self._gu,
            self._Fy,
            self._Gy,
            self._stage,
            Q,
            y_d,
            self._FT,
            self._GT,
            P,
            xi_d,
            s,
            self.scale,
        )
        _fill_rows(qp.lower_rows, qp.upper_rows, self._low, self._high, self._F, s)
        return qp

    def slack(self, z) -> float:
        """The largest violation of a soft limit, in the limit's own unit."""
        return float(np.max(z[self.moves :] * self.rows.size[self._gives], initial=0.0))


@compiled
def _fill_cost(H, g, base, gu, Fy, Gy, stage, Q, y_d, FT, GT, P, xi_d, s, scale):
    moves, m, t, p = base.shape[0], Q.shape[1], P.shape[0], gu.shape[0] // (stage.size + 1)
    weighted = np.empty((max(m, t), moves))
    H[:moves, :moves] = base
    g[:moves] = gu @ s
    for j in range(stage.size):
        _add_square(
            H, g, Gy[j], Q[j], Fy[j] @ s - y_d[j], 2 * scale * stage[j], (j + 1) * p, weighted
        )
    _add_square(H, g, GT, P, FT @ s - xi_d, 2 * scale, moves, weighted)
    for a in range(moves):
        for b in range(a):
            H[b, a] = H[a, b]


@compiled
def _add_square(H, g, G, Q, free, factor, reach, weighted):
    """Lower half of H += factor G' Q G and g += factor G' Q free, with the columns of G from `reach` on zero."""
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
