"""Stability of the loop along a path: frozen loops, and the gain error and delay they bear.

A frozen loop is the closed loop linearised at one sample of its own run, the plan of that step held
for ever: z(k+1) = M z(k) + const, z the state of the plant and the memory of the controller. McNab
& Tsao, Theorem 1 and eq. 23, have M = A - B K at every state. Here M is the Jacobian of one step:
it covers observers, delays, limits and machines that change along the path. For a linear plant
under a linear controller it does not depend on the run. Host side.

A loop that is stable with 1, 2, ... and d more samples on its control has a delay margin of d
samples. One of them alone says little: a resonance that a short delay makes unstable may be stable
again under a longer one.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike, Float, Int

from jcontour.analysis.frozen_loops import (
    CutLoops,
    FrozenLoop,
    LinearLaw,
    LinearMachine,
    dominant,
    frozen_loop,
    real_outer,
    times,
)
from jcontour.controller import Controller, Plan
from jcontour.geometry.contours import line
from jcontour.linear.plant import spectral_radius
from jcontour.motion.references import Reference, along
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import check_kinds, check_run, follow, prepared

GAIN_SEARCH = 20.0  # factor up and down beyond which a gain margin counts as unlimited
DELAY_SEARCH = 10  # samples beyond which a delay margin is not followed
GAIN_RESOLUTION = 1e-3  # relative width to which a gain margin is bisected
SIDE_BY_SIDE = 16  # loops are cut by so many, or several times as many
PROBED_LOOPS = 48  # frozen loops that guide a search; all of them confirm it


class Margins(NamedTuple):
    """Margins that every frozen loop along a path survives."""

    spectral_radius: float  # the largest of all frozen loops; the loop is stable below 1
    # (p, 2) lower and upper factor on each control, alone, within which every loop stays stable
    gain: np.ndarray
    # (p, 2) sample whose frozen loop becomes unstable first when the gain leaves the interval; -1
    # if all do at once, or none does within `GAIN_SEARCH`
    gain_at: np.ndarray
    delay: int  # most whole samples of extra control delay; -1 when a loop is unstable without any
    # number of scored samples at which a control is saturated (by the controller or the plant) or
    # has zero gain, so that the loop is open. The other margins ignore these samples. If every
    # sample is open, there are no margins: they describe the open loops.
    saturated: int


def frozen_spectral_radius(plant: Plant, controller: Controller, direction: ArrayLike) -> float:
    """Spectral radius of the loop along a straight line: Theorem 1's check.

    Args:
        plant: the machine, behind `Encoders` for a controller that is fed positions.
        controller: its gains on the line must not depend on the speed.
        direction: (m,) of any length.

    Raises:
        ValueError: the direction is zero or not finite.
        TypeError: the arguments are swapped, or of another kind.
    """
    check_kinds("frozen_spectral_radius", plant=plant, controller=controller)
    along_path = np.asarray(direction, float)
    length = np.linalg.norm(along_path)
    if not (np.isfinite(length) and length > 0):
        raise ValueError(
            f"direction: needs a finite vector of non-zero length, received {direction}"
        )
    # 1e-3 m, or any other length: the reference goes on straight
    contour = line(np.zeros(along_path.size), 1e-3 * along_path / length)
    reference = along(contour, [0.0, 1e-3], plant.dt, controller.preview, at_rest=False)
    return float(frozen_spectral_radii(plant, controller, reference)[0])


def frozen_spectral_radii(
    plant: Plant, controller: Controller, reference: Reference
) -> Float[np.ndarray, " T"]:
    """Spectral radius of the frozen loop of every step along a reference.

    Raises:
        ValueError: as `simulate`.
    """
    loops = cut_loops(plant, controller, reference, np.arange(reference.steps))
    return spectral_radius(loops.closed())


def margins(plant: Plant, controller: Controller, reference: Reference) -> Margins:
    """Gain and delay margins of every frozen loop along a reference.

    >>> from jcontour import contours, references
    >>> from jcontour.controllers import ContouringLQ, LQWeights
    >>> from jcontour.plants import bridgeport
    >>> machine, path = bridgeport(), contours.circle(1e-3)
    >>> controller = ContouringLQ(machine, LQWeights(3.0, 5.0, 1e-6), preview=50)
    >>> reference = references.along(path, 1e-5 * np.arange(4), machine.dt, 50, at_rest=False)
    >>> limits = margins(machine, controller, reference)
    >>> limits.spectral_radius < 1, limits.gain.shape, limits.saturated
    (True, (2, 2), 0)

    Args:
        plant: any smooth one behind its sensors: quantisers and stick-slip have no slope.
        controller: the controller under test.
        reference: what is run; every scored step counts.

    Raises:
        ValueError: as `simulate`, or no step is scored.
        TypeError: the arguments are swapped, or of another kind.
    """
    check_kinds("margins", plant=plant, controller=controller, reference=reference)
    rows = np.flatnonzero(np.asarray(reference.mask)[: reference.steps])
    if rows.size == 0:
        raise ValueError("mask: margins are those of the scored samples, the reference has none")
    loops = cut_loops(plant, controller, reference, rows)
    closed = np.flatnonzero(loops.acting().all(axis=1))
    saturated = rows.size - closed.size
    if closed.size:
        loops, rows = loops.at(closed), rows[closed]
    nominal, inputs = spectral_radius(loops.closed()), loops.C.shape[1]
    largest = float(nominal.max())
    if largest >= 1:
        lost = np.full((inputs, 2), rows[np.argmax(nominal)])
        return Margins(largest, np.ones((inputs, 2)), lost, -1, saturated)
    limits = [[_gain_limit(loops, i, factor) for factor in (1 / 1.05, 1.05)] for i in range(inputs)]
    gain = np.array([[inside for inside, _ in pair] for pair in limits])
    lost = np.array([[-1 if row is None else rows[row] for _, row in pair] for pair in limits])
    delay = 0
    while delay < DELAY_SEARCH and spectral_radius(loops.late(delay + 1)).max() < 1:
        delay += 1
    return Margins(largest, gain, lost, delay, saturated)


def cut_loops(
    plant: Plant, controller: Controller, reference: Reference, rows: Int[np.ndarray, " R"]
) -> CutLoops:
    """Cut loops at some steps of the run of `simulate`, as NumPy arrays.

    Raises:
        ValueError: as `simulate`.
    """
    check_run(plant, controller, reference)
    plan = prepared(controller, reference)
    # so many that paths with a few loops more or less share one program
    several = np.resize(rows, -(-rows.size // SIDE_BY_SIDE) * SIDE_BY_SIDE)
    loops = _cut_loops(plant, controller, reference, plan, jax.device_put(several))
    return CutLoops(*(np.asarray(matrices)[: rows.size] for matrices in loops))


@eqx.filter_jit
def _cut_loops(
    plant: Plant, controller: Controller, reference: Reference, plan: Plan, rows
) -> CutLoops:
    run = follow(plant, controller, plan, reference)

    def cut(step):
        plan_k, state, memory = step
        return frozen_loop(plant, controller, plan_k, state, memory).cut()

    steps = jax.tree.map(lambda leaf: leaf[rows], (plan, run.state, run.memory))
    return jax.vmap(cut)(steps)


def _gain_limit(loops: CutLoops, index: int, factor: float) -> tuple[float, int | None]:
    """Factor on one control at which the first frozen loop loses stability, and that loop."""
    steps, _, inputs = loops.B.shape
    every = np.arange(steps)
    rows = np.unique(np.linspace(0, steps - 1, min(PROBED_LOOPS, steps)).astype(int))

    def radii(gain: float, rows) -> np.ndarray:
        gains = np.where(np.arange(inputs) == index, gain, 1.0)
        return spectral_radius(loops.at(rows).closed(gains))

    while True:
        inside, outside = _limit(lambda gain, rows=rows: radii(gain, rows).max() < 1, factor)
        lost = np.flatnonzero(radii(inside, every) >= 1)
        if lost.size == 0:
            beyond = np.zeros(steps) if outside is None else radii(outside, every)
            return inside, int(np.argmax(beyond)) if beyond.min() < 1 <= beyond.max() else None
        rows = np.union1d(rows, lost[:: max(1, lost.size // PROBED_LOOPS)])


def _limit(stable, factor: float) -> tuple[float, float | None]:
    """Last stable gain and first unstable one; None where the search ends before."""
    inside = 1.0
    while stable(inside * factor):
        inside *= factor
        if not 1 / GAIN_SEARCH < inside < GAIN_SEARCH:
            return inside, None
    outside = inside * factor
    while abs(outside / inside - 1) > GAIN_RESOLUTION:
        middle = np.sqrt(inside * outside)
        inside, outside = (middle, outside) if stable(middle) else (inside, middle)
    return inside, outside


def late_measures(loop: FrozenLoop, samples: int) -> tuple[Float[np.ndarray, "*loops"], FrozenLoop]:
    """Largest spectral radius of the loops with v(k) = u(k - d), d = 1 ... samples, and its slope.

    With left and right vectors of the largest eigenvalue, of x, w and the line u(k-1), ..., u(k-d),
    the derivative is that of Re(left' M right), see `frozen_loops.dominant`. A loop that is not
    finite has an infinite radius with slope 0.

    Args:
        loop: batched in front; plant and controller may have different batches that go together.
        samples: at least 1.

    Raises:
        ValueError: fewer samples.
    """
    if samples < 1:
        raise ValueError(f"samples: needs a delay of one at least, received {samples}")
    radius, slope = _late(loop, 1)
    for delay in range(2, samples + 1):
        other, other_slope = _late(loop, delay)
        larger = other > radius
        radius = np.where(larger, other, radius)
        slope = other_slope.only(larger, slope)
    return radius, slope


def delay_margins(loop: FrozenLoop, most: int) -> Int[np.ndarray, "*loops"]:
    """Most samples d such that every delay from 0 to d leaves the loop stable.

    -1 where the loop is unstable without one; larger margins than `most` are not followed.

    Args:
        loop: batched in front; plant and controller may have different batches that go together.
        most: at least 0.
    """
    cut = [np.asarray(matrices, float) for matrices in loop.cut()]
    batch = np.broadcast_shapes(*(matrices.shape[:-2] for matrices in cut))
    flat = [
        np.broadcast_to(one, (*batch, *one.shape[-2:])).reshape(-1, *one.shape[-2:]) for one in cut
    ]
    # loops of several probes are the same where the controller does not change along the path
    rows = np.concatenate([one.reshape(len(one), -1) for one in flat], axis=1)
    _, once, alike = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    loops = CutLoops(*flat).at(once)
    margin = np.where(spectral_radius(loops.closed()) < 1, 0, -1)
    for delay in range(1, most + 1):
        left = np.flatnonzero(margin == delay - 1)
        if left.size == 0:
            break
        margin[left[spectral_radius(loops.at(left).late(delay)) < 1]] = delay
    return margin[alike.ravel()].reshape(batch)


def _late(loop: FrozenLoop, samples: int) -> tuple[np.ndarray, FrozenLoop]:
    """Spectral radius with one delay, and its derivative."""
    M = np.asarray(loop.cut().late(samples), float)
    finite = np.asarray(np.isfinite(M).all(axis=(-2, -1)))
    eigen = dominant(np.where(finite[..., None, None], M, 0.0))
    kept = np.where(finite, 1.0, 0.0)[..., None]
    # of Re(left' M right): the plant hears the last of the line, the controller writes its first
    left, right = kept * eigen.left, kept * eigen.right
    (_, _, H), (_, E, _, D) = (
        [np.nan_to_num(np.asarray(matrix, float)) for matrix in part] for part in loop
    )
    n, c, p = H.shape[-1], E.shape[-2], D.shape[-2]
    x, w, heard = right[..., :n], right[..., n : n + c], right[..., n + c + (samples - 1) * p :]
    of_x, of_w, written = left[..., :n], left[..., n : n + c], left[..., n + c : n + c + p]
    y = times(H, x)
    of_y = times(np.swapaxes(E, -1, -2), of_w) + times(np.swapaxes(D, -1, -2), written)
    slope = FrozenLoop(
        LinearMachine(real_outer(of_x, x), real_outer(of_x, heard), real_outer(of_y, x)),
        LinearLaw(
            real_outer(of_w, w), real_outer(of_w, y), real_outer(written, w), real_outer(written, y)
        ),
    )
    return np.where(finite, eigen.radius, np.inf), slope
