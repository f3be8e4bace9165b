"""Contouring LQ of gantries behind an observer that finds the load.

The observer sees the positions of the three motors. Its model is that of the beam's centre and
predicts over the delay of the drives' bus, which may be there or not.
"""

from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.designs.design import Gains
from jcontour.app.designs.gantry import GantryLQ
from jcontour.app.designs.lq.first_loop import STATES, Drift
from jcontour.app.machines.gantry import GantryMachine
from jcontour.controller import Controller
from jcontour.controllers.lq.contouring_lq import ContouringLQ, RiccatiTerminal
from jcontour.controllers.observers.kalman import OffsetFreeObserver, offset_free_gain
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from tuning.parameters import Weight

MOTORS = 3
# [rad per sample] of the load's estimate: the regulator is faster, so that the observer alone
# decides the margin; the beam's twist, at 0.55, is left alone. A faster one exceeds the usual bound
# on the peak sensitivity, 2, where masses are off by a tenth
BANDWIDTH = 0.033
# [A^2/m^2] of lag and of contour error beside an ampere: a regulator with more of the first is
# faster, and leaves the observer more of the margin
ALPHA, BETA = 7e8, 2e8


def _noise(machine: GantryMachine) -> float:
    """Noise of the controls whose observer crosses over at the bandwidth by itself."""
    return rounding(machine) / _gain(machine, BANDWIDTH)


class GantryOffsetFreeLQ(GantryLQ):
    """Contouring LQ on three motors, behind an observer that predicts and finds the load.

    As in the first loops of linear machines, drift / rounding = w / |G(w)| at the bandwidth w. The
    model predicts over all of the unknown delay where none is given.
    """

    weights = (
        Weight("alpha", "A^2/m^2", start=ALPHA, cost=True),
        Weight("beta", "A^2/m^2", start=BETA, cost=True),
        GantryLQ.weights[2],
        Weight("control_noise", "A", start=lambda machine: STATES * _noise(machine)),
        Weight("drift", "A per sample", Drift(), lambda machine: BANDWIDTH * _noise(machine)),
    )
    reads = ("preview", "model_delay")

    @cached_property
    def late(self) -> int:
        """Samples of the unknown delay that the model predicts over."""
        most = self.machine.unknown_delay
        return self.model_delay(most, most)

    @cached_property
    def model(self) -> LinearPlant:
        """Model with the delay; never traced: its zeros are known while it is built."""
        with jax.ensure_compile_time_eval():
            return with_input_delay(self.machine.model, self.late)

    def first_preview(self, first: Gains) -> int:
        return self.flags.preview

    def settings(self) -> dict[str, int]:
        return {**super().settings(), "model_delay": self.late}

    def build(self, weights: Gains) -> Controller:
        model, cost = self.model, self.cost(weights)
        # Gain on the motors' positions; their speeds are differences and tell nothing more
        noises = weights["control_noise"], weights["drift"]
        positions = jnp.eye(MOTORS, model.states)
        gain = offset_free_gain(model, positions, *noises, rounding(self.machine))
        return OffsetFreeObserver(
            controller=ContouringLQ(model, cost, self.flags.preview, RiccatiTerminal()),
            model=model,
            gain=jnp.concatenate([gain, jnp.zeros_like(gain)], axis=1),
            measured=jnp.eye(2 * MOTORS, model.states),
            limit=jnp.asarray(self.machine.limits.control),
        )


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
