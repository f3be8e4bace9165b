"""H-infinity feedback of any machine by mixed sensitivity, on its measured positions."""

from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.designs.any_machine import ANY, shared_out, shares_of, with_shares
from jcontour.app.designs.design import Design, Gains, picked
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.controllers.feedback.hinf_feedback import (
    Generalised,
    HInfinityFeedback,
    MixedWeights,
    central_controller,
    gain_at,
    least_gamma,
    mixed_sensitivity,
)
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from tuning.parameters import Weight

BANDWIDTH = 0.03  # [rad per sample]: 30 rad/s at 1 ms
ABOVE = 1.1  # level over the least one: near that the gains are large and buy nothing


class MixedSensitivity(Design[Machine]):
    """H-infinity feedback by mixed sensitivity, its target in steady motion.

    The level begins a tenth above the least that the first weights allow. The model predicts over
    the middle of the unknown delay, rounded up.
    """

    needs = ANY
    weights = (
        Weight("bandwidth", "rad/s", start=lambda machine: BANDWIDTH / machine.model.dt),
        Weight("peak", start=1.7),
        Weight("effort", start=0.1),
        Weight("load", start=0.1),
        Weight("level"),
    )
    reads = ("model_delay",)

    def starts(self) -> Gains:
        first = {one.name: one.start for one in self.weights if one.start is not None}
        first["bandwidth"] = BANDWIDTH / self.machine.model.dt
        return {"level": ABOVE * least_gamma(self.plant(first))}

    @cached_property
    def model(self) -> LinearPlant:
        """Model with the delay, its controls shared by the drives of an axis."""
        most = self.machine.unknown_delay
        late = self.model_delay(most, (most + 1) // 2)
        with jax.ensure_compile_time_eval():
            return with_shares(with_input_delay(self.machine.model, late), shares_of(self.machine))

    @cached_property
    def read(self) -> np.ndarray:
        """(q, r) positions in the measurement, of an axis the mean of its drives."""
        together = np.linalg.pinv(shares_of(self.machine))
        return np.pad(together, [(0, 0), (0, len(self.machine.sensed) - together.shape[1])])

    @cached_property
    def measured(self) -> np.ndarray:
        """C (q, n) of these positions."""
        if isinstance(self.machine, LinearMachine):
            return np.asarray(self.model.C)
        together = np.linalg.pinv(shares_of(self.machine))
        return together @ np.eye(together.shape[1], self.model.states)

    @cached_property
    def gain(self) -> float:
        """Gain of the machine at the first bandwidth: a unit, not tuned."""
        return gain_at(self.model, self.measured, BANDWIDTH / self.machine.model.dt)

    def plant(self, gains: Gains) -> Generalised:
        """Generalised plant of the weights."""
        weights = MixedWeights(*picked("bandwidth peak effort load", gains))
        return mixed_sensitivity(self.model, self.measured, weights, self.gain)

    def build(self, weights: Gains) -> Controller:
        law, _ = central_controller(self.plant(weights), jnp.asarray(weights["level"], float))
        limit = self.machine.limits.control
        bound = np.inf if limit is None else np.min(limit)
        feedback = HInfinityFeedback(self.model, self.read, self.measured, law, self.gain, bound)
        return shared_out(feedback, shares_of(self.machine))
