"""A linear controller as a law that streams: what it needs ahead, its memory and its step.

With x the memory, y the measurement, r_j the reference j samples ahead:

    x  <- x + L (y - C x)                             correction, where there is an observer
    u   = f - F x - D y                               kept to its limit
    x  <- A x + B u + E y + sum_j W_j r_j             kept to limits of its own
The control f - F x is that of a receding horizon whose window is swept at every sample (`Window`),
or f = sum_j G_j r_j with stationary gains. Beside both may stand dry sign(r_{d+1} - r_d), behind a
limit of its slew rate; no other memory knows of it. Nothing belongs to one part. All
positions count from a base: the present reference where a law is the same everywhere, so that its
numbers stay small; the place of the start where a control is needed to stand; else the origin.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jcontour.analysis.frozen_loops import linear_law, unlimited
from jcontour.bounds.affine import NotAffine
from jcontour.bounds.disturbed_loop import check_linear_controller, check_planless
from jcontour.controller import Controller
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.controllers.lq.contouring_lq import ContouringLQ, RiccatiTerminal, control_weight
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    PredictorObserver,
    with_disturbance,
)
from jcontour.export.code_text import Precision
from jcontour.export.safe_limits import memory_limits
from jcontour.geometry.contours import polyline
from jcontour.linear.plant import operating_point, steady_motion
from jcontour.motion.references import Reference, along
from jcontour.plant import Plant
from jcontour.sensors import row
from jcontour.simulation.closed_loop import prepared

BEHIND = 8  # most samples that a law looks back: differences of third order need three
TAIL = 40  # samples beyond the look-ahead in which a response has to have ended
PUSHED = 20  # samples after which a control has moved what it drives
SMALL = 2.0**-20  # [m] of a motion that friction dominates
ENDED = 1e-11  # of a response's largest number: it has ended
BALANCED: dict[Precision, float] = {"double": 1e-13, "single": 1e-7}  # of the largest number

Base = Literal["reference", "start", "origin"]
Observer = FilterObserver | PredictorObserver | OffsetFreeObserver
Matrix = Float[np.ndarray, "_ _"]
Vector = Float[np.ndarray, "_"]


@dataclass(frozen=True)
class Window:
    """Receding-horizon problem whose cost is swept backwards at every sample.

        sum_j stage_j (total |e_j|^2 - beta (t_j' e_j)^2 / t_j' t_j) + w' diag(weight) w,
    u = inputs w. The weight R = (inputs^-1)' diag(weight) inputs^-1 takes the controls one at a
    time, so that every stage is a few updates of rank one.
    """

    # A, B, C: of the model, B for the controls w
    A: Matrix
    B: Matrix
    C: Matrix
    inputs: Matrix  # u = inputs w
    weight: Vector  # of every w
    total: float  # alpha + beta, of the error of a sample [1/m^2]
    beta: float  # of the contour error [1/m^2]
    stage: Vector  # profile over the samples ahead
    # terminal cost where there is one beside that of the last sample, with the maps of steady
    # motion `at` and `per` that give its target
    H: Matrix | None = None
    at: Matrix | None = None
    per: Matrix | None = None


@dataclass(frozen=True, kw_only=True)
class StreamingLaw:
    """A law of one machine, for any part.

    Attributes:
        dt: sample period [s].
        names: of the entries of the memory.
        preview: samples ahead that it needs.
        behind: samples before the present one that it remembers.
        L, C: of the correction; None without an observer.
        A, B, E: of the next memory, as F and D None where there is no such term.
        F, D: gains; F has the columns of the load alone where a window is swept.
        window: swept at every sample; None where gains are stationary.
        G, W: gains of the references from `behind` samples back to `preview` ahead.
        dry: control by the direction of every axis, against its friction.
        ahead: samples d ahead at which that is taken.
        turning: samples in which it turns from one direction to the other.
        integral: 1 for entries of the memory that are held where the reference has stood for
            `hold_after` samples, 0 for the others; None where none is.
        limit: of every control, +-; infinite where there is none.
        kept: limit of every entry of the memory, +-.
        exact: whether that is all that the controller's own limits do to its memory.
        still: memory at rest per position, and `entry` per increment of a sample.
        seen: measurement at rest per position, and `places` the positions in a measurement.
        hold: control per position that stands there.
        drives: the control behind each measurement, a one in its row.
        dead_time: samples until a control shows in a measurement.
        base: what positions count from.
    """

    dt: float
    preview: int
    limit: Vector
    still: Matrix
    entry: Matrix
    seen: Matrix
    places: Matrix
    hold: Matrix
    names: tuple[str, ...] = ()
    behind: int = 0
    L: Matrix | None = None
    C: Matrix | None = None
    A: Matrix | None = None
    B: Matrix | None = None
    E: Matrix | None = None
    F: Matrix | None = None
    D: Matrix | None = None
    window: Window | None = None
    G: Float[np.ndarray, "window p m"] | None = None
    W: Float[np.ndarray, "window n m"] | None = None
    dry: Matrix | None = None
    ahead: int = 0
    turning: int = 1
    integral: Vector | None = None
    hold_after: int = 0
    kept: Vector = field(default_factory=lambda: np.zeros(0))
    exact: bool = True
    drives: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    dead_time: int = 1
    base: Base = "origin"

    @property
    def slew(self) -> Vector | None:
        """Largest change of the control against friction in a sample; None without one."""
        return None if self.dry is None else 2 / self.turning * np.abs(self.dry).sum(axis=1)

    @property
    def states(self) -> int:
        """Numbers n that are remembered."""
        return len(self.names)

    @property
    def measured(self) -> int:
        """Numbers q in a measurement."""
        return self.seen.shape[0]

    @property
    def axes(self) -> int:
        """Axes m."""
        return self.seen.shape[1]

    @property
    def inputs(self) -> int:
        """Controls p."""
        return self.hold.shape[0]

    @cached_property
    def points(self) -> int:
        """Reference points that it is given: N_p + 1, and one for a feed hold between samples."""
        return self.preview + 2


def streaming_law(
    controller: Controller,
    machine: Plant,
    places: Matrix,
    limit: Vector,
    precision: Precision = "double",
) -> StreamingLaw:
    """Law of a controller.

    Args:
        controller: as `simulate` takes it.
        machine: nominal plant behind its sensors.
        places: positions of the axes in a measurement (m, q).
        limit: of the machine's controls, +-.
        precision: of the code; in single precision positions that count from far away lose digits.

    Raises:
        NotAffine: the controller is not linear, its gains change along the path otherwise than by
            the window of `ContouringLQ`, or it has no finite look-ahead; the message says which.
    """
    check_planless(controller)
    if isinstance(controller, FrictionFeedforward):
        law = streaming_law(controller.controller, machine, places, limit, precision)
        dry = np.diag(np.broadcast_to(np.asarray(controller.coulomb, float), law.axes))
        memory = controller.initial_memory(_standstill(controller, machine, law.axes))
        none, ones = (jax.tree.map(like, memory) for like in (jnp.zeros_like, jnp.ones_like))
        integral = 1.0 - _numbers(controller.with_integrals_held(none, ones, True))
        held = _some(integral) if controller.hold_after else None
        return replace(
            law,
            dry=dry,
            ahead=controller.ahead,
            turning=controller.turning,
            preview=controller.preview,
            integral=held,
            hold_after=controller.hold_after,
        )
    line = _standstill(controller, machine, places.shape[0])
    standing = machine.measure(machine.initial_state(line.position[0], line.start_increment))
    units = jnp.eye(places.shape[0])
    still = [row(machine.measure(machine.initial_state(one, 0.0 * one))) for one in units]
    seen = np.stack(still, axis=1)
    inner, known = controller, seen
    if isinstance(controller, Observer):  # the estimate is what the inner controller measures
        inner, standing = controller.controller, jnp.zeros(controller.model.states)
        known = np.asarray(steady_motion(controller.model).Sy, float)
    if type(inner) is ContouringLQ:
        law = _swept(inner, known, places)
    else:
        law = _stationary(inner, line, standing, known, places)
    if isinstance(controller, Observer):
        law = replace(_observed(controller, law), seen=seen)
    else:
        law = replace(law, limit=np.broadcast_to(np.asarray(limit, float), law.inputs))
    drives, dead_time = _drives(machine, line, law.inputs)
    law = replace(law, drives=drives, dead_time=dead_time)
    return replace(law, base=_base(law, BALANCED[precision]))


def _standstill(controller: Controller, machine: Plant, axes: int) -> Reference:
    """At the origin on a straight line, long enough for every response to end."""
    ahead = max(controller.preview, 1)
    path = polyline(np.stack([np.zeros(axes), np.ones(axes)]))
    arc = np.linspace(0.0, 1e-3, 2 * (ahead + BEHIND + TAIL))
    moving = along(path, arc, machine.dt, ahead, at_rest=True)
    return replace(moving, position=jnp.zeros_like(moving.position))


def _drives(machine: Plant, line: Reference, inputs: int) -> tuple[Matrix, int]:
    """Control that moves each measurement most when it pushes, and the longest dead time."""
    responses = []
    for control in np.eye(inputs):
        state = machine.initial_state(line.position[0], line.start_increment)
        rows = [row(machine.measure(state))]
        for _ in range(PUSHED):
            state = machine.step(state, jnp.asarray(control))
            rows.append(row(machine.measure(state)))
        responses.append(np.abs(np.asarray(rows[1:]) - np.asarray(rows[0])))
    response = np.stack(responses, axis=2)  # (sample, measured, control)
    last = response[-1]
    drives = np.eye(inputs)[last.argmax(axis=1)] * (last.max(axis=1) > 0.0)[:, None]
    moved = (response > ENDED * last.max()).any(axis=2)
    return drives, int(moved.argmax(axis=0).max()) + 1


def _swept(inner: ContouringLQ, seen: Matrix, places: Matrix) -> StreamingLaw:
    """Law without a memory: the measurement is the model's state."""
    model, weights, N = inner.model, inner.weights, inner.preview
    A, B, C = (np.asarray(one, float) for one in (model.A, model.B, model.C))
    factor = np.linalg.cholesky(np.asarray(control_weight(model, weights), float))
    inputs = np.linalg.inv(factor / np.diag(factor)).T
    stage = np.ones(N) if weights.stage is None else np.asarray(weights.stage, float)
    window = Window(
        A=A,
        B=B @ inputs,
        C=C,
        inputs=inputs,
        weight=np.diag(factor) ** 2,
        total=float(weights.alpha + weights.beta),
        beta=float(weights.beta),
        stage=stage,
    )
    if isinstance(inner.terminal, RiccatiTerminal):
        motion = inner.terminal.motion or steady_motion(model)
        window = replace(
            window,
            H=stage[-1] * np.asarray(inner.terminal.solution(model, weights), float),
            at=np.asarray(motion.Sy, float),
            per=np.asarray(motion.Sv, float),
        )
    points = [operating_point(model, jnp.asarray(one)) for one in np.eye(len(C))]
    return StreamingLaw(
        dt=model.dt,
        preview=N,
        limit=np.full(B.shape[1], np.inf),
        still=np.zeros((0, len(C))),
        entry=np.zeros((0, len(C))),
        seen=seen,
        places=places,
        hold=np.stack([np.asarray(one.control, float) for one in points], axis=1),
        window=window,
    )


def _stationary(
    controller: Controller, line: Reference, at_rest: Any, seen: Matrix, places: Matrix
) -> StreamingLaw:
    """Law with the memory of the controller and a filter of the references."""
    name, axes, free = type(controller).__name__, places.shape[0], unlimited(controller)
    preview = line.preview
    plan = prepared(controller, line)
    memory = controller.initial_memory(line)
    rows = jax.tree.map(lambda leaf: leaf[0], plan)
    check_linear_controller(free, rows, memory, at_rest)
    steps = _steps(free, plan, memory, at_rest)
    for words, matrices in (("memory", steps.A), ("measurement", steps.E)):
        if np.any(matrices != matrices[0]):
            raise NotAffine(f"{name}: what it makes of its {words} changes along the path")
    if np.any(steps.F != steps.F[0]) or np.any(steps.D != steps.D[0]):
        raise NotAffine(f"{name}: its gains change along the path, and no window gives them")
    middle = BEHIND + TAIL // 2 + preview

    def moved(sample: int, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        changes = []
        for one in size * np.eye(axes):
            position = line.position.at[sample].set(one)
            there = prepared(controller, replace(line, position=position))
            after = _steps(free, there, memory, at_rest)
            changes.append((after.f - steps.f, after.w - steps.w))
        f, w = (np.stack(rows, axis=-1) for rows in zip(*changes, strict=True))
        return f, w

    once, w = moved(middle)
    twice, again = moved(middle, 2.0)
    f = twice - once  # without what only the direction of the motion makes
    dry = moved(middle, SMALL)[0][middle - 1] - SMALL * f[middle - 1]
    turned = once - f
    turned[[middle - 1, middle]] -= np.stack([dry, -dry])
    largest = max(np.abs(f).max(initial=0.0), 1e-300)
    if np.any(np.abs(turned) > ENDED * largest) or np.any(
        np.abs(again - 2.0 * w) > ENDED * largest
    ):
        raise NotAffine(f"{name}: what it feeds forward is not linear in the reference")
    window = np.arange(middle + BEHIND, middle - preview - 1, -1)  # of r_-b .. r_N
    outside = np.delete(np.concatenate([f, w], axis=1), window, axis=0)
    if np.any(np.abs(outside) > ENDED * largest):
        raise NotAffine(f"{name}: it has no finite look-ahead, its plan needs the whole path")
    G, W = f[window], w[window]
    used = [k for k in range(BEHIND) if np.any(G[k]) or np.any(W[k])]
    skipped = used[0] if used else BEHIND
    unit = [replace(line, position=line.position.at[0].set(one)) for one in np.eye(axes)]
    start = _numbers(controller.initial_memory(line))
    still = [_numbers(controller.initial_memory(one)) - start for one in unit]
    entering = [replace(line, start_increment=jnp.asarray(one)) for one in np.eye(axes)]
    entry = [_numbers(controller.initial_memory(one)) - start for one in entering]
    n, p = start.size, f.shape[1]
    origin = moved(0)[0][-1]  # what the place of the start does to a sample far behind it
    stood = G.sum(axis=0) - steps.F[0] @ np.stack(still, axis=1) - steps.D[0] @ seen
    hold = origin + stood if np.any(origin) else np.zeros((p, axes))
    kept, exact = memory_limits(controller, rows, memory, at_rest)
    return StreamingLaw(
        dt=line.dt,
        names=tuple(f"memory {k + 1}" for k in range(n)),
        preview=preview,
        behind=BEHIND - skipped,
        A=_some(steps.A[0]),
        E=_some(steps.E[0]),
        F=_some(steps.F[0]),
        D=_some(steps.D[0]),
        G=G[skipped:],
        W=_some(W[skipped:]),
        dry=_some(np.where(np.abs(dry) > ENDED * largest, dry, 0.0)),
        limit=np.full(p, np.inf),
        kept=np.full(n, np.inf) if kept is None else kept,
        exact=exact,
        still=np.stack(still, axis=1),
        entry=np.stack(entry, axis=1),
        seen=seen,
        places=places,
        hold=hold,
    )


def _observed(controller: Observer, law: StreamingLaw) -> StreamingLaw:
    """The law fed an estimate; the predictor's correction comes after its control."""
    if law.states:
        raise NotAffine(
            f"{type(controller).__name__}: the controller behind it has a memory of its own"
        )
    model, L = controller.model, np.asarray(controller.gain, float)
    measured = model.C if controller.measured is None else controller.measured
    A, B, C = (np.asarray(one, float) for one in (model.A, model.B, measured))
    n, p = B.shape
    names = [f"state {k + 1}" for k in range(n)]
    motion, F = steady_motion(model), law.D
    still, entry = (np.asarray(one, float) for one in (motion.Sy, motion.Sv))
    limit = np.full(p, np.inf)
    if isinstance(controller, OffsetFreeObserver):
        names += [f"load on control {k + 1}" for k in range(p)]
        A, C = (np.asarray(part, float) for part in with_disturbance(model, jnp.asarray(C)))
        B = np.concatenate([B, np.zeros((p, p))])
        F = np.eye(p) if F is None else np.concatenate([F, np.eye(p)], axis=1)
        still, entry = (np.concatenate([one, np.zeros((p, len(one[0])))]) for one in (still, entry))
        limit = np.broadcast_to(np.asarray(controller.limit, float), p)
    if law.window is not None and F is not None:
        F = np.concatenate([np.zeros((p, n)), F], axis=1)
    E = None
    if isinstance(controller, PredictorObserver):
        A, E, L, C = A - A @ L @ C, A @ L, None, None
    return replace(
        law,
        names=tuple(names),
        L=L,
        C=C,
        A=A,
        B=B,
        E=E,
        F=F,
        D=None,
        limit=limit,
        kept=np.full(len(names), np.inf),
        still=still,
        entry=entry,
    )


class _Steps(eqx.Module):
    """A controller's step at every sample: A x + E y + w, and f - F x - D y."""

    A: Any
    E: Any
    F: Any
    D: Any
    f: Any
    w: Any


def _steps(controller: Controller, plan: Any, memory: Any, measurement: Any) -> _Steps:
    """Jacobians of the step in memory and measurement at every sample, and its values at zero."""
    jacobians = _at_zero(controller, plan, memory, measurement)
    return jax.tree.map(lambda one: np.asarray(one, float), jacobians)


@eqx.filter_jit
def _at_zero(controller: Controller, plan: Any, memory: Any, measurement: Any) -> _Steps:
    def zero(tree):
        moving, fixed = eqx.partition(tree, eqx.is_inexact_array)
        return eqx.combine(jax.tree.map(jnp.zeros_like, moving), fixed)

    def step(plan):
        x, y = zero(memory), zero(measurement)
        law, _ = linear_law(controller, plan, x, y)
        after, control = controller.step(x, plan, y)
        return _Steps(law.W, law.E, -law.K, -law.D, control, _flat(after))

    return jax.vmap(step)(plan)


def _flat(memory: Any) -> Array:
    return ravel_pytree(eqx.filter(memory, eqx.is_inexact_array))[0]


def _numbers(memory: Any) -> Float[np.ndarray, " n"]:
    return np.asarray(_flat(memory), float)


def _some(matrix: np.ndarray) -> np.ndarray | None:
    """The matrix; None where it has no entry but zero."""
    return matrix if np.any(matrix) else None


def _base(law: StreamingLaw, rounding: float) -> Base:
    """What positions count from: see the module."""
    stands = np.max(np.abs(law.hold), initial=0.0) > 0.0
    # rest at one place is rest at any other, up to rounding, where all pairs agree
    S, M, U, m = law.still, law.seen, law.hold, law.axes
    pairs = []
    x = S if law.states else M
    if law.states:
        after = np.zeros_like(S)
        for matrix, signal in ((law.A, S), (law.B, U), (law.E, M)):
            if matrix is not None:
                after = after + matrix @ signal
        if law.W is not None:
            after = after + law.W.sum(axis=0)
        pairs.append((after, S))
    if law.C is not None:
        pairs.append((law.C @ S, M))
    if law.window is not None:
        X = x[: len(law.window.A)]
        B = law.window.B @ np.linalg.inv(law.window.inputs)
        pairs += [(law.window.A @ X + B @ U, X), (law.window.C @ X, np.eye(m))]
        if law.window.at is not None:
            pairs.append((law.window.at, X))
    else:
        G = np.zeros_like(U) if law.G is None else law.G.sum(axis=0)
        back = np.zeros_like(U)
        for matrix, signal in ((law.F, S), (law.D, M)):
            if matrix is not None:
                back = back + matrix @ signal
        pairs.append((G - back, U if np.any(U) else np.zeros_like(U)))
    moved = np.isfinite(law.kept) & np.any(S != 0.0, axis=1) if law.states else np.zeros(0, bool)
    if not moved.any() and all(
        np.abs(one - other).max(initial=0.0)
        <= rounding * max(1.0, np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0))
        for one, other in pairs
    ):
        return "start" if stands else "reference"
    if stands:
        raise NotAffine("its control at rest is not that of the place where a run begins")
    return "origin"
