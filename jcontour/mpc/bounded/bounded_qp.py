"""The quadratic program of `bounded`: what does not change along a run is computed once.

Variables are the deviations du of the controls over their limits. Rows are scaled by their limits,
those of the end state by their own size. A row that the controls cannot change yet is left out: it
holds by the tightening of the samples before.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from jcontour.linear.plant import LinearPlant
from jcontour.mpc.bounded.nominal_runs import NominalRun
from jcontour.mpc.bounded.tolerance_rows import Frames
from jcontour.qp.problem import QP, Solution
from jcontour.sets.disturbed_model import Signal
from jcontour.sets.finite_responses import FiniteResponse

TOO_SMALL = 1e-7  # of a limit: what a whole control changes in a row that is left out
ROUNDING = 1e-9  # of a limit, by which rows may be exceeded: certificates are floating point
ACTIVE = 1e-9  # smallest multiplier of a limit that counts as active, in the scaled problem
PENALTY = 1e4  # of the tolerance given up, in the scaled problem; far above its multipliers
HARDER = 1e2  # times that for further signals


class BoundedWeights(NamedTuple):
    """Weights of the deviation from the nominal run, in units of the tolerance and of the limits.

    Attributes:
        output: on the tool's deviation over the tolerance.
        contour: more of it, across the path.
        control: on the deviation of the control over its limit.
    """

    output: float = 1.0
    contour: float = 10.0
    control: float = 1e-3


class Sample(NamedTuple):
    """One sample's own numbers; T in front in a plan.

    Attributes:
        control: nominal v_0..v_{N-1} (N, p).
        directions: of samples k+1..k+N-1 (N-1, r, m).
        limit: on the deviation along them (N-1, r) [m].
        room: what of it is left to the deviation from the nominal run, from below and from above
            (2, N-1, r) [m].
        signal: room of the further signals at samples 0..N-1, from below and above (2, N, s), in
            shares of their limits.
    """

    control: Float[np.ndarray, "*T N p"]
    directions: Float[np.ndarray, "*T J r m"]
    limit: Float[np.ndarray, "*T J r"]
    room: Float[np.ndarray, "*T two J r"]
    signal: Float[np.ndarray, "*T two N s"]


class BoundedQP:
    """Builder of the QPs of one controller.

    Args:
        model: the machine.
        response: that the limits are tightened by.
        control: limits (p,).
        signals: further ones with a limit, of state and control.
        weights: of the cost.
        length: unit of the tool's deviation in the cost [m].
    """

    def __init__(
        self,
        model: LinearPlant,
        response: FiniteResponse,
        control: Float[np.ndarray, " p"],
        signals: Sequence[Signal],
        weights: BoundedWeights,
        length: float,
    ):
        self.response, self.weights, self.unit = response, weights, length
        self.signals, self.sizes = list(signals), control
        (A, B, _), N, p = response.model, response.length, model.inputs
        self.samples_ahead, self.inputs = N, p
        n, self.moves = len(A), N * p
        powers, reach = [np.eye(n)], [np.zeros((n, N * p))]
        for j in range(N):
            powers.append(A @ powers[-1])
            following = A @ reach[-1]
            following[:, j * p : (j + 1) * p] += B * control
            reach.append(following)
        self._powers, self._reach = np.stack(powers), np.stack(reach)
        self._C = np.asarray(model.C)
        self._to_output = self._C @ self._reach[1:N] / length  # (N-1, m, Np)
        self._from_state = self._C @ self._powers[1:N] / length
        in_answer = np.cumsum(response.state, axis=0)[: N - 1]  # sum_{i<j} X_i, j = 1..N-1
        self._answer = self._C @ in_answer / length
        in_control = np.cumsum(response.control, axis=0)
        self._answer_control = np.concatenate([np.zeros_like(in_control[:1]), in_control[:-1]])
        growth = response.growth(np.zeros((p, n)), np.eye(p))[:, :N]
        self._most = 1 + ROUNDING - growth.T / control  # of the controls at samples 0..N-1
        self._terminal()
        self._signal_rows()
        # in the first samples no control reaches the tool yet
        gains = np.abs(self._to_output).max(axis=(1, 2)) * length
        self._first = int(np.argmax(gains > TOO_SMALL * length))

    def samples(self, frames: Frames, room: np.ndarray, run: NominalRun, steps: int) -> Sample:
        """Numbers of samples 0..T-1."""
        N, k = self.samples_ahead, np.arange(steps)[:, None]
        ahead = k + np.arange(1, N)
        stage = np.arange(1, N)
        grown = frames.growth[ahead, :, stage]
        limit = room[ahead] * (1 + ROUNDING)
        left, nominal = limit - grown, frames.nominal[ahead]
        control = run.control[k + np.arange(N)]
        rooms = np.zeros((steps, 2, N, len(self.signals)))
        for s, signal in enumerate(self.signals):
            values = run.state[:-1] @ signal.state + run.control @ signal.control
            growth = self.response.growth(signal.state, signal.control)[:N] / signal.limit
            most, now = 1 + ROUNDING - growth, values[k + np.arange(N)] / signal.limit
            rooms[:, 0, :, s], rooms[:, 1, :, s] = -most - now, most - now
        edges = np.stack([-left - nominal, left - nominal], axis=1)
        return Sample(control, frames.directions[ahead], limit, edges, rooms)

    def problem(
        self,
        sample: Sample,
        deviation: Float[np.ndarray, " n"],
        disturbance: Float[np.ndarray, " q"],
    ) -> QP:
        """The QP of a sample, from e_0 and the estimate of the disturbance."""
        H, g = self._cost(sample, deviation, disturbance)
        path, low, high = self._path(sample, deviation)
        moving, slow, fast = self._moving(sample, deviation)
        end = -(self._powers[-1] @ deviation) / self._end_units
        rows = np.concatenate([path, moving, self._end])
        lower, upper = np.concatenate([low, slow, end]), np.concatenate([high, fast, end])
        return QP(H, g, rows, lower, upper, *self._box(sample))

    def softened(self, sample: Sample, deviation: np.ndarray, disturbance: np.ndarray) -> QP:
        """The QP with a slack for the path and one for further signals, without an end state."""
        H, g = self._cost(sample, deviation, disturbance)
        weight = self._end_reach.T @ self._end_weight
        scale = np.abs(H).max() + np.abs(weight @ self._end_reach).max()
        moves = self.moves
        hessian = np.eye(moves + 2)
        hessian[:moves, :moves] = (H + weight @ self._end_reach) / scale
        pull = np.concatenate([g + weight @ (self._powers[-1] @ deviation), [0.0, 0.0]]) / scale
        pull[moves:] = PENALTY, PENALTY * HARDER
        path, low, high = self._path(sample, deviation)
        moving, slow, fast = self._moving(sample, deviation)
        kinds = np.zeros((len(path) + len(moving), 2))
        kinds[: len(path), 0], kinds[len(path) :, 1] = 1.0, 1.0
        both = np.concatenate([path, moving])
        rows = np.block([[both, -kinds], [both, kinds]])
        most, least = np.concatenate([high, fast]), np.concatenate([low, slow])
        free = np.full(len(both), np.inf)
        lower, upper = self._box(sample)
        return QP(
            hessian,
            pull,
            rows,
            np.concatenate([-free, least]),
            np.concatenate([most, free]),
            np.append(lower, [0.0, 0.0]),
            np.append(upper, [np.inf, np.inf]),
        )

    def slack(self, found: Solution) -> float:
        """Largest excess over the tolerance or another limit, in shares of it."""
        return float(np.max(found.z[self.moves :], initial=0.0))

    def active(self, found: Solution) -> int:
        """Number of limits that the answer leans on."""
        forces = np.abs(found.multipliers)
        if found.z.size == self.moves:
            forces = forces[: forces.size - len(self._end)]  # the end state is no limit
        else:
            forces = np.delete(forces, [self.moves, self.moves + 1])  # nor is the slack
        return int(np.count_nonzero(forces > ACTIVE))

    def control(self, sample: Sample, found: Solution) -> Float[np.ndarray, " p"]:
        """Control of this sample from an answer; the limit holds to the last digit."""
        whole = sample.control[0] + found.z[: self.inputs] * self.sizes
        return np.clip(whole, -self.sizes, self.sizes)

    def _cost(self, sample: Sample, deviation, disturbance) -> tuple[np.ndarray, np.ndarray]:
        """Weight and pull of the moves, scaled by the largest weight."""
        across = sample.directions[:, -1]
        normal = np.einsum("jm,jmz->jz", across, self._to_output)
        flat = self._to_output.reshape(-1, self.moves)
        w = self.weights
        contour = w.contour if sample.directions.shape[1] > 1 else 0.0
        H = w.output * flat.T @ flat + contour * normal.T @ normal + w.control * np.eye(self.moves)
        off = self._from_state @ deviation + self._answer @ disturbance
        controls = (self._answer_control @ disturbance / self.sizes).ravel()
        g = w.output * flat.T @ off.ravel() + w.control * controls
        g = g + contour * normal.T @ np.einsum("jm,jm->j", across, off)
        size = np.abs(H).max()
        return H / size, g / size

    def _path(self, sample: Sample, deviation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        directions = sample.directions[self._first :]
        limit = sample.limit[self._first :]
        rows = np.einsum("jrm,jmz->jrz", directions, self._to_output[self._first :]) * self.unit
        known = np.einsum("jrm,jm->jr", directions, self._from_state[self._first :] @ deviation)
        room = (sample.room[:, self._first :] - known * self.unit) / limit
        flat = (rows / limit[..., None]).reshape(-1, self.moves)
        return flat, room[0].ravel(), room[1].ravel()

    def _moving(self, sample: Sample, deviation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows of the further signals."""
        room = sample.signal - self._signal_state @ deviation
        kept = self._signal_kept
        return self._signal_matrix, room[0][kept], room[1][kept]

    def _signal_rows(self) -> None:
        """Further signals over a plan, in shares of their limits."""
        (n, p), N = self.response.model.B.shape, self.samples_ahead
        c = np.zeros((len(self.signals), n))
        d = np.zeros((len(self.signals), p))
        for s, signal in enumerate(self.signals):
            c[s], d[s] = signal.state / signal.limit, signal.control / signal.limit
        rows = c @ self._reach[:N]
        for j in range(N):
            rows[j, :, j * p : (j + 1) * p] += d * self.sizes
        self._signal_kept = np.abs(rows).max(axis=-1, initial=0.0) > TOO_SMALL
        self._signal_matrix = rows[self._signal_kept]
        self._signal_state = c @ self._powers[:N]

    def _terminal(self) -> None:
        """Rows that end at the nominal run, and the cost that stands for them when softened."""
        model = self.response.model
        self._end_units = np.abs(self._reach[-1]).max(axis=1)
        self._end_units = np.where(self._end_units > 0, self._end_units, 1.0)
        self._end_reach = self._reach[-1]
        self._end = self._end_reach / self._end_units[:, None]
        C, w = self._C / self.unit, self.weights
        Q = (w.output + w.contour) * C.T @ C
        R = w.control * np.diag(1 / self.sizes**2)
        flat = self._to_output.reshape(-1, self.moves)
        size = np.abs(w.output * flat.T @ flat).max() + w.control
        self._end_weight = solve_discrete_are(model.A, model.B, Q, R) / size

    def _box(self, sample: Sample) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the moves: the control's limit less its growth, around the nominal control."""
        nominal = sample.control / self.sizes
        return (-self._most - nominal).ravel(), (self._most - nominal).ravel()
