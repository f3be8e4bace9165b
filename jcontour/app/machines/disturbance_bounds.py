"""Bounds of what acts on a linear machine, and its plants as certificates see them."""

import warnings
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.machines.uncertainty import FARTHEST, in_words
from jcontour.bounds.disturbed_loop import Box
from jcontour.plant import Plant


class Bounds(NamedTuple):
    """Bounds of the disturbances at every sample."""

    force: float  # on every control [control unit]
    encoder: float | tuple[float, ...]  # on every measured number, one or one for each [m]


def linear_machine(machine: Machine) -> LinearMachine:
    """The machine, where it is linear.

    Raises:
        ValueError: it is not.
    """
    linear = machine.form(LinearMachine)
    if linear is None:
        raise ValueError(
            f"plant: {machine.name} is not linear: what is proven is of machines with a linear "
            "model, as bridgeport, xy-table or a machine file"
        )
    return linear


def warn_of_doubt(machine: LinearMachine) -> None:
    """Warn where a response is doubted: promises hold for gains, delays and disturbances."""
    if machine.doubt is not None:
        warnings.warn(
            f"{machine.name}: how far off its response may be (uncertainty.response) is not in "
            "what is promised: it holds for the model with its gains and delays",
            stacklevel=2,
        )


def bounds_of(machine: LinearMachine, force: float | None, encoder_um: float | None) -> Bounds:
    """Bounds as given; else the machine's control noise or its friction, and what encoders err.

    That is half a count, and three deviations of their noise.

    Raises:
        ValueError: a bound is negative, or the encoders' error smaller than half a count.
    """
    for name, value in (("force", force), ("encoder-um", encoder_um)):
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name}: a bound needs to be finite and at least zero, is {value}")
    half = machine.resolution / 2 + FARTHEST * machine.encoder_noise
    rounding = tuple(half.tolist()) if isinstance(half, np.ndarray) else half
    encoder = rounding if encoder_um is None else 1e-6 * encoder_um
    if np.any(np.asarray(encoder) < half * (1 - 1e-9)):
        why = "rounding alone errs by half a count"
        if np.any(machine.encoder_noise):
            why = f"half a count and {FARTHEST:g} deviations of noise"
        raise ValueError(f"encoder-um: {why}, {in_words(half)}, received {encoder_um}")
    if force is None and machine.friction is None:
        warnings.warn(
            f"{machine.name}: its dry friction is not known (friction is null), and not in what is "
            "promised: give --force, or record long moves and identify again",
            stacklevel=2,
        )
    stated = max(machine.control_noise, machine.largest_friction)
    return Bounds(stated if force is None else force, encoder)


def box_of(plant: Plant, bounds: Bounds, machine: LinearMachine, fed: Fed) -> Box:
    """Box of a loop on a plant of the machine; a state that is measured as it is has no error."""
    none = jnp.zeros(len(machine.axes))
    measured = jax.eval_shape(lambda: plant.measure(plant.initial_state(none, none)))
    count = sum(np.prod(leaf.shape, dtype=int) for leaf in jax.tree.leaves(measured))
    noise = bounds.encoder if fed == "outputs" else 0.0
    return Box.of(bounds.force, noise, machine.model.inputs, int(count))
