"""Contouring LQ of gantries behind an observer that finds the load.

The observer sees the positions of the three motors. Its model is that of the beam's centre and
predicts over the delay of the drives' bus, which may be there or not.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.designs.gains import Gain, GainDesign, Gains
from jcontour.app.designs.gantry import lq_weights, quadratic
from jcontour.app.designs.lq.first_loop import STATES, Drift
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.gantry import GantryMachine
from jcontour.controllers.lq.contouring_lq import ContouringLQ, RiccatiTerminal
from jcontour.controllers.observers.kalman import OffsetFreeObserver, offset_free_gain
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay

MOTORS = 3
# [rad per sample] of the load's estimate: the regulator is faster, so that the observer alone
# decides the margin; the beam's twist, at 0.55, is left alone. A faster one exceeds the usual bound
# on the peak sensitivity, 2, where masses are off by a tenth
BANDWIDTH = 0.033
# [A^2/m^2] of lag and of contour error beside an ampere: a regulator with more of the first is
# faster, and leaves the observer more of the margin
ALPHA, BETA = 7e8, 2e8


def offset_free_design(
    name: str, line: str, machine: GantryMachine, flags: Controlled
) -> GainDesign:
    """Design of the LQ controller, its observer and the delay of their model.

    Raises:
        ValueError: the delay is not one that the machine may have.
    """
    gains = _gains(machine)
    start = {key: gain.start for key, gain in gains.items()}
    space = {key: gain.parameter for key, gain in gains.items()}
    late = _model_delay(machine, flags)
    with jax.ensure_compile_time_eval():  # the zeros of the model are known while it is built
        model = with_input_delay(machine.model, late)
    build = partial(_observed, model, flags.preview)
    chosen = {"model_delay": late}
    return GainDesign(
        name, machine, start, space, flags.preview, "outputs", build, line, gains, chosen
    )


def _gains(machine: GantryMachine) -> dict[str, Gain]:
    """Weights of the cost, and the noises that the observer takes.

    As in the first loops of linear machines, drift / rounding = w / |G(w)| at the bandwidth w.
    """
    noise = rounding(machine) / _gain(machine, BANDWIDTH)  # crosses over there by itself
    return {
        **quadratic(machine),
        "alpha": Gain(ALPHA, "A^2/m^2", cost=True),
        "beta": Gain(BETA, "A^2/m^2", cost=True),
        "control_noise": Gain(STATES * noise, "A"),
        "drift": Gain(BANDWIDTH * noise, "A per sample", Drift()),
    }


def rounding(machine: GantryMachine) -> float:
    """Standard deviation [m] of what counts round off."""
    return float(machine.resolution / np.sqrt(12))


def _gain(machine: GantryMachine, bandwidth: float) -> float:
    """Gain of the machine's slower axis from current to position at exp(j w), w in rad per sample.

    Of the three gains the last is that of the twist, which the drives hardly move.
    """
    A, B = np.asarray(machine.model.A), np.asarray(machine.model.B)
    G = np.linalg.solve(np.exp(1j * bandwidth) * np.eye(len(A)) - A, B)[:MOTORS]
    return float(np.linalg.svd(G, compute_uv=False)[1])


def _model_delay(machine: GantryMachine, flags: Controlled) -> int:
    """Samples of the unknown delay that the model predicts over; all of them where not given."""
    asked = machine.unknown_delay if flags.model_delay is None else flags.model_delay
    if not 0 <= asked <= machine.unknown_delay:
        raise ValueError(
            f"model-delay: {machine.name} may be 0 to {machine.unknown_delay} samples late, "
            f"received {asked}"
        )
    return asked


def _observed(
    model: LinearPlant, preview: int, machine: GantryMachine, gains: Gains
) -> OffsetFreeObserver:
    inner = ContouringLQ(model, lq_weights(gains), preview, RiccatiTerminal())
    seen = jnp.eye(2 * MOTORS, model.states)
    return OffsetFreeObserver(
        controller=inner,
        model=model,
        gain=_observer_gain(machine, model, gains),
        measured=seen,
        limit=jnp.asarray(machine.limits.control),
    )


def _observer_gain(
    machine: GantryMachine, model: LinearPlant, gains: Gains
) -> Float[Array, "both 6"]:
    """Gain on the motors' positions; their speeds are differences and tell nothing more."""
    noises = gains["control_noise"], gains["drift"]
    positions = jnp.eye(MOTORS, model.states)
    gain = offset_free_gain(model, positions, *noises, rounding(machine))
    return jnp.concatenate([gain, jnp.zeros_like(gain)], axis=1)
