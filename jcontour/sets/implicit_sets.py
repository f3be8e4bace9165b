"""Robust control invariant sets that are never written down as rows.

With the responses X, U of `finite_responses` and h_j, the growth of a signal's peak over j samples,

    R = { x : there are x_0 = x, u_0..u_N with x_{j+1} = A x_j + B u_j,
              |c x_j + d u_j| <= limit - h_j,   j = 0..N,   h_N the whole peak,
              x_N = A x_N + B u_N }.
If u_0 acts at x and w disturbs, then x'_j = x_{j+1} + X_j w, u'_j = u_{j+1} + U_j w is a plan from
the next state: signal j loses h_{j+1} - h_j of its room, no more than the plan had, and X_N = 0
brings it to rest again. So R is robust control invariant, in any dimension. A question about it is
one linear program of N (n + p) variables.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from scipy.optimize import linprog

from jcontour.sets.disturbed_model import DisturbedModel, Numbers, Signal
from jcontour.sets.finite_responses import FiniteResponse
from jcontour.sets.least_peaks import least_peak

OUTSIDE = 1e-8  # of a limit: a plan that exceeds it by less counts as one that keeps it
PRECISION = 1e-9  # of the solver, absolute, on signals that are scaled by their limits


class ImplicitSet:
    """Invariant set of a response under limits.

    A slide of 1 kg with a drive of 4 N, pushed by at most 1 N, kept within 10 mm:

    >>> dt = 1e-2
    >>> slide = DisturbedModel.of([[1, dt], [0, 1]], [dt**2 / 2, dt], [dt**2 / 2, dt])
    >>> limits = [*slide.state_signals(["x"], [1, 0], 0.01), *slide.control_signals(4.0)]
    >>> found = least_peak(slide, limits[:1], limits[1:], length=10)
    >>> invariant = ImplicitSet(found.response, limits)
    >>> invariant.contains([0.009, 0.0]), invariant.contains([0.009, 0.2])
    (True, False)

    Args:
        response: finite responses of the model.
        signals: with their limits; those without one say nothing.

    Raises:
        ValueError: a signal's peak is above its limit: the set is empty; it names the signal.
    """

    def __init__(self, response: FiniteResponse, signals: Sequence[Signal]):
        self.response = response
        self.signals = [signal for signal in signals if np.isfinite(signal.limit)]
        if not self.signals:
            raise ValueError("signals: needs at least one with a limit")
        for signal in self.signals:
            peak = response.peak(signal)
            if peak > signal.limit:
                raise ValueError(
                    f"{signal.name}: the set is empty, disturbances make a peak of {peak:.6g}, "
                    f"the limit is {signal.limit:.6g}"
                )

    @classmethod
    def roomy(cls, model: DisturbedModel, signals: Sequence[Signal], length: int) -> "ImplicitSet":
        """The set of the responses whose largest peak, in shares of the limits, is the least.

        It is larger than that of the least peak of one signal, which uses up the others' room.

        Raises:
            NoResponse: no response of this length comes to rest.
            ValueError: even these responses need more than the limits; it names the signal.
        """
        shares = [
            Signal(one.name, one.state / one.limit, one.control / one.limit)
            for one in signals
            if np.isfinite(one.limit)
        ]
        return cls(least_peak(model, shares, [], length).response, signals)

    def contains(self, state: Numbers) -> bool:
        """Whether a state (n,) is in the set."""
        return self.plan(state) is not None

    def plan(self, state: Numbers) -> Float[np.ndarray, "N p"] | None:
        """Controls u_0..u_{N-1} of a plan from a state (n,); None outside the set.

        The plan stays as far from the limits as it can, in shares of them.
        """
        start = np.asarray(state, float)
        n = self.response.model.states
        if start.shape != (n,) or not np.isfinite(start).all():
            raise ValueError(f"state: needs {n} finite numbers, received {state}")
        rows, bounds = self._rows
        equations = self._equations
        width = (self.response.length + 1) * (n + self.response.model.inputs)
        height = (self.response.length + 1) * n
        # one more variable: the share of its limit that every signal has at least in hand
        in_hand = np.zeros(width + 1)
        in_hand[-1] = -1.0
        found = linprog(
            in_hand,
            sparse.hstack([rows, np.ones((len(bounds), 1))], format="csr"),
            bounds,
            sparse.hstack([equations, sparse.csr_array((height, 1))], format="csr"),
            np.zeros(height),
            bounds=[*zip(start, start, strict=True), *[(None, None)] * (width - n), (None, 1.0)],
            method="highs",
            options={"primal_feasibility_tolerance": PRECISION},
        )
        if found.status != 0 or found.x[-1] < -OUTSIDE:
            return None
        N, p = self.response.length, self.response.model.inputs
        return found.x[(N + 1) * n : (N + 1) * n + N * p].reshape(N, p)

    def support(self, directions: Numbers) -> Float[np.ndarray, " k"]:
        """Largest c x on the set, of every direction c (k, n); infinite where there is none."""
        found = self.farthest(directions)
        rows = np.atleast_2d(np.asarray(directions, float))
        return np.array(
            [np.inf if one is None else row @ one for row, one in zip(rows, found, strict=True)]
        )

    def farthest(self, directions: Numbers) -> list[Float[np.ndarray, " n"] | None]:
        """State of the set with the largest c x, of every direction; None where it has no end."""
        n, samples = self.response.model.states, self.response.length + 1
        height, width = samples * n, samples * (n + self.response.model.inputs)
        (rows, bounds), equations = self._rows, self._equations
        states = []
        for direction in np.atleast_2d(np.asarray(directions, float)):
            cost = np.zeros(width)
            cost[:n] = -direction
            found = linprog(
                cost,
                rows,
                bounds,
                equations,
                np.zeros(height),
                bounds=(None, None),
                method="highs",
                options={"primal_feasibility_tolerance": PRECISION},
            )
            states.append(found.x[:n] if found.status == 0 else None)
        return states

    @cached_property
    def _equations(self) -> sparse.csr_array:
        """Dynamics of x_0..x_N and u_0..u_N, and rest at the end."""
        model, N = self.response.model, self.response.length
        n = model.states
        steps = sparse.kron(sparse.eye_array(N, N + 1, k=1), np.eye(n)) - sparse.kron(
            sparse.eye_array(N, N + 1), model.A
        )
        forces = -sparse.kron(sparse.eye_array(N, N + 1), model.B)
        last = sparse.eye_array(1, N + 1, k=N)
        rest = sparse.kron(last, np.eye(n) - model.A)
        return sparse.csr_array(
            sparse.block_array([[steps, forces], [rest, -sparse.kron(last, model.B)]])
        )

    @cached_property
    def _rows(self) -> tuple[sparse.csr_array, np.ndarray]:
        """Signals over the plan, scaled by their limits, from both sides."""
        each = sparse.eye_array(self.response.length + 1)
        rows, bounds = [], []
        for signal in self.signals:
            state, control = signal.state / signal.limit, signal.control / signal.limit
            row = sparse.hstack([sparse.kron(each, state), sparse.kron(each, control)])
            room = 1.0 - self.response.growth(state, control)
            rows += [row, -row]
            bounds += [room, room]
        return sparse.csr_array(sparse.vstack(rows)), np.concatenate(bounds)
