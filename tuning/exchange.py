"""Around a search: few frozen loops are exchanged for worse ones, idle weights are put back.

A search looks at few frozen loops; after it many are looked at.

Where one of them is worse than all that the search has seen, its window is probed as well, and the
search goes on from where it ended. Infinitely many limits are so kept by few (J. W. Blankenship,
J. E. Falk, J. Optimization Theory and Applications 19, 1976).

Weights may be without any effect, as a field of a controller that its step never reads. A search
may end anywhere along them: they are put back where they started.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour.analysis.sensitivity import probe_windows
from jcontour.linear.plant import ROUNDING
from jcontour.motion.references import Reference
from tuning.descents.descent import Descent
from tuning.loops import Looked, ProbedLoops
from tuning.objectives import COUNT_NOISE, LATE, LOOP_LIMITS, AtMost, Limits, no_limits
from tuning.parameters import Chart, Weights
from tuning.point import evaluate_point, looked_at
from tuning.problem import Problem
from tuning.tuner import Tuned

MANY = 64  # probes of each contour after a search: they cost as much as one more of its points
WORSE = np.log(1.01)  # a limit that is exceeded by less between the probes counts as kept
# radius of a loop where no margin is asked for: a ring has decayed after some 10,000 samples
STABLE = 0.9999


class Exchanged(NamedTuple):
    """A problem that looks at more loops."""

    problem: Problem  # with the windows of the loops that were worse
    added: int  # number of them
    unstable: bool  # whether one of them was unstable


def exchanged(
    problem: Problem, start: Weights, tuned: Tuned, few: int, many: int = MANY
) -> Exchanged | None:
    """The problem with the worst loop of every contour added to those that it looks at.

    A loop is worse where it is unstable, or exceeds the limits on loops by more than any that the
    search has seen. A problem that looks at no loops is given `few` for each contour, and a limit
    on their spectral radius, once one is unstable.

    Args:
        problem: that was tuned.
        start: its first weights.
        tuned: the result.
        few: probes of each contour that a search begins with.
        many: probes of each contour that are looked at now, a multiple of `few`.

    Returns:
        None where no loop is worse.

    Raises:
        ValueError: the loops of the problem are not probed ones, or `many` is no multiple of `few`.
    """
    if few < 1 or many % few:
        raise ValueError(f"many: needs a multiple of {few} probes, received {many}")
    probed = problem.loops
    if probed is None:
        probed = ProbedLoops.of(problem.plants, problem.references, few)
    if not isinstance(probed, ProbedLoops):
        raise ValueError(f"loops: only probed ones can be exchanged, received {probed}")
    windows = probe_windows(problem.references, many)
    z = np.asarray(Chart(problem.space, tuned.weights).coordinates())
    unstable, excess = _look(replace(problem, loops=probed), start, z, windows, few, many)
    seen = Looked(tuned.outcome.loops, tuned.outcome.late, tuned.outcome.count_noise)
    most = float(np.max(_excess(problem.limits, seen), initial=0.0))
    badness = np.where(unstable, np.inf, excess)
    worst = np.argmax(badness, axis=1)
    rows = [c * many + k for c, k in enumerate(worst) if badness[c, k] > most + WORSE]
    if not rows:
        return None
    worse = jax.tree.map(lambda leaf: leaf[np.array(rows)], windows)
    more = jax.tree.map(lambda *both: jnp.concatenate(both), probed.windows, worse)
    loops = eqx.tree_at(lambda one: one.windows, probed, more)
    extended = replace(problem, loops=loops, limits=_limits(problem))
    return Exchanged(extended, len(rows), bool(unstable.any()))


def _look(
    problem: Problem,
    start: Weights,
    z: Float[np.ndarray, " d"],
    windows: Reference,
    few: int,
    many: int,
) -> tuple[Bool[np.ndarray, "c {many}"], Float[np.ndarray, "c {many}"]]:
    """Whether each loop is unstable on a plant, and its largest excess of a limit.

    Loops are looked at in blocks of the shape with which a search begins: its program is compiled.
    """
    number = np.arange(windows.position.shape[0]).reshape(-1, many)
    unstable, excess = np.zeros(number.shape, bool), np.zeros(number.shape)
    for k in range(0, many, few):
        rows = number[:, k : k + few]
        block = jax.tree.map(lambda leaf, rows=rows: leaf[np.ravel(rows)], windows)
        one = eqx.tree_at(lambda problem: problem.loops.windows, problem, block)
        looked, _ = looked_at(one, start, z)
        assert looked.loops is not None
        lost = ~np.all(looked.loops.spectral_radius < 1 - ROUNDING, axis=1)
        unstable[:, k : k + few] = np.reshape(lost, rows.shape)
        excess[:, k : k + few] = np.reshape(_excess(problem.limits, looked), rows.shape)
    return unstable, excess


def _excess(limits: Limits, looked: Looked) -> Float[np.ndarray, " K"]:
    """Largest ln(value / limit) of every probe over the plants; -inf where nothing is limited."""
    if looked.loops is None:
        return np.zeros(0)
    largest = np.full(looked.loops.sensitivity.shape[0], -np.inf)
    if not isinstance(limits, AtMost):
        return largest
    for name, bound in zip(limits.names, np.asarray(limits.bounds), strict=True):
        values = {LATE: looked.late, COUNT_NOISE: looked.count_noise}.get(name)
        if name in LOOP_LIMITS:
            values = getattr(looked.loops, LOOP_LIMITS[name])
        if values is not None:
            largest = np.maximum(largest, np.log(np.max(values, axis=1) / bound))
    return largest


def _limits(problem: Problem) -> Limits:
    """Limits of the problem, and one on the spectral radius where it has looked at no loops."""
    limits = problem.limits
    if problem.loops is not None or not (limits is no_limits or isinstance(limits, AtMost)):
        return limits
    named = zip(limits.names, limits.bounds, strict=True) if isinstance(limits, AtMost) else ()
    known = {name: float(bound) for name, bound in named}
    before = limits.before if isinstance(limits, AtMost) else None
    return AtMost(before, **known, spectral_radius=STABLE)


def without_slope(descent: Descent | None) -> Bool[np.ndarray, " d"]:
    """Coordinates in which no error and no limit has a slope where a descent has come to.

    None of them where there is no descent.
    """
    if descent is None:
        return np.zeros(0, bool)
    model = descent.model
    return _flat(model.error_slopes, model.limit_slopes)


def put_back(
    problem: Problem, start: Weights, weights: Weights, flat: Bool[np.ndarray, " d"]
) -> tuple[Weights, Bool[np.ndarray, " d"]]:
    """Weights with those without any effect where they started, and which coordinates these are.

    They have no slope, neither at the start nor here, and putting them back changes no error and no
    limit.

    Args:
        problem: the tuning problem.
        start: where the search began.
        weights: where it ended.
        flat: coordinates that may be without effect; the others are not looked at.
    """
    none = np.zeros(flat.shape, bool)
    if not flat.any():
        return weights, none
    first = np.asarray(Chart(problem.space, start).coordinates())
    z = np.asarray(Chart(problem.space, weights).coordinates())
    begun, here = (evaluate_point(problem, start, there) for there in (first, z))
    for point in (begun, here):
        if not point.diverged:  # or its slopes mean nothing
            flat = flat & _flat(point.slopes.errors, point.slopes.limits)
    back = np.where(flat, first, z)
    there = evaluate_point(problem, start, back)
    same = np.array_equal(there.errors, here.errors) and np.array_equal(there.limits, here.limits)
    if not (flat.any() and same):
        return weights, none
    return Chart(problem.space, start).weights(jnp.asarray(back)), flat


def _flat(*slopes: Float[Array | np.ndarray, "... d"]) -> Bool[np.ndarray, " d"]:
    """Coordinates in which every slope is zero, to the last bit."""
    return np.all([np.all(np.reshape(one, (-1, one.shape[-1])) == 0, axis=0) for one in slopes], 0)
