"""Finite responses for a machine that is seen by encoders: the filter whose promise is the least.

The MPC acts on the estimate of a filter, see `mpc.bounded.knowledge`. The filter's innovations are
its disturbances; what the estimate misses is added to its tolerance. A filter that believes the
encoders has large innovations, one that does not misses more: of the gains that are given the one
of the least sum is taken.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.bounds.attacks import Attack
from jcontour.linear.plant import LinearPlant
from jcontour.mpc.bounded.bounded_mpc import BoundedLimits, bounded_response, speed_signals
from jcontour.mpc.bounded.knowledge import Knowledge, state_bounded_by_filter
from jcontour.sets.disturbed_model import DisturbedModel, Numbers
from jcontour.sets.least_peaks import LeastPeak


class Surroundings(NamedTuple):
    """Sizes of what acts on a machine at every sample.

    Attributes:
        force: on every control, one number or (p,) [control unit].
        encoder: error of every measured position, one number or (m,) [m].
    """

    force: Numbers
    encoder: Numbers


class FilteredResponse(NamedTuple):
    """Filter and responses.

    Attributes:
        gain: L (n, m) of the filter.
        known: what its estimate is, and what it misses.
        least: responses to its innovations.
    """

    gain: Float[np.ndarray, "n m"]
    known: Knowledge
    least: LeastPeak

    @property
    def missed(self) -> float:
        """Largest distance of the tool from where the filter knows it [m]."""
        return float(np.linalg.norm(self.known.tool))

    @property
    def tolerance(self) -> float:
        """What disturbances make of the tool at most, in any direction [m]."""
        return self.least.tolerance + self.missed

    def limits(self, plant: LinearPlant, control: Numbers, speed: Numbers) -> BoundedLimits:
        """Limits of the MPC, from those of the machine.

        Raises:
            ValueError: disturbances alone make as much speed as is allowed.
        """
        return _limits(plant, self.known, control, speed)

    def attack(
        self, plant: LinearPlant, around: Surroundings, direction: Numbers, samples: int
    ) -> Attack:
        """Forces and encoder errors that drive filter and responses to their peak.

        The tool is largest along a direction at the last of the samples. The MPC does not follow
        its responses to the digit: the attack comes close to what is promised, not up to it.

        Args:
            plant: the machine.
            around: sizes of what acts.
            direction: (m,), of unit length.
            samples: of the attack.
        """
        row = np.asarray(direction, float)
        force = np.broadcast_to(np.asarray(around.force, float), (plant.inputs,))
        pushed = [np.asarray(plant.B)[:, i] for i in range(plant.inputs)]
        seen = list(np.eye(plant.axes))
        none, still = np.zeros(plant.axes), np.zeros(plant.states)
        by_force = [self._tool(plant, e, none, samples) @ row for e in pushed]
        by_error = [self._tool(plant, still, n, samples) @ row for n in seen]
        # a force moves the tool one sample later, an error of the encoder at once
        early = np.sign(np.stack(by_force, axis=1))[::-1]
        forces = np.concatenate([early[1:], np.zeros((1, plant.inputs))]) * force
        return Attack(forces, np.sign(np.stack(by_error, axis=1))[::-1] * around.encoder)

    def _tool(self, plant, error, noise, samples: int) -> Float[np.ndarray, "T m"]:
        """The tool after an error of the estimate, or of the encoders, at the first sample."""
        A, C = np.asarray(plant.A), np.asarray(plant.C)
        innovations, left = [], []
        for _ in range(samples):
            innovations.append(C @ error + noise)
            after = error - self.gain @ innovations[-1]
            left.append(C @ after)
            error, noise = A @ after, np.zeros_like(noise)
        sizes = np.abs(self.known.E).max(axis=0) / np.abs(self.gain).max(axis=0)
        shares = np.stack(innovations) / sizes
        answered = np.array(left)
        for j, response in enumerate((C @ self.least.response.state)[:samples]):
            answered[j:] += shares[: samples - j] @ response.T
        return answered


def filtered_response(
    plant: LinearPlant,
    gains: Iterable[Numbers],
    around: Surroundings,
    limits: tuple[Numbers, Numbers],
    length: int,
    offset_free: bool = True,
) -> FilteredResponse:
    """The filter, and the responses to its innovations, whose tolerance is the least.

    Args:
        plant: the machine.
        gains: filter gains L (n, m) to choose from.
        around: sizes of what acts.
        limits: on the controls, and on the tool's speed along every axis [m/s].
        length: samples after which the answer to an innovation has come to rest.
        offset_free: constant innovations leave no error; costs some of the tolerance.

    Raises:
        ValueError: no gain has an answer; why the last one has none. `NoResponse` where limits are
            too small.
    """
    best, refused = None, ValueError("gains: needs at least one")
    for gain in gains:
        known = state_bounded_by_filter(plant, gain, around.force, around.encoder)
        model = DisturbedModel.of(plant.A, plant.B, known.E)
        try:
            kept = _limits(plant, known, *limits)
            least = bounded_response(plant, model, kept, length, offset_free)
        except ValueError as none:
            refused = none
            continue
        found = FilteredResponse(np.asarray(gain, float), known, least)
        if best is None or found.tolerance < best.tolerance:
            best = found
    if best is None:
        raise refused
    return best


def _limits(
    plant: LinearPlant, known: Knowledge, control: Numbers, speed: Numbers
) -> BoundedLimits:
    return BoundedLimits(control, speed_signals(plant, speed, known.speed))
