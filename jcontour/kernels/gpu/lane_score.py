"""A closed loop scored on a GPU: outputs and controls are scored where they lie, without a rollout.

The kernel leaves signals with the batch behind time, and there they are scored, all runs of one
reference together: turning them round for a `vmap` outside would cost more than the loop itself.
The derivative reaches the plan and the first state; where the plant or the reference moves, it is
that of the scan.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from jcontour.kernels.gpu.lanes import Batch, Operand, batch_last, dense, for_every, in_pieces
from jcontour.kernels.gpu.loop_lanes import cotangents, runs
from jcontour.linear.plant import Pattern


class LaneScore(NamedTuple):
    """Numbers of runs, flags among them, from their signals and their reference, in two ways.

    Attributes:
        readable: outputs (T, *runs, m), controls (T, *runs, p), reference -> numbers (*runs).
        lanes: operands y (m, T), u (p, T) and a reference of operands -> the same numbers in a
            list, as operands, by a kernel; None where there is none.
    """

    readable: Callable[[Array, Array, Any], Any]
    lanes: Callable[[Operand, Operand, Any], list[Operand]] | None = None


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def lane_score(pattern: Pattern, score: LaneScore, A, B, C, F, f, start, reference) -> Any:
    """Score (y, u, reference) of x(k+1) = A x + B u, u = f - F x, y = C x from x(0) = `start`.

    Its results are numbers of A's type.
    """
    return _run(pattern, score, False, A, B, C, F, f, start, reference)[0]


def _run(pattern: Pattern, score: LaneScore, keep: bool, A, B, C, F, f, start, reference):
    """Score, and the signals y, u, x that its derivative needs."""
    samples, tree = jax.tree.flatten(reference)
    output = jnp.zeros((f.shape[0], C.shape[0]), A.dtype)
    shapes = jax.eval_shape(partial(_scored, score), output, f, reference)

    def of_reference(y, u, *samples):
        found = _scored(score, _time_first(y), _time_first(u), tree.unflatten(samples))
        return jax.tree.leaves(found)

    def whole(*operands):
        loop, samples, batch = operands[:6], operands[6:], Batch.of(operands)
        signals = [Operand(signal, Batch.of(loop).together) for signal in runs(pattern, loop, keep)]
        if score.lanes is None:
            found = for_every(_touched(samples), of_reference, (*signals[:2], *samples))
        else:
            numbers = score.lanes(*signals[:2], tree.unflatten(samples))
            found = [number.over(batch).array for number in numbers]
        return [*found, *(signal.over(batch).array for signal in signals if keep)]

    found = batch_last(_cut(F, whole))(A, B, C, *_time_last(F, f), start, *samples)
    count = len(jax.tree.leaves(shapes))
    return jax.tree.unflatten(jax.tree.structure(shapes), found[:count]), found[count:]


def _fwd(pattern: Pattern, score: LaneScore, *arguments):
    values = jax.tree.map(lambda leaf: leaf.value, arguments)
    if any(leaf.perturbed for leaf in jax.tree.leaves((arguments[:3], arguments[6]))):
        return lane_score(pattern, score, *values), (values, None)
    numbers, signals = _run(pattern, score, True, *values)
    return numbers, (values, signals)


def _bwd(pattern: Pattern, score: LaneScore, kept, numbers_bar):
    values, signals = kept

    def symbolic(bar):
        return isinstance(bar, SymbolicZero)

    numbers_bar = jax.tree.map(dense, numbers_bar, is_leaf=symbolic)
    if signals is None:
        return jax.vjp(partial(scanned_score, score), *values)[1](numbers_bar)
    A, B, C, F, f, _, reference = values
    samples, tree = jax.tree.flatten(reference)

    def of_reference(y, u, *rest):
        def numbers(y, u):
            given = tree.unflatten(rest[: len(samples)])
            return jax.tree.leaves(_scored(score, _time_first(y), _time_first(u), given))

        return jax.vjp(numbers, y, u)[1](list(rest[len(samples) :]))

    def whole(*operands):
        A, B, C, F, x, *scored = operands
        batch, samples_end = Batch.of(scored), 2 + len(samples)
        y, u, *bars = (operand.over(batch) for operand in (*scored[:2], *scored[samples_end:]))
        given = scored[2:samples_end]
        found = for_every(_touched(given), of_reference, (y, u, *given, *bars))
        signal_bars = (Operand(bar, batch.together) for bar in found)
        return cotangents(pattern, (A, B, C, F, x, *signal_bars))

    y, u, x = signals
    operands = A, B, C, _time_last(F, f)[0], x, y, u, *samples, *jax.tree.leaves(numbers_bar)
    F_bar, f_bar, start_bar = batch_last(_cut(F, whole))(*operands)
    return None, None, None, jnp.transpose(F_bar, (2, 0, 1)), f_bar.T, start_bar, None


lane_score.defvjp(_fwd, _bwd, symbolic_zeros=True)


def scanned_score(score: LaneScore, A, B, C, F, f, start, reference):
    """Score of the same loop by a scan, as the equations say it."""

    def step(x, plan):
        u = plan[1] - plan[0] @ x
        return A @ x + B @ u, (C @ x, u)

    return _scored(score, *jax.lax.scan(step, start, (F, f))[1], reference)


def _scored(score: LaneScore, y, u, reference):
    """Score with flags as numbers, so that all of it has a cotangent."""
    return jax.tree.map(lambda number: number.astype(y.dtype), score.readable(y, u, reference))


def _cut(F, function: Callable) -> Callable:
    return lambda *operands: in_pieces(function, operands, F.size)


def _touched(samples) -> set[int]:
    """Batch axes along which the reference differs."""
    return set(Batch.of(samples).together)


def _time_first(signal):
    return jnp.moveaxis(signal, 0, -1)


def _time_last(F, f):
    return jnp.transpose(F, (1, 2, 0)), f.T
