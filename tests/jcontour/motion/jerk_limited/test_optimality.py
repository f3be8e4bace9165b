"""Cycle times against other methods: linear programs on fine grids."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import linprog

from jcontour.geometry import contours
from jcontour.geometry.contour import Contour
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.planning import jerk_limited

FEED = 0.1  # [m/s]
NODES = 300  # of the fine grid
ROUNDS = 100  # linear programs at most
REGION = 0.3  # of the rate's square, by which a round may change it


def derivatives(path: Contour):
    """First, second and third derivative at arc lengths [1, 1/m, 1/m^2]."""
    starts = jnp.asarray(path.start)

    @jax.jit
    def at(s):
        piece = jnp.clip(jnp.searchsorted(starts, s, side="right") - 1, 0, starts.size - 1)
        on = jax.tree.map(lambda rows: jnp.asarray(rows)[piece], path.pieces)
        along = s - starts[piece]
        velocity = on.jet(along)[1]
        bend, third = jax.jvp(
            lambda along: on.jet(along)[2] + 0.0 * velocity, (along,), (jnp.ones_like(along),)
        )
        return velocity, bend, third

    return at


def with_jerk(path: Contour, limits: AxisLimits) -> float:
    """Quickest time under all limits [s] on a fine grid, by linear programs in a row.

    The place s = L (10 q^3 - 15 q^4 + 6 q^5) is a motion in q from rest to rest. With w = (dq/dt)^2
    and P(q) the path, |P''' w + 3/2 P'' w' + 1/2 P' w''| <= J / sqrt(w) is the limit of the jerk.
    Differences stand for the derivatives of w. The tangent of the right side lies below it, so that
    every round stays within the limits; the duration is linearised in a region.
    """
    q = np.linspace(0.0, 1.0, NODES)
    step = q[1]
    linear, jerk = grid_conditions(path, limits, q)
    flat = np.ones(NODES)
    w = 0.5 * min(1 / np.max(linear @ flat), np.max(np.abs(jerk @ flat)) ** (-2 / 3)) * flat
    for _ in range(ROUNDS):
        tangent = -0.5 * w**-1.5
        falling = sparse.vstack([sparse.diags_array(tangent)] * (2 * path.axes))
        room = np.tile(w**-0.5 - tangent * w, 2 * path.axes)
        actual = linprog(
            tangent,
            sparse.vstack([linear, jerk - falling]),
            np.concatenate([np.ones(linear.shape[0]), room]),
            bounds=np.stack([(1 - REGION) * w, (1 + REGION) * w], axis=1),
        )
        assert actual.status == 0, actual.message
        before, w = duration(w, step), actual.x
        if before - duration(w, step) < 1e-6 * before:
            break
    return duration(w, step)


def grid_conditions(path: Contour, limits: AxisLimits, q: np.ndarray):
    """Rows (., NODES) on w: those kept below 1, and those kept below 1 / sqrt(w)."""
    powers = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]) * float(path.length)
    s, ds, dds, ddds = (np.polyval(np.polyder(powers, k), q)[:, None] for k in range(4))
    first, second, third = (np.asarray(d) for d in derivatives(path)(s[:, 0]))
    push = first * ds
    bend = second * ds**2 + first * dds
    whirl = third * ds**3 + 3 * second * ds * dds + first * ddds
    slope = difference([-0.5, 0.0, 0.5]) / q[1]
    curve = difference([1.0, -2.0, 1.0]) / q[1] ** 2
    fastest = np.maximum((np.abs(push) / limits.speed).max(axis=1), np.abs(ds[:, 0]) / FEED)
    linear, jerk = [sparse.diags_array(fastest**2)], []
    for k in range(path.axes):
        P, PP, PPP = (sparse.diags_array(d[:, k]) for d in (push, bend, whirl))
        faster = (PP + 0.5 * P @ slope) / limits.acceleration[k]
        sharper = (PPP + 1.5 * PP @ slope + 0.5 * P @ curve) / limits.jerk[k]
        linear += [faster, -faster]
        jerk += [sharper, -sharper]
    return sparse.vstack(linear), sparse.vstack(jerk)


def difference(weights) -> sparse.csr_array:
    """Central difference; none at both ends, where the path stands still in q."""
    inner = sparse.diags_array(
        [np.full(NODES - 2, each) for each in weights], offsets=[0, 1, 2], shape=(NODES - 2, NODES)
    )
    none = sparse.csr_array((1, NODES))
    return sparse.csr_array(sparse.vstack([none, inner, none]))


def duration(w: np.ndarray, step: float) -> float:
    rate = np.sqrt(w)
    return float(np.sum(2 * step / (rate[1:] + rate[:-1])))


def short_path(seed: int) -> tuple[Contour, AxisLimits]:
    """A curve of some millimetres, and limits that all act on it."""
    random = np.random.default_rng(seed)
    size = 10 ** random.uniform(-3, -1.7)
    acceleration = random.uniform(1.0, 4.0, 2)
    jerk = acceleration / random.uniform(0.01, 0.04)
    limits = AxisLimits.of(2, acceleration, jerk, random.uniform(0.05, 0.2, 2))
    kind = seed % 5
    if kind == 0:
        return contours.ellipse(size, size * random.uniform(0.3, 1.0)), limits
    if kind == 1:
        return contours.arc([size, 0.0], [0.0, 0.0], random.uniform(0.5, 6.0)), limits
    if kind == 2:
        return contours.lemniscate(size), limits
    if kind == 3:
        return contours.spline(random.uniform(0, size, (int(random.integers(3, 6)), 2))), limits
    return contours.line([0.0, 0.0], size * random.uniform(0.1, 1, 2)), limits


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 8])
def test_it_is_as_quick_as_on_a_fine_grid(seed):
    path, limits = short_path(seed)
    assert 0.98 < jerk_limited(path, FEED, limits).duration / with_jerk(path, limits) < 1.02
