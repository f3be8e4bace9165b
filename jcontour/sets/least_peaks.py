"""Responses of least peak: the smallest error that any policy of a given length can promise.

The policy with the responses X, U of `responses` keeps |c x + d u| below the peak of that
signal, whatever the disturbances of the box do. The responses of least peak are the optimum of a
linear program: the finite form of system level synthesis (Anderson, Doyle, Low & Matni 2019) with
the peaks of l1 optimal control (Dahleh & Pearson 1987) as its cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from scipy.optimize import OptimizeResult, linprog

from jcontour.sets.responses import DisturbedModel, FiniteResponse, Signal, brought_to_rest

EXCESS = 1e-7  # relative, of a limit, that counts as broken
TOLERANCE = 1e-10  # of HiGHS, absolute, on variables of size one: the default 1e-7 costs 4 digits
HEADROOM = 1e-9  # of a limit, left free: rounding may not carry a peak above its limit


@dataclass(frozen=True)
class LeastPeak:
    """Optimum of the linear program."""

    # one of the optimal responses; the tolerance is unique, the responses are not
    response: FiniteResponse
    tolerance: float  # the smallest largest peak of the signals that are minimised


class NoResponse(ValueError):
    """No response of this length respects the limits."""


class PeakProgram:
    """The linear program, over the responses of one disturbance after the other.

    Variables: for every disturbance X_1..X_{N-1} and U_0..U_{N-1}, scaled; the absolute values of
    every signal; the optimum t; the excess of every limit, where limits may be broken.
    """

    def __init__(
        self,
        model: DisturbedModel,
        signals: Sequence[Signal],
        minimised: int,
        length: int,
    ):
        self.model, self.length = model, length
        self.minimised = list(signals[:minimised])
        self.bounded = [signal for signal in signals if np.isfinite(signal.limit)]
        self.per_disturbance: int = (length - 1) * model.states + length * model.inputs
        self.responses_size = self.per_disturbance * model.disturbances
        self.sizes = length * model.disturbances  # absolute values of one signal
        self.optimum = self.responses_size + self.sizes * self.signals

    @property
    def signals(self) -> int:
        """Number of signals whose absolute values are variables."""
        return len(self.minimised) + len(self.bounded)

    def solved(self, scales: np.ndarray, size: float, soft: bool = False) -> OptimizeResult | None:
        """Optimum; None where there is none.

        Args:
            scales: of the states (n,).
            size: of the optimum.
            soft: the excess over the limits is minimised, and nothing else.
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
        program = linprog(
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
        return program if program.status == 0 else None

    def responses(self, solution: OptimizeResult, scales: np.ndarray):
        """States X_1..X_{N-1} and controls U_0..U_{N-1} of the optimum."""
        n, p, N, q = *self.model.B.shape, self.length, self.model.disturbances
        each = solution.x[: self.responses_size].reshape(q, self.per_disturbance)
        states = each[:, : (N - 1) * n].reshape(q, N - 1, n) * scales
        controls = each[:, (N - 1) * n :].reshape(q, N, p)
        whole = np.concatenate([self.model.E.T[:, None], states], axis=1)
        return whole.transpose(1, 2, 0), controls.transpose(1, 2, 0)

    def excess(self, solution: OptimizeResult) -> np.ndarray:
        """Excess over every limit, relative."""
        return solution.x[self.optimum + 1 :]

    def _equations(self, scales: np.ndarray) -> tuple[sparse.csr_array, np.ndarray]:
        """Dynamics from X_0 = E to X_N = 0."""
        (A, B, E), N = self.model, self.length
        A, B = A * scales / scales[:, None], B / scales[:, None]
        n = len(A)
        shifted = sparse.eye_array(N, N - 1)  # row j holds X_{j+1}
        before = sparse.eye_array(N, N - 1, k=-1)  # row j holds X_j
        on_states = sparse.kron(shifted, np.eye(n)) - sparse.kron(before, A)
        on_controls = -sparse.kron(sparse.eye_array(N), B)
        values = np.zeros((self.model.disturbances, N * n))
        values[:, :n] = (A @ (E / scales[:, None])).T
        dynamics = sparse.hstack([on_states, on_controls])
        whole = sparse.kron(sparse.eye_array(len(values)), dynamics)
        beside = sparse.csr_array((values.size, self.sizes * self.signals + 1))
        return sparse.csr_array(sparse.hstack([whole, beside])), values.ravel()

    def _peaks(self, scales: np.ndarray, size: float) -> tuple[sparse.csr_array, np.ndarray]:
        """Absolute values from above; their sums under the optimum, then under the limits."""
        units = [size] * len(self.minimised)
        units += [(1 - HEADROOM) * signal.limit for signal in self.bounded]
        signals = [*self.minimised, *self.bounded]
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
        optimum[: len(self.minimised)] = -1.0
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


def least_peak(
    model: DisturbedModel,
    minimised: Sequence[Signal],
    limited: Sequence[Signal],
    length: int,
) -> LeastPeak:
    """Responses whose largest peak is the least, under limits on the peaks of other signals.

    A slide of 1 kg, pushed by at most 1 N of 4 N that its drive has, sampled every 10 ms:

    >>> dt = 1e-2
    >>> slide = DisturbedModel.of([[1, dt], [0, 1]], [dt**2 / 2, dt], [dt**2 / 2, dt])
    >>> position = slide.state_signals(["position"], [1, 0])
    >>> peak = least_peak(slide, position, slide.control_signals(4.0), length=10)
    >>> f"{1e3 * peak.tolerance:.3f} mm"
    '0.100 mm'

    Args:
        model: matrices A, B, E.
        minimised: signals whose largest peak is the cost, all in one unit; limits on them hold.
        limited: signals with a limit.
        length: samples N after which the answer to a disturbance has come to rest.

    Raises:
        NoResponse: no response of this length respects the limits; it names what is too small.
        ValueError: nothing is minimised, a length below one, or a limit that is not above zero.
    """
    if not minimised:
        raise ValueError("minimised: needs at least one signal")
    if length < 1:
        raise ValueError(f"length: needs at least one sample, received {length}")
    names = [signal.name for signal in [*minimised, *limited]]
    if len(set(names)) < len(names):
        raise ValueError(f"signals: every name may be there once, received {', '.join(names)}")
    for signal in [*minimised, *limited]:
        shapes = np.shape(signal.state), np.shape(signal.control)
        if shapes != ((model.states,), (model.inputs,)):
            needed = f"({model.states},) and ({model.inputs},)"
            raise ValueError(f"{signal.name}: needs rows of shape {needed}, received {shapes}")
        if not signal.limit > 0:
            raise ValueError(f"{signal.name}: needs a limit above zero, received {signal.limit}")
    program = PeakProgram(model, [*minimised, *limited], len(minimised), length)
    first, sizes = _first_solution(program)
    # every state and the optimum itself are scaled to one: the solver's tolerances are absolute
    scales = _scales(program, first, sizes)
    size = max(float(first.x[program.optimum]), np.finfo(float).tiny ** 0.25)
    fine = program.solved(scales, size)
    if fine is None:
        fine, scales, size = first, sizes, 1.0
    _, controls = program.responses(fine, scales)
    response = brought_to_rest(model, controls)
    return LeastPeak(response, max(response.peak(signal) for signal in minimised))


def _first_solution(program: PeakProgram) -> tuple[OptimizeResult, Float[np.ndarray, " n"]]:
    """First optimum and its scales of the states, by which the solver finds an answer."""
    # with states of one, of the largest push, and of a response that keeps the limits, which is
    # found even where the numbers are of very different sizes
    sizes = np.abs(program.model.E).max(axis=1)
    sizes = np.where(sizes > 0, sizes, 1.0)
    for scales in (np.ones(program.model.states), sizes):
        if solution := program.solved(scales, 1.0):
            return solution, scales
    keeping = program.solved(sizes, 1.0, soft=True) if program.bounded else None
    if keeping is not None and program.excess(keeping).max() <= EXCESS:
        scales = _scales(program, keeping, sizes)
        if solution := program.solved(scales, 1.0):
            return solution, scales
    raise _impossible(program, keeping, sizes)


def _scales(
    program: PeakProgram, solution: OptimizeResult, sizes: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Largest state of a response, one where it is always zero."""
    states, _ = program.responses(solution, sizes)
    largest = np.abs(states).max(axis=(0, 2))
    return np.where(largest > 0, largest, 1.0)


def _impossible(
    program: PeakProgram, solution: OptimizeResult | None, sizes: Float[np.ndarray, " n"]
) -> NoResponse:
    """The exception, with the limits that are too small in the response of least excess."""
    N = program.length
    if solution is None:
        return NoResponse(
            f"length: no response of {N} samples comes to rest; a longer one may, "
            "if the controls reach every state"
        )
    needed = {
        signal.name: signal.limit * (1 + float(excess))
        for signal, excess in zip(program.bounded, program.excess(solution), strict=True)
        if excess > EXCESS
    }
    if not needed:
        columns = (np.abs(program.model.E) / sizes[:, None]).max(axis=0)
        ratio = columns.max() / columns[columns > 0].min() if columns.any() else 1.0
        return NoResponse(
            f"model: the limits leave room for a response of {N} samples, but the linear program "
            "has no answer with them; its numbers are of too different sizes, columns of E by a "
            f"factor of {ratio:.3g}"
        )
    limits = {one.name: one.limit for one in program.bounded if one.name in needed}
    needs = [
        f"{name} at most {limits[name]:.6g}, {least:.6g} would do" for name, least in needed.items()
    ]
    return NoResponse(f"limits: no response of {N} samples keeps them: {'; '.join(needs)}")
