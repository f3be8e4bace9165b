"""Peaks of the sensitivity of frozen loops, for a family of plants at the probes of some contours.

A frozen loop (`frozen_loops`) is linearised at the first step of a probe, plant and controller in
steady motion there. Probes are the samples of a contour whose frozen loops stand for all of it: a
loop changes with the directions of the path over the preview, with the place of the machine and
with its speed; they are few, and differ in all of them. d_u is added to the control behind the
controller, d_y to the positions that the sensors show:

    S_u = I + C (zI - M)^-1 B         d_u -> u + d_u,       T_u = S_u - I
    S_y = I + H (zI - M)^-1 E         d_y -> y + d_y,       T_y = S_y - I
M is the closed loop, z = exp(j w), w in rad per sample. A peak is the largest singular value over
all w (Skogestad & Postlethwaite, Multivariable Feedback Control, section 2.4.3).

Limits of the control (fields `limit` of plant and controller) are lifted: a loop that saturates is
looked at unsaturated. Dry friction is left out, viscous friction stays. Quantisers have no slope:
use smooth plants.

The output counts where the sensors show positions, all in metres: as many numbers as the tool has
axes, or positions and their differences (`FineEncoders`; a change of a position then changes both
speeds after it). For any other measurement, a whole state for instance, units differ from entry to
entry, and the input alone counts.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.tree_util import Partial
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour.analysis.frequency_response import Encoding, Responses
from jcontour.analysis.frozen_loops import (
    FrozenLoop,
    LinearMachine,
    linear_law,
    linear_machine,
    unlimited,
)
from jcontour.analysis.peak_search import loop_measures
from jcontour.analysis.uncertain_loops import ResponseUncertainty
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant, Wrapper
from jcontour.plants.encoders import CountingEncoders, FineEncoders, Sensed
from jcontour.plants.friction import without_dry_friction
from jcontour.sensors import row
from jcontour.simulation.closed_loop import check_run, start_state
from jcontour.simulation.evaluation import member


class LoopPeaks(NamedTuple):
    """Peaks of frozen loops, by probe and plant; the larger of plant input and output."""

    # Ms, largest singular value of S; infinite for a loop that is not stable
    sensitivity: Float[Array, "K P"]
    complementary: Float[Array, "K P"]  # Mt, largest singular value of T; likewise
    spectral_radius: Float[Array, "K P"]  # of the closed loop; stable below 1
    # largest singular value of W T_u, see `uncertain_loops`; infinite for a loop that is not
    # stable, 0 where nothing is said of W
    uncertainty: Float[Array, "K P"]


def sensitivity_curves(
    plants: Plant, controller: Controller, windows: Reference, frequencies: Float[ArrayLike, " F"]
) -> Float[np.ndarray, "K P F"]:
    """Largest singular value of the sensitivity over frequency, the larger of input and output.

    On the host; it says nothing of a loop that is not stable.

    Args:
        plants: as for `frozen_family`.
        controller: likewise.
        windows: likewise.
        frequencies: [rad per sample], from above 0 to pi.

    Raises:
        ValueError: as `simulate`.
    """
    loops = jax.device_get(frozen_family(plants, controller, windows))
    responses = Responses.of(loops, encoding_of(plants, windows))
    heights = responses.gains(np.asarray(frequencies))[..., 0]
    batch = loops.machine.A.shape[:-2]
    return np.broadcast_to(heights, (*batch, heights.shape[-1]))


def host_peaks(
    loops: FrozenLoop, encoding: Encoding, uncertainty: ResponseUncertainty | None = None
) -> LoopPeaks:
    """Peaks of frozen loops that a program has made, on the host and without derivatives."""
    values, _ = loop_measures(loops, encoding, uncertainty)
    return LoopPeaks(*np.moveaxis(values, -1, 0))


@eqx.filter_jit
def frozen_family(plants: Plant, controller: Controller, windows: Reference) -> FrozenLoop:
    """Frozen loops of every probe and plant.

    Args:
        plants: `stack_plants([...])`, axis 0, smooth.
        controller: any, traceable; prepared once per probe.
        windows: `probe_windows(...)`, axis 0.

    Returns:
        Matrices of the plants (K, P, ...), those of the controllers (K, 1, ...).

    Raises:
        ValueError: as `simulate`.
    """
    check_run(plants, controller, windows)
    controller, plants = unlimited(controller), without_dry_friction(unlimited(plants))

    def at_probe(window: Reference) -> FrozenLoop:
        plan = jax.tree.map(lambda leaf: leaf[0], controller.prepare(window))
        memory = controller.initial_memory(window)
        first = member(plants, 0)
        measurement = first.measure(start_state(first, window))
        law, control = linear_law(controller, plan, memory, measurement)

        def on_plant(plant: Plant) -> LinearMachine:
            return linear_machine(plant, start_state(plant, window), control)

        return FrozenLoop(jax.vmap(on_plant)(plants), jax.tree.map(lambda one: one[None], law))

    return jax.vmap(at_probe)(windows)


def encoding_of(plants: Plant, windows: Reference) -> Encoding:
    """How the sensors of a family show positions; without rows where they show something else."""

    def numbers(plants: Plant, windows: Reference):
        plant = member(plants, 0)
        state = start_state(plant, member(windows, 0))
        return plant.output(state), ravel_pytree(plant.measure(state))[0]

    output, measurement = jax.eval_shape(numbers, plants, windows)
    sensors = _innermost_sensors(plants)
    if isinstance(sensors, (FineEncoders, CountingEncoders)):
        shown = np.eye(sensors.sensors.axes)
        nothing = 0 * shown
        return Encoding(
            read=np.hstack([shown, nothing]),
            level=np.vstack([shown, nothing]),
            slope=np.vstack([nothing, shown / sensors.dt]),
        )
    count = measurement.size
    shown = np.eye(count) if count == output.size else np.zeros((count, 0))
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


LAGS = 5  # samples of a window whose directions are compared, evenly over the preview
CANDIDATES = 4096  # samples of a long contour among which probes are sought


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
    chosen = [_numbered(member(host, k), count, k) for k in range(size)]
    contour = np.repeat(np.arange(size), count)
    start = np.concatenate(chosen)
    rows = start[:, None] + np.arange(references.preview + 1)

    def cut(values):
        return jax.device_put(values[contour[:, None], rows])

    entered = host.position[contour, start] - host.position[contour, np.maximum(start - 1, 0)]
    increment = np.where((start > 0)[:, None], entered, host.start_increment[contour])
    mask = np.broadcast_to(np.arange(references.preview + 1) == 0, rows.shape)
    return jax.vmap(lambda *arrays: Reference(*arrays, references.dt, 1))(
        cut(host.position),
        cut(host.tangent),
        cut(host.arc),
        jax.device_put(mask),
        jax.device_put(increment),
        jax.tree.map(lambda leaf: jax.device_put(leaf[contour]), host.contour),
    )


def probe_samples(reference: Reference, count: int) -> Int[np.ndarray, " {count}"]:
    """Sorted samples of one contour: the sharpest turn, the ends, and what differs most from them.

    Raises:
        ValueError: no sample is scored.
    """
    reference = jax.tree.map(np.asarray, reference)
    scored = np.flatnonzero(reference.mask[: reference.steps])
    if scored.size == 0:
        raise ValueError("reference: it has no scored sample to look at")
    # change of direction from the sample before to the one after
    tangent = reference.tangent
    index = np.arange(reference.steps)
    after = np.minimum(index + 1, len(tangent) - 1)
    turns = np.linalg.norm(tangent[after] - tangent[np.maximum(index - 1, 0)], axis=1)[scored]
    sharpest = int(np.argmax(turns))
    few = np.linspace(0, scored.size - 1, min(scored.size, CANDIDATES)).astype(int)
    kept = np.union1d(few, sharpest)
    # what a loop depends on (samples, numbers), each part up to about one
    samples = scored[kept]
    lags = np.unique(np.linspace(0, reference.preview, LAGS).astype(int))
    r = reference.tangent[samples[:, None] + lags]
    directions = (r[..., :, None] * r[..., None, :]).reshape(samples.size, -1) / np.sqrt(lags.size)
    place = reference.position[samples] / max(float(reference.contour.size), 1e-12)
    steps = np.diff(reference.position, axis=0, prepend=reference.position[:1])
    speed = np.linalg.norm(steps, axis=1)
    relative = speed[samples] / max(speed.max(), 1e-12)
    features = np.concatenate([directions, place, relative[:, None]], axis=1)
    first = [int(np.searchsorted(kept, sharpest)), 0, kept.size - 1]
    return np.sort(scored[kept[_spread(features, first, count)]])


def _numbered(reference: Reference, count: int, number: int) -> np.ndarray:
    try:
        return probe_samples(reference, count)
    except ValueError as error:
        raise ValueError(f"references: number {number}: {error}") from None


def _spread(features: np.ndarray, first: list[int], count: int) -> list[int]:
    """Rows: the first ones, then those farthest from all before; repeats only if none is left."""
    chosen, distance = [], np.full(len(features), np.inf)
    for k in range(count):
        new = first[k] if k < len(first) else int(np.argmax(distance))
        chosen.append(new)
        away = np.linalg.norm(features - features[new], axis=1)
        distance = np.minimum(distance, away)
    return chosen
