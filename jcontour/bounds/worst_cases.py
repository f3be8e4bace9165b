"""A certificate as a number that weights can make small, and its derivative.

With the frame (n, t) at the point of the path nearest to the undisturbed y, and nu, tau the peak
bounds of the deviation along n and t:

    v = max over k and s in {-1, 0, 1} of  nu(k) + dist(y(k) + s tau(k) t(k), path)
That is the bound of `certificates` but for what lies between the three places, and for the sum:
there nu and the part of the distance along n are added first, the part along t at right angles.
Beside a line both are the same; on a circle v was larger by 5e-7 of it. On one axis it is |y - y_d|
and the peak bound of y.

    dv/dtheta = d/dtheta of the same under w*,   k*, s* and the attacks w* as found at theta
Sample and attacks maximise v, so that they may be held fixed (envelope theorem). Where several are
worst, it is an element of the generalised gradient.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour.bounds.attacks import Attack, worst_attack
from jcontour.bounds.distance import Frames, frames_along
from jcontour.bounds.disturbed_loop import Box, DisturbedLoop
from jcontour.bounds.peak_bounds import peak_bounds
from jcontour.controller import Controller, Plan
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import follow
from jcontour.simulation.metrics import SEARCH_REACH

SIDES = np.array([-1.0, 0.0, 1.0])
AT_FOOT = 1e-6  # cosine between error and tangent below which the nearest point is no corner


class PeakValues(NamedTuple):
    """Largest error and control that the box allows.

    Attributes:
        error: v [m].
        control_use: largest |u_i| over its limit; zero where no control has one.
    """

    error: Float[ArrayLike, "*runs"]
    control_use: Float[ArrayLike, "*runs"]


class WorstCase(NamedTuple):
    """Sample and attacks that make a loop worst; batches of them go together.

    Attributes:
        sample: k*.
        side: s*.
        normals: of the path at k*.
        error: attacks along every normal, and along the tangent at last.
        control: attack on the control that uses most of its limit.
        control_sample: when it does.
        control_input: which one it is.
    """

    sample: Int[ArrayLike, "*runs"]
    side: Float[ArrayLike, "*runs"]
    normals: Float[ArrayLike, "*runs r m"]
    error: Attack
    control: Attack
    control_sample: Int[ArrayLike, "*runs"]
    control_input: Int[ArrayLike, "*runs"]


def worst_case(
    loop: DisturbedLoop,
    reference: Reference,
    box: Box,
    limit: Float[np.ndarray, " p"],
    window: tuple[int, int] | None = None,
) -> tuple[PeakValues, WorstCase]:
    """Largest error of all scored samples and largest control of the run, and what makes them.

    Args:
        loop: along the reference.
        reference: with the true geometry.
        box: of force and error of the measurement.
        limit: of the controls; infinite where there is none.
        window: samples a..b-1 that count; all when not given.

    Raises:
        ValueError: no sample counts, or the undisturbed run leaves its contour.
    """
    counts = _counting(reference, window)
    frames = frames_along(reference, loop.output)
    rows = frames.basis @ np.asarray(loop.C)
    spread, controls = np.split(_peaks(loop, rows, box), [rows.shape[1]], axis=1)
    errors = _errors(reference, np.asarray(loop.output), frames, spread)
    k, side = _largest(errors, counts)
    uses = (np.abs(np.asarray(loop.control)) + controls) / limit
    at, i = _largest(uses, _running(reference))
    attacks = [worst_attack(loop, row, k, box, 1.0) for row in rows[k]]
    worst = WorstCase(
        np.asarray(k),
        SIDES[side],
        frames.normals[k],
        jax.tree.map(lambda *leaves: np.stack(leaves), *attacks),
        _control_attack(loop, at, i, box),
        np.asarray(at),
        np.asarray(i),
    )
    return PeakValues(errors[k, side], uses[at, i]), worst


def _counting(reference: Reference, window: tuple[int, int] | None) -> np.ndarray:
    """Which samples count (T,)."""
    T = reference.steps
    first, last = (0, T) if window is None else window
    counts = np.asarray(reference.mask)[:T] & (np.arange(T) >= first) & (np.arange(T) < last)
    if not counts.any():
        raise ValueError("window: no scored sample is left")
    return counts


def _running(reference: Reference) -> np.ndarray:
    """Samples up to the last scored one (T,): a control counts while the run begins as well."""
    last = np.flatnonzero(np.asarray(reference.mask)[: reference.steps])[-1]
    return np.arange(reference.steps) <= last


def _largest(values: np.ndarray, counts: np.ndarray) -> tuple[int, int]:
    found = np.argmax(np.where(counts[:, None], values, -np.inf))
    row, column = np.unravel_index(found, values.shape)
    return int(row), int(column)


def _peaks(loop: DisturbedLoop, rows: np.ndarray, box: Box) -> np.ndarray:
    """Largest deviations of the tool along the rows, and of the controls (T, r + p)."""
    T, r = rows.shape[:2]
    p, q = loop.D.shape[1:]
    direct = np.zeros((T, r + p, p + q))
    direct[:, r:, p:] = loop.D
    both = np.concatenate([rows, loop.K], axis=1)
    return peak_bounds(loop, both, box.size, direct).bound


def _control_attack(loop: DisturbedLoop, sample: int, channel: int, box: Box) -> Attack:
    """Attack on a control; the measurement of the sample itself acts on it at once."""
    sign = -1.0 if loop.control[sample, channel] < 0 else 1.0
    attack = worst_attack(loop, loop.K[sample, channel], sample, box, sign)
    attack.noise[sample] = sign * np.sign(loop.D[sample, channel]) * box.noise
    return attack


def _errors(
    reference: Reference, output: np.ndarray, frames: Frames, spread: np.ndarray
) -> Float[np.ndarray, "T s"]:
    """v at every sample and place."""
    if output.shape[1] == 1:
        return frames.lag[:, None] + spread
    across = np.linalg.norm(spread[:, :-1], axis=1)
    moved = (SIDES * spread[:, -1:])[..., None] * frames.tangent[:, None]
    return across[:, None] + np.asarray(_distances(reference, output[:, None] + moved))


@jax.jit
def _distances(reference: Reference, points: Float[ArrayLike, "T s m"]) -> Float[Array, "T s"]:
    """Distances of points from the path, searched around every sample's own place."""
    places = reference.arc[: reference.steps], reference.position[: reference.steps]
    at_place = jax.vmap(_distance, (None, 0, None, None))
    return jax.vmap(at_place, (None, 0, 0, 0))(reference, jnp.asarray(points), *places)


def attacked_peaks(
    plant: Plant,
    controller: Controller,
    plan: Plan,
    reference: Reference,
    worst: WorstCase,
    limit: Float[ArrayLike, " p"],
) -> PeakValues:
    """Error and use of the control under the attacks of a worst case; traceable.

    For the loop of the worst case they are the values found with it, and their derivatives those of
    the bounds.

    Args:
        plant: without limits, see `analysis.frozen_loops.unlimited`.
        controller: likewise.
        plan: of the controller for the reference.
        reference: of the run.
        worst: of this loop, or of one near it.
        limit: of the controls, as for `worst_case`.
    """
    still = jax.tree.map(lambda leaf: jnp.zeros_like(leaf)[None], worst.control)
    attacks = jax.tree.map(
        lambda none, error, control: jnp.concatenate([none, error, control[None]]),
        still,
        worst.error,
        worst.control,
    )

    def run(attack: Attack):
        followed = follow(attack.on(plant), controller, plan, reference)
        return followed.output[worst.sample], followed.control[worst.control_sample]

    outputs, controls = jax.vmap(run)(attacks)
    error = _attacked_error(reference, outputs[0], outputs[1:-1] - outputs[:1], worst)
    use = jnp.abs(controls[-1]) / jnp.asarray(limit)
    return PeakValues(error, use[worst.control_input])


def _attacked_error(
    reference: Reference,
    output: Float[Array, " m"],
    deviations: Float[Array, "m m"],
    worst: WorstCase,
) -> Float[Array, ""]:
    around, at = reference.arc[worst.sample], reference.position[worst.sample]
    if output.size == 1:
        return _length(output - at) + _length(deviations[0])
    tangent = _moving_tangent(reference, output, around, at)
    normals = jnp.asarray(worst.normals)
    normals = normals - (normals @ tangent)[:, None] * tangent[None]
    normals = normals / jnp.linalg.norm(normals, axis=1, keepdims=True)
    across = _length(jnp.sum(normals * deviations[:-1], axis=1))
    moved = worst.side * (tangent @ deviations[-1]) * tangent
    return across + _distance(reference, output + moved, around, at)


def _moving_tangent(reference: Reference, output, around, at) -> Float[Array, " m"]:
    """Tangent at the nearest point, with its derivative: the search itself has none.

    (y - p(s))' t = 0   ->   ds = t' dy / (1 - (y - p)' dt/ds);   at a corner the point stays
    """
    contour, foot = reference.contour, _foot(reference, output, around, at)
    tangent, bend = contour.tangent(foot), contour.curvature_vector(foot)
    away = jax.lax.stop_gradient(output) - contour.position(foot)
    held = jnp.abs(away @ tangent) > AT_FOOT * _length(away)
    moved = tangent @ (output - jax.lax.stop_gradient(output)) / (1 - away @ bend)
    turned = tangent + jnp.where(held, 0.0, moved) * bend
    return turned / jnp.linalg.norm(turned)


def _foot(reference: Reference, point, around, at) -> Float[Array, ""]:
    """Arc length of the nearest point."""
    lag = jax.lax.stop_gradient(_length(point - at))
    return reference.contour.nearest(point, around, SEARCH_REACH * lag)


def _distance(reference: Reference, point, around, at) -> Float[Array, ""]:
    return _length(point - reference.contour.position(_foot(reference, point, around, at)))


def _length(vector: Float[Array, " r"]) -> Float[Array, ""]:
    """Length, with the slope zero at zero."""
    square = jnp.sum(vector**2)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)
