"""Peaks of the sensitivities of frozen loops over all frequencies, and their slopes. Host side.

A grid over all frequencies finds the wide peaks. A narrow one comes from a pair of poles
r exp(+-j a) of the closed loop near the unit circle, stands within some widths 1 - r of a, and
frequencies around a belong to the grid. The highest points are refined by parabolas in brackets
ever narrower. This is a search and no bound: on random loops with light damping, delays and slow
integrators it falls short of the peak by less than a thousandth.

The slope of a peak is that of the largest singular value at its frequency (envelope theorem): of
s = Re(l' G r) with singular vectors l and r.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Complex, Float

from jcontour.analysis.frequency_response import Encoding, Responses
from jcontour.analysis.frozen_loops import (
    Ends,
    FrozenLoop,
    blocks,
    dominant,
    slope_of,
    times,
    turned,
)
from jcontour.analysis.uncertain_loops import (
    NEARER,
    ResponseUncertainty,
    measured_sensitivity,
    uncertainty_measure,
)

# [rad per sample]; the first stands for 0, where integrators have no response
GRID = np.pi * np.concatenate([[1e-7], np.geomspace(2e-7, 0.2, 46), np.linspace(0.2, 1, 17)[1:]])
CANDIDATES = 4  # highest local maxima that are refined
WIDEST = 0.02  # 1 - |p| of a pair of poles p, over its angle, at most
OFFSETS = np.array([-10, -3, -1, -0.3, 0.3, 1, 3, 10])  # from the angle of a pair, in 1 - |p|
SPREAD = 0.05  # of a bracket, about the vertex of its parabola: it shrinks to a tenth each time
REFINEMENTS = 4  # of the bracket of the highest peak


class Brackets(NamedTuple):
    """Three points around each peak, the middle one the highest; curves S and T in axis -3."""

    log_w: Float[np.ndarray, "*loops 2 R 3"]  # logarithm of the frequency [rad per sample]
    value: Float[np.ndarray, "*loops 2 R 3"]  # largest singular value there


def loop_measures(
    loop: FrozenLoop, encoding: Encoding, uncertainty: ResponseUncertainty | None = None
) -> tuple[Float[np.ndarray, "*loops 4"], FrozenLoop]:
    """Peak of S, peak of T, spectral radius and peak of W T of a batch of loops, and their slopes.

    A loop that is not stable has infinite peaks with slope 0; one that is not finite has an
    infinite radius, too.

    Args:
        loop: batched in front; plant and controller may have different batches that go together.
        encoding: how the sensors show positions.
        uncertainty: W, how far off the response of the plant may be; without it W T is 0. With
            lines in it the peak of S is that of the first plant of the last axis of the batch.

    Returns:
        Values, and their derivatives with respect to the matrices of the loop (*loops, 4, ...).
    """
    loop = jax.tree.map(lambda matrix: np.asarray(matrix, float), loop)
    matrices = [*loop.machine, *loop.law]
    each = np.broadcast_arrays(*(np.isfinite(matrix).all(axis=(-2, -1)) for matrix in matrices))
    finite = np.logical_and.reduce(each)
    loop = loop.only(finite)
    M = np.asarray(loop.cut().closed())
    poles, radius, left, right = dominant(M)
    stable = finite & (radius < 1)
    size = np.where(finite, radius, np.inf), slope_of(loop, left, right).only(finite)
    responses = Responses.of(loop, encoding)
    # a loop that is not stable has no peaks: its numbers are those of one that is
    poles = np.where(stable[..., None], poles, 0.0)
    closed = np.where(stable[..., None, None], M, 0.0)
    frequency = peak_frequencies(responses, poles)
    measures = []
    for curve in range(2):  # S, then T
        z = np.exp(1j * frequency[..., curve])
        peak, slope = _peak(loop, closed, responses.encoding, z, curve)
        measures.append((np.where(stable, peak, np.inf), slope.only(stable)))
    zero = np.zeros(closed.shape[:-1])
    uncertain = np.zeros(stable.shape), slope_of(loop, zero, zero)
    if uncertainty is not None:
        points = np.exp(_search_frequencies(poles))
        peak, slope = uncertainty_measure(loop, closed, responses, points, uncertainty)
        uncertain = np.where(stable, peak, np.inf), slope.only(stable)
        # of the first plants the peak of S around what was measured, if larger
        for lines, part in ((uncertainty.lines, 1.0), (uncertainty.other_amplitudes, NEARER)):
            if any(one.frequency.size for one in lines):
                highest, its_slope = measures[0]
                peak, slope = measured_sensitivity(loop, closed, responses, lines)
                peak, slope = part * peak, jax.tree.map(lambda one, k=part: k * one, slope)
                larger = (peak > highest) & (np.arange(peak.shape[-1]) == 0)
                measures[0] = np.where(larger, peak, highest), slope.only(larger, its_slope)
    measures += [size, uncertain]
    values = np.stack([value for value, _ in measures], axis=-1)
    slopes = jax.tree.map(lambda *each: np.stack(each, axis=-3), *(slope for _, slope in measures))
    return values, slopes


def peak_frequencies(
    responses: Responses, poles: Complex[np.ndarray, "*loops N"]
) -> Float[np.ndarray, "*loops 2"]:
    """Frequencies [rad per sample] of the peaks of S and of T.

    Args:
        responses: of the loops.
        poles: of the closed loops, which are stable.
    """
    log_w = _search_frequencies(poles)
    on_grid = np.broadcast_to(responses.gains(GRID), (*poles.shape[:-1], GRID.size, 2))
    beside = responses.gains(np.exp(log_w[..., GRID.size :]))
    values = np.concatenate([on_grid, beside], axis=-2)
    order = np.argsort(log_w, axis=-1)
    log_w = np.take_along_axis(log_w, order, axis=-1)
    values = np.take_along_axis(values, order[..., None], axis=-2)
    brackets = _refined(responses, _local_maxima(log_w, values))
    best = np.argmax(brackets.value[..., 1], axis=-1)[..., None, None]
    brackets = Brackets(*(np.take_along_axis(points, best, axis=-2) for points in brackets))
    for _ in range(REFINEMENTS):
        brackets = _refined(responses, brackets)
    frequency = np.exp(_vertex(brackets)[..., 0])
    return np.where(frequency > np.pi, 2 * np.pi - frequency, frequency)


def _search_frequencies(poles: Complex[np.ndarray, "*loops N"]) -> Float[np.ndarray, "*loops F"]:
    """Logarithms of the frequencies searched: the grid, then some around each pair of poles."""
    # at the angle of each pair and at multiples of its distance from the unit circle: zeros beside
    # the pair move its peak by several times its width
    pairs = min(poles.shape[-1] // 2, GRID.size - 2)
    unused = np.sqrt(GRID[1:-1] * GRID[2:])[GRID.size - 2 - pairs :]
    angle = np.angle(poles)
    resonant = (np.imag(poles) > 0) & (angle > GRID[1])
    inside = (1 - np.abs(poles)) / np.where(resonant, angle, 1.0)
    relative = np.where(resonant, inside, np.inf)
    narrow = np.argsort(relative, axis=-1)[..., :pairs]
    resonant, angle, relative = (
        np.take_along_axis(one, narrow, axis=-1) for one in (resonant, angle, relative)
    )
    centre = np.log(np.where(resonant, angle, unused))
    width = np.where(resonant, np.minimum(relative, WIDEST), WIDEST)
    grid = np.broadcast_to(np.log(GRID), (*poles.shape[:-1], GRID.size))
    around = np.exp(centre[..., None] + width[..., None] * OFFSETS)
    around = np.minimum(around, 2 * np.pi - around).reshape(*poles.shape[:-1], -1)
    return np.concatenate([grid, np.log(around)], axis=-1)


def _local_maxima(
    log_w: Float[np.ndarray, "*loops F"], values: Float[np.ndarray, "*loops F 2"]
) -> Brackets:
    """Highest local maxima of both curves, CANDIDATES of each, and their neighbours."""
    # beyond pi a curve is its own reflection
    mirrored = np.log(2 * np.pi - np.exp(log_w[..., -2:-1]))
    log_w = np.concatenate([log_w[..., :1] - 1, log_w, mirrored], axis=-1)
    values = np.concatenate([values[..., :1, :], values, values[..., -2:-1, :]], axis=-2)
    curves = np.swapaxes(values, -1, -2)
    before, here, after = curves[..., :-2], curves[..., 1:-1], curves[..., 2:]
    top = np.where((here >= before) & (here >= after), here, -np.inf)
    chosen = np.argsort(-top, axis=-1)[..., :CANDIDATES]
    rows = chosen[..., None] + np.arange(3)
    both = np.broadcast_to(log_w[..., None, :], curves.shape)
    flat = rows.reshape(*rows.shape[:-2], -1)
    taken = [np.take_along_axis(points, flat, axis=-1) for points in (both, curves)]
    return Brackets(*(points.reshape(rows.shape) for points in taken))


def _refined(responses: Responses, brackets: Brackets) -> Brackets:
    """Narrower brackets around the highest point, after three more evaluations at the vertex."""
    width = brackets.log_w[..., 2] - brackets.log_w[..., 0]
    spread = SPREAD * width[..., None] * np.array([-1.0, 0.0, 1.0])
    low, high = brackets.log_w[..., :1], brackets.log_w[..., 2:]
    log_w = np.clip(_vertex(brackets)[..., None] + spread, low, high)
    flat = np.exp(log_w).reshape(*log_w.shape[:-3], -1)
    both = responses.gains(flat).reshape(*log_w.shape, 2)
    values = np.stack([both[..., k, :, :, k] for k in range(2)], axis=-3)
    log_w = np.concatenate([brackets.log_w, log_w], axis=-1)
    values = np.concatenate([brackets.value, values], axis=-1)
    order = np.argsort(log_w, axis=-1)
    log_w, values = (np.take_along_axis(one, order, axis=-1) for one in (log_w, values))
    best = np.clip(np.argmax(values, axis=-1), 1, 4)[..., None]
    rows = best + np.array([-1, 0, 1])
    return Brackets(*(np.take_along_axis(one, rows, axis=-1) for one in (log_w, values)))


def _vertex(brackets: Brackets) -> Float[np.ndarray, "*loops 2 R"]:
    """Vertex of the parabola through three points; never the middle one itself."""
    a, b, c = np.moveaxis(brackets.log_w, -1, 0)
    low, top, high = np.moveaxis(brackets.value, -1, 0)
    left, right = (top - low) * (c - b), (top - high) * (b - a)
    area = left + right
    step = (left * (c - b) - right * (b - a)) / np.where(area > 0, 2 * area, 1.0)
    least = 1e-3 * SPREAD * np.where(c - b > b - a, 1.0, -1.0) * (c - a)
    return b + np.where(np.abs(step) > np.abs(least), step, least)


def _peak(loop: FrozenLoop, M, encoding: Encoding, z: Complex[np.ndarray, "*loops"], curve: int):
    """Largest singular value of S (curve 0) or T (1) at one frequency, and its slope."""
    # d_u is added to the control, J d_y to what the controller reads; T_u is the answer of the
    # control to d_u, T_y that of the positions to d_y; S = I + T
    (_, B, H), (W, E, K, D) = loop
    p, c, r = B.shape[-1], W.shape[-1], len(encoding.read)
    J = encoding.at(z)
    entry = blocks([[B, B @ D @ J], [np.zeros((c, p)), E @ J]])
    exit = blocks([[D @ H, K], [encoding.read @ H, np.zeros((r, c))]])
    resolvent = np.linalg.inv(z[..., None, None] * np.eye(M.shape[-1]) - M)
    T = exit @ resolvent @ entry
    of_input, of_output = (_block(T, rows, 1 - curve) for rows in (slice(0, p), slice(p, p + r)))
    larger = of_input[0] >= of_output[0]
    size = np.where(larger, of_input[0], of_output[0])
    u, v = (
        np.where(larger[..., None], *both) for both in zip(of_input[1:], of_output[1:], strict=True)
    )
    right = times(resolvent, times(entry, v))
    left = times(turned(exit @ resolvent), u)
    ends = Ends(v[..., :p], times(J, v[..., p:]), u[..., :p], times(encoding.read.T, u[..., p:]))
    return size, slope_of(loop, left, right, ends)


def _block(T: Complex[np.ndarray, "*loops s s"], rows: slice, one: int):
    """Largest singular value of a block of one I + T."""
    block = T[..., rows, rows]
    size = block.shape[-1]
    u, v = np.zeros(T.shape[:-1], complex), np.zeros(T.shape[:-1], complex)
    if size == 0:
        return np.full(T.shape[:-2], -np.inf), u, v
    U, heights, V = np.linalg.svd(block + one * np.eye(size))
    u[..., rows], v[..., rows] = np.conj(U[..., 0]), np.conj(V[..., 0, :])
    return heights[..., 0], u, v
