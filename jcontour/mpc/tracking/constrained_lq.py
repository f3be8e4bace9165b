"""`ContouringLQ` under limits, traceable: weights are tuned with the limits in the loop.

The problem of a sample is that of `TrackingMPC`, in the absolute or the offset-free form,

    sum_{j=1}^{N-1} stage_j e_j' Q_j e_j + sum_{j=0}^{N-1} v_j' R v_j + terminal,
    v_j = u_j + d - u_0,    x_{j+1} = A x_j + B (u_j + d),
u_0 the control that holds the machine where the run begins, stated stage by stage and solved by
`qp.interior_point`, under `jit`, `vmap` and derivatives. Limits on increments need u_{j-1} beside
the state, limits on acceleration y_{j-1}: they are there where they are needed. Limits on control
and increment hold in every plan. Those of state, output, speed and acceleration give way where
nothing can hold them, at a price far above their multipliers, so that elsewhere the answer is that
of the hard problem.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jcontour.controller import Controller, check_preview, whole_preview
from jcontour.controllers.lq.contouring_lq import (
    LQWeights,
    OutputTerminal,
    Terminal,
    check_stage,
    contour_weight,
    control_weight,
)
from jcontour.controllers.observers.kalman import DisturbedState
from jcontour.linear.plant import LinearPlant, operating_point, steady_motion
from jcontour.motion.references import Reference
from jcontour.mpc.tracking.condense import SOFT, limited_signals, predict
from jcontour.mpc.tracking.limits import Limits, full_limits
from jcontour.qp.interior_point import Answer, solve
from jcontour.qp.staged import StagedQP

PRICE = 1e5  # of a limit that gives way, over the multipliers: those are of order one when scaled
NEGLIGIBLE = 1e-12  # of the largest entry of a kind of row: what the controls cannot change


class LimitedMemory(NamedTuple):
    """Memory of `ConstrainedLQ`."""

    control: Float[Array, " p"]  # that acted last
    output: Float[Array, " m"]  # of the model then [m]
    failed: Int[Array, ""]  # steps so far whose problem was not solved


class Ahead(NamedTuple):
    """The reference over the horizon of every step."""

    Q: Float[Array, "T N-1 m m"]  # output weights of samples 1..N-1 with the stage profile
    y_d: Float[Array, "T N-1 m"]  # desired outputs there [m]
    # H_end, g_end: cost to go at sample N, x' H x + 2 g' x
    H_end: Float[Array, "T n n"]
    g_end: Float[Array, "T n"]
    held: Float[Array, "T p"]  # u_0, from which the control counts in the cost


class LimitRows(eqx.Module):
    """Limits on (z, u) of a stage, z the state and what is beside it."""

    D: Float[Array | np.ndarray, "r v"]  # rows
    load: Float[Array | np.ndarray, "r p"]  # what a constant load of the controls adds to them
    # lower, upper: limits; infinite where nothing in the horizon can change a row
    lower: Float[Array | np.ndarray, "N r"]
    upper: Float[Array | np.ndarray, "N r"]
    soft: Bool[Array | np.ndarray, " r"]  # rows that give way
    # largest entry that the controls of the horizon have in a row
    size: Float[Array | np.ndarray, " r"]
    # what is beside the state: the last control, the last output
    beside: tuple[bool, bool] = eqx.field(static=True)

    def none(self) -> "LimitRows":
        """No row, beside the same numbers."""
        cut = slice(0)
        lower, upper = self.lower[:, cut], self.upper[:, cut]
        none = self.D[cut], self.load[cut], lower, upper, self.soft[cut], self.size[cut]
        return LimitRows(*none, self.beside)

    def kept(self, control: Float[Array, " p"]) -> Float[Array, " p"]:
        """A control, cut by the limits on controls."""
        if not len(self.D):
            return control
        return jnp.clip(control, self.lower[0, : control.size], self.upper[0, : control.size])


class ConstrainedLQ(Controller):
    """Receding-horizon LQ contouring that keeps to limits, one quadratic program a sample.

    Where no limit is active it is `ContouringLQ`. A step whose problem is not solved has NaN for a
    control: metrics then tell of a diverged run, and the memory counts it.

    >>> from jcontour.mpc.tracking.limits import Limits
    >>> from jcontour.plants.linear_machines import bridgeport
    >>> limits = Limits.within(control=5.0)
    >>> ConstrainedLQ(bridgeport(), LQWeights(3.0, 5.0, 2e-9), 10, limits).preview
    10

    Args:
        model: of the machine; the measurement is its state, or `DisturbedState`.
        weights: alpha, beta, rho and the stage profile.
        preview: horizon N [samples].
        limits: on control, increment, state, output, speed and acceleration.
        terminal: cost at the end of the horizon.

    Raises:
        ValueError: as `ContouringLQ`, or limits are crossed or of another size.
    """

    model: LinearPlant
    weights: LQWeights
    preview: int = eqx.field(static=True)
    rows: LimitRows
    terminal: Terminal

    def __init__(
        self,
        model: LinearPlant,
        weights: LQWeights,
        preview: int,
        limits: Limits,
        terminal: Terminal | None = None,
    ):
        self.model, self.weights, self.preview = model, weights, whole_preview(preview)
        self.terminal = OutputTerminal() if terminal is None else terminal
        check_stage(weights, self.preview)
        self.terminal.check(model, self.preview)
        self.rows = limit_rows(model, full_limits(limits, model), self.preview)

    def without_planned_limits(self) -> "ConstrainedLQ":
        """The same with nothing in its way: `ContouringLQ`, with the memory of this one."""
        return eqx.tree_at(lambda one: one.rows, self, self.rows.none())

    def prepare(self, reference: Reference) -> Ahead:
        """Costs of the horizon of every step.

        Raises:
            ValueError: the reference looks less far ahead than the controller.
        """
        check_preview(self, reference)
        weights, N, T = self.weights, self.preview, reference.steps
        stage = jnp.ones(N) if weights.stage is None else weights.stage
        position = reference.position[: T + N]
        Q = contour_weight(weights.alpha, weights.beta, reference.tangent[: T + N])
        end = self.terminal.cost(self.model, weights, Q, position, slice(N, T + N))
        ahead = np.arange(T)[:, None] + np.arange(1, N)
        profile = stage[None, : N - 1, None, None]
        held = operating_point(self.model, position[0]).control
        held = jnp.broadcast_to(held, (T, *held.shape))
        H_end, g_end = stage[-1] * end.H, stage[-1] * end.g
        return Ahead(profile * Q[ahead], position[ahead], H_end, g_end, held)

    def initial_memory(self, reference: Reference) -> LimitedMemory:
        """The control that keeps up the motion with which the run begins, cut by its limits."""
        position, increment = reference.position[0], reference.start_increment
        motion, model = steady_motion(self.model), self.model
        state = motion.state(position, increment)
        onward = motion.state(position + increment, increment)
        control = jnp.linalg.lstsq(model.B, onward - model.A @ state)[0]
        return LimitedMemory(self.rows.kept(control), position - increment, jnp.zeros((), int))

    def step(
        self,
        memory: LimitedMemory,
        plan: Ahead,
        measurement: Float[Array, " n"] | DisturbedState,
    ) -> tuple[LimitedMemory, Float[Array, " p"]]:
        """First control of the best plan within the limits."""
        x = measurement.state if isinstance(measurement, DisturbedState) else measurement
        answer = self.answer(memory, plan, measurement)
        n = answer.trajectory.end.size
        control = jnp.where(answer.solved, answer.trajectory.stages[0, n:], jnp.nan)
        failed = memory.failed + jnp.where(answer.solved, 0, 1)
        return LimitedMemory(control, self.model.C @ x, failed), control

    def answer(
        self,
        memory: LimitedMemory,
        plan: Ahead,
        measurement: Float[Array, " n"] | DisturbedState,
    ) -> Answer:
        """The solved problem of a sample."""
        held = jnp.broadcast_to(memory.control, (self.preview, self.model.inputs))
        return solve(self.problem(memory, plan, measurement), held)

    def problem(
        self,
        memory: LimitedMemory,
        plan: Ahead,
        measurement: Float[Array, " n"] | DisturbedState,
    ) -> StagedQP:
        """The quadratic program of a sample."""
        with_load = isinstance(measurement, DisturbedState)
        x = jnp.asarray(measurement.state if with_load else measurement)
        load = jnp.asarray(measurement.disturbance) if with_load else jnp.zeros(self.model.inputs)
        model, rows, N = self.model, self.rows, self.preview
        n, p, size = model.states, model.inputs, rows.D.shape[1]
        R, Q, C = control_weight(model, self.weights), plan.Q, model.C
        H = jnp.zeros((N, size, size)).at[:, -p:, -p:].set(2 * R)
        H = H.at[1:, :n, :n].set(2 * C.T @ Q @ C)
        h = jnp.zeros((N, size)).at[:, -p:].set(2 * R @ (load - plan.held))
        h = h.at[1:, :n].set(-2 * jnp.einsum("ma,jmk,jk->ja", C, Q, plan.y_d))
        A, B, z = _widened(model, rows.beside, x, memory)
        wide = size - p
        H_end = jnp.zeros((wide, wide)).at[:n, :n].set(2 * plan.H_end)
        h_end = jnp.zeros(wide).at[:n].set(2 * plan.g_end)
        c = jnp.broadcast_to(jnp.zeros(wide).at[:n].set(model.B @ load), (N, wide))
        shift = (rows.load @ load)[None]
        price = _price(model, H[:, :n, :n], R, plan.H_end, N)
        penalty = jnp.where(rows.soft, PRICE * price / rows.size, jnp.inf)
        lower, upper = jnp.asarray(rows.lower) - shift, jnp.asarray(rows.upper) - shift
        return StagedQP(A, B, c, z, H, h, H_end, h_end, jnp.asarray(rows.D), lower, upper, penalty)


def limit_rows(model: LinearPlant, limits: Limits, horizon: int) -> LimitRows:
    """Rows of all limits (`full_limits`), those of the controls first.

    Acceleration is limited from the sample itself on, as in `TrackingMPC`, by the last output.
    """
    A, B, C = (np.asarray(matrix, float) for matrix in (model.A, model.B, model.C))
    n, p, m, dt = len(A), B.shape[1], len(C), model.dt
    limited = {name for name, pair in limits._asdict().items() if np.isfinite(pair).any()}
    beside = "increment" in limited, "acceleration" in limited
    wide = n + p * beside[0] + m * beside[1]

    def row(state, control, last=None, output=None):
        rows = np.zeros((len(control), wide + p))
        rows[:, :n], rows[:, wide:] = state, control
        if last is not None:
            rows[:, n : n + p] = last
        if output is not None:
            rows[:, wide - m : wide] = output
        return rows

    nothing, one = np.zeros((p, n)), np.eye(p)
    rows = {"control": row(nothing, one)}
    if beside[0]:
        rows["increment"] = row(nothing, one, last=-one)
    rows |= {
        "state": row(A, B),
        "output": row(C @ A, C @ B),
        "speed": row(C @ (A - np.eye(n)) / dt, C @ B / dt),
    }
    if beside[1]:
        second = C @ (A - 2 * np.eye(n)) / dt**2
        rows["acceleration"] = row(second, C @ B / dt**2, output=np.eye(m) / dt**2)
    signals = limited_signals(model, predict(model, horizon))
    parts = [
        _limited(name, D, getattr(limits, name), signals.get(name), horizon)
        for name, D in rows.items()
        if name == "control" or name in limited
    ]
    D, lower, upper, soft, size = (
        np.concatenate(column, axis=axis)
        for column, axis in zip(zip(*parts, strict=True), (0, 1, 1, 0, 0), strict=True)
    )
    load = D[:, wide:].copy()
    load[: p * (1 + beside[0])] = 0.0  # a load is no part of the control that acts
    return LimitRows(D, load, lower, upper, soft, size, beside)


def _limited(name: str, D: np.ndarray, pair, signal, horizon: int):
    """(rows, lower, upper, soft, size) of a signal, infinite at stages that cannot change it."""
    lower, upper = (np.tile(bound, (horizon, 1)) for bound in pair)
    if signal is None:
        size, soft = np.ones(len(D)), np.zeros(len(D), bool)
        return D, lower, upper, soft, size
    reach = np.abs(signal[1]).max(axis=2)  # of every sample's rows (stages, rows)
    first = horizon - len(reach)  # of acceleration behind a delay: the first stage has none
    free = np.zeros((horizon, len(D)), bool)
    free[first:] = reach > NEGLIGIBLE * reach.max(initial=0.0)
    size = reach.max(axis=0, initial=0.0)
    soft = np.full(len(D), name in SOFT)
    return D, np.where(free, lower, -np.inf), np.where(free, upper, np.inf), soft, size


def _widened(model: LinearPlant, beside: tuple[bool, bool], x, memory: LimitedMemory):
    """A, B and the state with the last control and the last output beside it."""
    A, B, z = model.A, model.B, x
    n, p, m = model.states, model.inputs, model.axes
    if beside[0]:
        A = jnp.block([[A, jnp.zeros((n, p))], [jnp.zeros((p, n + p))]])
        B = jnp.concatenate([B, jnp.eye(p)])
        z = jnp.concatenate([z, memory.control])
    if beside[1]:
        wide = A.shape[0]
        A = jnp.block([[A, jnp.zeros((wide, m))], [model.C, jnp.zeros((m, wide - n + m))]])
        B = jnp.concatenate([B, jnp.zeros((m, p))])
        z = jnp.concatenate([z, memory.output])
    return A, B, z


def _price(model: LinearPlant, H, R, H_end, horizon: int):
    """Largest curvature that the first control of a horizon has: a price is measured by it."""
    reach = [model.B]
    for _ in range(horizon - 1):
        reach.append(model.A @ reach[-1])
    moved = jnp.stack(reach)  # states 1..N
    ahead = jnp.einsum("jap,jab,jbp->p", moved[:-1], H[1:], moved[:-1])
    end = 2 * jnp.einsum("ap,ab,bp->p", moved[-1], H_end, moved[-1])
    return jnp.max(2 * jnp.diag(R) + ahead + end)
