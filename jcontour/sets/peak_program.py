"""The linear program of the responses of least peak, see `least_peaks`."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse
from scipy.optimize import OptimizeResult, linprog

from jcontour.sets.disturbed_model import DisturbedModel, Signal

TOLERANCE = 1e-10  # of HiGHS, absolute, on variables of size one: the default 1e-7 costs 4 digits
HEADROOM = 1e-9  # of a limit, left free: rounding may not carry a peak above its limit
ACTIVE = 1e-7  # share of a limit in the optimum from which it counts as one that limits


class PeakProgram:
    """The linear program, over the responses of one disturbance after the other.

    Variables: for every disturbance X_1..X_{N-1} and U_0..U_{N-1}, scaled; the absolute values of
    every signal; the optimum t; the excess of every limit, where limits may be broken.
    """

    def __init__(
        self,
        model: DisturbedModel,
        signals: Sequence[Signal],
        small: int,
        length: int,
        vanishing: np.ndarray,
    ):
        self.model, self.length = model, length
        self.small = list(signals[:small])
        self.bounded = [signal for signal in signals if np.isfinite(signal.limit)]
        self.vanishing = vanishing
        self.each: int = (length - 1) * model.states + length * model.inputs
        self.responses_size = self.each * model.disturbances
        self.sizes = length * model.disturbances  # absolute values of one signal
        self.optimum = self.responses_size + self.sizes * self.signals

    @property
    def signals(self) -> int:
        """Number of signals whose absolute values are variables."""
        return len(self.small) + len(self.bounded)

    def solved(self, scales: np.ndarray, size: float, soft: bool = False) -> OptimizeResult | None:
        """Optimum; None where there is none.

        Args:
            scales: of the states (n,).
            size: of the optimum.
            soft: the excess over the limits is made small, and nothing else.
        """
        equations, values = self._equations(scales)
        peaks, most = self._peaks(scales, size)
        more = len(self.bounded) * soft
        if soft:
            above = sparse.csr_array((len(most) - more, more))
            excess = sparse.vstack([above, -sparse.eye_array(more)])
            peaks = sparse.csr_array(sparse.hstack([peaks, excess]))
            nothing = sparse.csr_array((len(values), more))
            equations = sparse.csr_array(sparse.hstack([equations, nothing]))
        cost = np.zeros(self.optimum + 1 + more)
        cost[self.optimum :] = [0.0, *np.ones(more)] if soft else 1.0
        free = [(None, None)] * self.responses_size
        found = linprog(
            cost,
            peaks,
            most,
            equations,
            values,
            bounds=free + [(0.0, None)] * (len(cost) - self.responses_size),
            method="highs",
            options={
                "primal_feasibility_tolerance": TOLERANCE,
                "dual_feasibility_tolerance": TOLERANCE,
            },
        )
        return found if found.status == 0 else None

    def responses(self, found: OptimizeResult, scales: np.ndarray):
        """States X_1..X_{N-1} and controls U_0..U_{N-1} of the optimum."""
        n, p, N, q = *self.model.B.shape, self.length, self.model.disturbances
        each = found.x[: self.responses_size].reshape(q, self.each)
        states = each[:, : (N - 1) * n].reshape(q, N - 1, n) * scales
        controls = each[:, (N - 1) * n :].reshape(q, N, p)
        whole = np.concatenate([self.model.E.T[:, None], states], axis=1)
        return whole.transpose(1, 2, 0), controls.transpose(1, 2, 0)

    def limiting(self, found: OptimizeResult) -> tuple[str, ...]:
        """Names of the limits that the optimum leans on."""
        forces = found.ineqlin.marginals[len(found.ineqlin.marginals) - len(self.bounded) :]
        pairs = zip(self.bounded, np.abs(forces), strict=True)
        return tuple(signal.name for signal, force in pairs if force > ACTIVE)

    def excess(self, found: OptimizeResult) -> np.ndarray:
        """Excess over every limit, relative."""
        return found.x[self.optimum + 1 :]

    def _equations(self, scales: np.ndarray) -> tuple[sparse.csr_array, np.ndarray]:
        """Dynamics from X_0 = E to X_N = 0, and the rows that vanish in the sum."""
        (A, B, E), N = self.model, self.length
        A, B = A * scales / scales[:, None], B / scales[:, None]
        start = E / scales[:, None]
        n = len(A)
        shifted = sparse.eye_array(N, N - 1)  # row j holds X_{j+1}
        before = sparse.eye_array(N, N - 1, k=-1)  # row j holds X_j
        on_states = sparse.kron(shifted, np.eye(n)) - sparse.kron(before, A)
        on_controls = -sparse.kron(sparse.eye_array(N), B)
        sums = sparse.kron(sparse.coo_array(np.ones((1, N - 1))), self.vanishing * scales)
        nothing = sparse.csr_array((len(self.vanishing), N * B.shape[1]))
        blocks = [[on_states, on_controls]]
        if len(self.vanishing):
            blocks.append([sums, nothing])
        first = np.zeros((self.model.disturbances, N * n))
        first[:, :n] = (A @ start).T
        values = np.concatenate([first, -(self.vanishing @ E).T], axis=1)
        whole = sparse.kron(sparse.eye_array(len(values)), sparse.block_array(blocks))
        beside = sparse.csr_array((values.size, self.sizes * self.signals + 1))
        return sparse.csr_array(sparse.hstack([whole, beside])), values.ravel()

    def _peaks(self, scales: np.ndarray, size: float) -> tuple[sparse.csr_array, np.ndarray]:
        """Absolute values from above; their sums under the optimum, then under the limits."""
        units = [size] * len(self.small)
        units += [(1 - HEADROOM) * signal.limit for signal in self.bounded]
        signals = [*self.small, *self.bounded]
        rows, values = [], []
        for place, (signal, unit) in enumerate(zip(signals, units, strict=True)):
            response, known = self._response(signal, scales, unit)
            absolute = sparse.eye_array(1, len(signals), k=place)
            absolute = sparse.kron(absolute, sparse.eye_array(self.sizes))
            last = sparse.csr_array((self.sizes, 1))
            rows += [sparse.hstack([sign * response, -absolute, last]) for sign in (1.0, -1.0)]
            values += [-known, known]
        sums = sparse.kron(sparse.eye_array(len(signals)), np.ones((1, self.sizes)))
        optimum = np.zeros((len(signals), 1))
        optimum[: len(self.small)] = -1.0
        beside = sparse.csr_array((len(signals), self.responses_size))
        rows.append(sparse.hstack([beside, sums, optimum]))
        values.append(1.0 + optimum[:, 0])
        return sparse.csr_array(sparse.vstack(rows)), np.concatenate(values)

    def _response(self, signal: Signal, scales: np.ndarray, unit: float):
        """Signal at samples 0..N-1 as rows of the variables, and what is known of it."""
        N, q = self.length, self.model.disturbances
        c, d = signal.state / unit, signal.control / unit
        on_states = sparse.kron(sparse.eye_array(N, N - 1, k=-1), c * scales)
        on_controls = sparse.kron(sparse.eye_array(N), d)
        known = np.zeros((q, N))
        known[:, 0] = c @ self.model.E
        rows = sparse.kron(sparse.eye_array(q), sparse.hstack([on_states, on_controls]))
        return rows, known.ravel()
