"""Peaks of the sensitivity of frozen loops, for a family of plants at the probes of some contours.

A frozen loop (`frozen_loops`) is linearised at the first step of a probe, plant and controller in
steady motion there. d_u is added to the control behind the controller, d_y to the positions that
the sensors show:
    S_u = I + C (zI - M)^-1 B         d_u -> u + d_u,       T_u = S_u - I
    S_y = I + H (zI - M)^-1 E         d_y -> y + d_y,       T_y = S_y - I
M is the closed loop, z = exp(j w), w in rad per sample. A peak is the largest singular value over
all w (Skogestad & Postlethwaite, Multivariable Feedback Control, section 2.4.3).

Limits of the control (fields `limit` of plant and controller) are lifted: a loop that saturates is
looked at unsaturated. Quantisers have no slope: use smooth plants.

The output counts where the sensors show positions, all in metres: as many numbers as the tool has
axes, or positions and their differences (`FineEncoders`; a change of a position then changes both
speeds after it). For any other measurement, a whole state for instance, units differ from entry to
entry, and the input alone counts.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, ArrayLike, Complex, Float

from jcontour.analysis.frozen_loops import FrozenLoop, linear_law, linear_machine, unlimited
from jcontour.analysis.peak_search import GRID, Encoding, Responses, peak_frequencies
from jcontour.analysis.spectral import (
    in_turn,
    poles,
    radius,
    radius_slope,
    unit_circle,
    with_slope,
)
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.wrappers.encoders import CountingEncoders, FineEncoders, Sensed
from jcontour.plants.wrappers.wrapper import Wrapper
from jcontour.sensors import row
from jcontour.simulation.closed_loop import check_run, start_state
from jcontour.simulation.evaluation import member

LAGS = 5  # samples of a window whose directions are compared, evenly over the preview
CANDIDATES = 4096  # samples of a long contour among which probes are sought


class LoopPeaks(NamedTuple):
    """Peaks of frozen loops, by probe and plant; the larger of plant input and output.

    Attributes:
        sensitivity: Ms, largest singular value of S; infinite for a loop that is not stable.
        complementary: Mt, largest singular value of T; likewise.
        spectral_radius: of the closed loop; stable below 1.
    """

    sensitivity: Float[Array, "K P"]
    complementary: Float[Array, "K P"]
    spectral_radius: Float[Array, "K P"]


def probe_windows(references: Reference, count: int = 8) -> Reference:
    """Windows of one control step and the preview, `count` for each contour, on the host.

    Probes are the sharpest turn, the first and the last scored sample, then those that differ most
    from all chosen before: in the directions r r' over the preview, in the place on the contour,
    and in speed. A window starts in motion as the machine enters its sample.

    >>> from jcontour import contours, feed_laws, references
    >>> from jcontour.simulation.evaluation import stack_references
    >>> path = contours.polygon([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3]])
    >>> arc = feed_laws.constant_feed(path, 10e-3, 1e-3)
    >>> run = references.along(path, arc, 1e-3, preview=5, at_rest=False)
    >>> windows = probe_windows(stack_references([run]), count=4)
    >>> windows.steps, windows.position.shape
    (1, (4, 6, 2))

    Args:
        references: `stack_references([...])`, axis 0.
        count: windows for each contour; a contour with fewer scored samples repeats some.

    Returns:
        Stacked windows, those of the first contour first.

    Raises:
        ValueError: the count is below one, or a contour has no scored sample.
    """
    if count < 1:
        raise ValueError(f"count: needs at least one probe for each contour, received {count}")
    host = jax.tree.map(np.asarray, references)
    size = host.position.shape[0]
    chosen = [_probes(member(host, k), count, k) for k in range(size)]
    contour = np.repeat(np.arange(size), count)
    start = np.concatenate(chosen)
    rows = start[:, None] + np.arange(references.preview + 1)

    def cut(values):
        return jnp.asarray(values[contour[:, None], rows])

    entered = host.position[contour, start] - host.position[contour, np.maximum(start - 1, 0)]
    increment = np.where((start > 0)[:, None], entered, host.start_increment[contour])
    mask = np.broadcast_to(np.arange(references.preview + 1) == 0, rows.shape)
    return Reference(
        cut(host.position),
        cut(host.tangent),
        cut(host.arc),
        jnp.asarray(mask),
        jnp.asarray(increment),
        jax.tree.map(lambda leaf: jnp.asarray(leaf[contour]), host.contour),
        references.dt,
        1,
    )


@eqx.filter_jit
def loop_peaks(controller: Controller, plants: Plant, windows: Reference) -> LoopPeaks:
    """Peaks of the sensitivity and of the complementary one, with derivatives.

    Frequencies are found first; the derivative is that of the largest singular value there
    (envelope theorem).

    Args:
        controller: any, traceable; prepared once per probe.
        plants: `stack_plants([...])`, axis 0, smooth.
        windows: `probe_windows(...)`, axis 0.

    Raises:
        ValueError: as `simulate`.
    """

    def peaks(loop: FrozenLoop, encoding: Encoding) -> LoopPeaks:
        closed, responses = _closed(loop, encoding), Responses.of(loop)
        on_grid = responses.heights(jnp.asarray(GRID), encoding)

        def found(closed: _Closed, responses: Responses, on_grid):
            values = poles(closed.M)
            size, slope = radius_slope(closed.M, values)
            stable = size < 1
            closed = jax.tree.map(lambda matrix: jnp.where(stable, matrix, 0.0), closed)
            values = jnp.where(stable, values, 0.0)
            at = peak_frequencies(lambda w: responses.heights(w, encoding), values, on_grid)
            return size, slope, [_top(closed, encoding, at[k], k) for k in range(2)]

        size, slope, tops = in_turn(found)(closed, responses, on_grid)
        size = with_slope(size, slope, closed.M)
        heights = [with_slope(*top, closed) for top in tops]
        return LoopPeaks(*(jnp.where(size < 1, height, jnp.inf) for height in heights), size)

    return _over_loops(peaks, controller, plants, windows)


@eqx.filter_jit
def sensitivity_curves(
    controller: Controller, plants: Plant, windows: Reference, frequencies: Float[ArrayLike, " F"]
) -> Float[Array, "K P F"]:
    """Largest singular value of the sensitivity over frequency, the larger of input and output.

    Args:
        controller: as for `loop_peaks`.
        plants: likewise.
        windows: likewise.
        frequencies: [rad per sample], from above 0 to pi.

    Raises:
        ValueError: as `simulate`.
    """

    def curve(loop: FrozenLoop, encoding: Encoding):
        return Responses.of(loop).heights(jnp.asarray(frequencies), encoding)[:, 0]

    return _over_loops(curve, controller, plants, windows)


@eqx.filter_jit
def late_radius(
    controller: Controller, plants: Plant, windows: Reference, samples: int
) -> Float[Array, "K P"]:
    """Spectral radius of every loop with `samples` more of delay on its control, differentiable.

    Args:
        controller: as for `loop_peaks`.
        plants: likewise.
        windows: likewise.
        samples: at least 0.

    Raises:
        ValueError: as `simulate`, or a negative delay.
    """
    if samples < 0:
        raise ValueError(f"samples: a delay is not negative, received {samples}")

    def late(loop: FrozenLoop, encoding: Encoding):
        cut = loop.cut()
        return radius(cut.late(samples) if samples else jnp.asarray(cut.closed()))

    return _over_loops(late, controller, plants, windows)


def _over_loops(function, controller: Controller, plants: Plant, windows: Reference):
    """function(loop, encoding) of every probe and plant, (K, P)."""
    check_run(plants, controller, windows)
    controller, plants = unlimited(controller), unlimited(plants)

    def at_probe(window: Reference):
        plan = jax.tree.map(lambda leaf: leaf[0], controller.prepare(window))
        memory = controller.initial_memory(window)
        first = member(plants, 0)
        measurement = first.measure(start_state(first, window))
        law, control = linear_law(controller, plan, memory, measurement)

        def on_plant(plant: Plant):
            state = start_state(plant, window)
            machine = linear_machine(plant, state, control)
            encoding = _encoding(plant, state, machine.H.shape[0])
            return function(FrozenLoop(machine, law), encoding)

        return jax.vmap(on_plant)(plants)

    return jax.vmap(at_probe)(windows)


class _Closed(NamedTuple):
    """A closed loop z+ = M z + entry (d_u, d_q), of which `exit` reads (u, y).

    d_q changes what the controller reads, y are the positions in it.
    """

    M: Float[Array, "N N"]
    entry: Float[Array, "N p+q"]
    exit: Float[Array, "p+r N"]


def _closed(loop: FrozenLoop, encoding: Encoding) -> _Closed:
    cut, H = loop.cut(), loop.machine.H
    unread = jnp.zeros((len(encoding.read), loop.law.W.shape[0]), H.dtype)
    shown = jnp.concatenate([jnp.asarray(encoding.read, H.dtype) @ H, unread], axis=1)
    return _Closed(
        jnp.asarray(cut.closed()),
        jnp.concatenate([cut.B, loop.entry()], axis=1),
        jnp.concatenate([cut.C, shown]),
    )


def _top(closed: _Closed, encoding: Encoding, w: Float[Array, ""], curve: int):
    """Largest singular value of S (curve 0) or T (1) at one frequency, and its derivative.

    With singular vectors s = u'(I + exit (zI - M)^-1 entry J) v the derivative is
        ds = Re(u' dexit right + left dM right + left dentry J v),
    right = (zI - M)^-1 entry J v and left = u' exit (zI - M)^-1.
    """
    z = unit_circle(w)
    M, entry, exit = (matrix.astype(z.dtype) for matrix in closed)
    N, p = M.shape[0], entry.shape[1] - encoding.level.shape[0]
    J = jax.scipy.linalg.block_diag(jnp.eye(p, dtype=z.dtype), encoding.at(z))
    factors = jax.scipy.linalg.lu_factor(z * jnp.eye(N, dtype=z.dtype) - M)
    moved = jax.scipy.linalg.lu_solve(factors, entry @ J)
    T = exit @ moved
    blocks = [np.arange(p), np.arange(p, exit.shape[0])]
    tops = [_singular(T, rows, 1 - curve) for rows in blocks if rows.size]
    height, u, v = jax.tree.map(lambda *ones: jnp.stack(ones), *tops)
    best = jnp.argmax(height)
    u, v = u[best], v[best]
    right, left = moved @ v, jax.scipy.linalg.lu_solve(factors, exit.T @ jnp.conj(u), trans=1)
    slope = _Closed(jnp.outer(left, right), jnp.outer(left, J @ v), jnp.outer(jnp.conj(u), right))
    return height[best], jax.tree.map(jnp.real, slope)


def _singular(T: Complex[Array, "s s"], rows: np.ndarray, one: int):
    """Largest singular value of a block of one I + T, and its vectors among zeros."""
    block = T[np.ix_(rows, rows)] + one * jnp.eye(rows.size, dtype=T.dtype)
    U, heights, V = jnp.linalg.svd(block)
    nothing = jnp.zeros(T.shape[0], T.dtype)
    return heights[0], nothing.at[rows].set(U[:, 0]), nothing.at[rows].set(jnp.conj(V[0]))


def _encoding(plant: Plant, state, numbers: int) -> Encoding:
    """How the sensors show positions; without rows where they show something else."""
    axes = plant.output(state).size
    sensors = _innermost_sensors(plant)
    if isinstance(sensors, (FineEncoders, CountingEncoders)):
        shown = np.eye(sensors.sensors.axes)
        nothing = 0 * shown
        return Encoding(
            read=np.hstack([shown, nothing]),
            level=np.vstack([shown, nothing]),
            slope=np.vstack([nothing, shown / plant.dt]),
        )
    shown = np.eye(numbers) if numbers == axes else np.zeros((numbers, 0))
    return Encoding(read=shown.T, level=shown, slope=0 * shown)


def _innermost_sensors(plant: Plant) -> Plant:
    """The plant without the wrappers that leave the measurement as it is."""
    while isinstance(plant, Wrapper) and not isinstance(plant, (FineEncoders, CountingEncoders)):
        if isinstance(plant, Sensed):
            sensors = plant.sensors
            if not (isinstance(sensors, Partial) and sensors.func is row):
                break
        plant = plant.plant
    return plant


def _probes(reference: Reference, count: int, number: int) -> np.ndarray:
    """Sorted samples (count,) of one contour."""
    scored = np.flatnonzero(reference.mask[: reference.steps])
    if scored.size == 0:
        raise ValueError(f"references: number {number} has no scored sample to look at")
    turns = _turns(reference)[scored]
    sharpest = int(np.argmax(turns))
    few = np.linspace(0, scored.size - 1, min(scored.size, CANDIDATES)).astype(int)
    kept = np.union1d(few, sharpest)
    features = _features(reference, scored[kept])
    first = [int(np.searchsorted(kept, sharpest)), 0, kept.size - 1]
    return np.sort(scored[kept[_spread(features, first, count)]])


def _turns(reference: Reference) -> np.ndarray:
    """Change of direction (T,) from the sample before to the one after."""
    tangent = reference.tangent
    index = np.arange(reference.steps)
    after = np.minimum(index + 1, len(tangent) - 1)
    return np.linalg.norm(tangent[after] - tangent[np.maximum(index - 1, 0)], axis=1)


def _features(reference: Reference, samples: np.ndarray) -> np.ndarray:
    """What a loop depends on (samples, numbers), each part up to about one."""
    lags = np.unique(np.linspace(0, reference.preview, LAGS).astype(int))
    r = reference.tangent[samples[:, None] + lags]
    directions = (r[..., :, None] * r[..., None, :]).reshape(samples.size, -1) / np.sqrt(lags.size)
    place = reference.position[samples] / max(float(reference.contour.size), 1e-12)
    steps = np.diff(reference.position, axis=0, prepend=reference.position[:1])
    speed = np.linalg.norm(steps, axis=1)
    relative = speed[samples] / max(speed.max(), 1e-12)
    return np.concatenate([directions, place, relative[:, None]], axis=1)


def _spread(features: np.ndarray, first: list[int], count: int) -> list[int]:
    """Rows: the first ones, then those farthest from all before; repeats only if none is left."""
    chosen, distance = [], np.full(len(features), np.inf)
    for k in range(count):
        new = first[k] if k < len(first) else int(np.argmax(distance))
        chosen.append(new)
        away = np.linalg.norm(features - features[new], axis=1)
        distance = np.minimum(distance, away)
    return chosen
