"""Peaks of the sensitivity of frozen loops, for a family of plants at the probes of some contours.

A frozen loop (`frozen_loops`) is linearised at the first step of a probe, plant and controller in
steady motion there. d_u is added to the control behind the controller, d_y to the positions that
the sensors show:

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
from jaxtyping import Array, ArrayLike, Float

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
from jcontour.plant import Plant
from jcontour.plants.encoders import CountingEncoders, FineEncoders, Sensed
from jcontour.plants.friction import without_dry_friction
from jcontour.sensors import row
from jcontour.simulation.closed_loop import check_run, start_state
from jcontour.simulation.evaluation import member
from jcontour.wrapper import Wrapper


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
    heights = responses.heights(np.asarray(frequencies))[..., 0]
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
