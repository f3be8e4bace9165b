"""The gantry along Fig. 5.11: its own nominal run, and the linear models a controller may have.

Every model has the states of `Gantry`, and after them the currents that wait for a late drive.
"""

from functools import cache
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from experiments.papers.yuan_gantry.experiment import SAMPLE, reference_path
from jcontour.motion.references import Reference
from jcontour.mpc.machine_runs import MachineRun, machine_run
from jcontour.plants.gantry.gantry import Gantry, thesis_gantry
from jcontour.plants.gantry.linear_models import Linearisation, currents_along
from jcontour.sets.responses import VaryingModel

POINTS = (-0.075, -0.025, 0.025, 0.075)  # [m], of linearisation, section 5.5.1
DISTURBANCE = 0.5  # [A] on every motor: ours, none is printed
DWELL = 0.02  # [s], rest at both ends
NEAR = 1e-8  # [m], error of the nominal run that counts as 1 A of current
MOVING = 6  # states of the machine itself


class Driven(NamedTuple):
    """The machine along the path.

    Attributes:
        reference: with its preview.
        run: the machine's own, undisturbed.
        late: samples by which currents act late.
    """

    reference: Reference
    run: MachineRun
    late: int

    @property
    def exact(self) -> VaryingModel:
        """Derivative of the machine along the run; E holds the disturbance of every motor."""
        return self.modelled(self.run.A, self.run.B)

    @property
    def state(self) -> Float[np.ndarray, "S n"]:
        """Nominal states, currents that wait among them."""
        v, S = self.run.control, len(self.run.A)
        waiting = [np.concatenate([v[j:], v[-1:].repeat(j, 0)]) for j in range(self.late)]
        return np.concatenate([self.run.state[:S], *waiting], axis=1)

    @property
    def control(self) -> Float[np.ndarray, "S p"]:
        """Nominal commands: those of the drives, as much earlier as they act late."""
        v = self.run.control
        return np.concatenate([v[self.late :], v[-1:].repeat(self.late, 0)])

    @property
    def tool(self) -> Float[np.ndarray, "S m n"]:
        """Derivative of the tool."""
        C = self.run.C
        return np.concatenate([C, np.zeros((*C.shape[:2], 3 * self.late))], axis=2)

    def curvature(self) -> Float[np.ndarray, "S n b b"]:
        """Second derivatives |H| of a sample's step (S, 6, 9, 9) over state and currents."""
        both = np.concatenate([self.run.state[: len(self.run.A)], self.run.control], axis=1)
        return np.abs(_second_derivatives(Gantry(thesis_gantry(), SAMPLE), both))

    def switched(
        self, linear: Linearisation, points: tuple[float, ...]
    ) -> tuple[VaryingModel, Int[np.ndarray, " S"]]:
        """Models at the nearest of some head positions, and which it is at every sample."""
        heads = self.run.state[: len(self.run.A), 0]
        which = np.abs(heads[:, None] - np.asarray(points)).argmin(axis=1)
        models = [linear(thesis_gantry(), point).sampled(SAMPLE) for point in points]
        A, B = (np.stack([np.asarray(one[i]) for one in models]) for i in range(2))
        return self.modelled(A[which], B[which]), which

    def modelled(self, A: np.ndarray, B: np.ndarray) -> VaryingModel:
        """Model with these matrices under the disturbances that the machine feels."""
        found = VaryingModel(A, B, DISTURBANCE * self.run.B)
        for _ in range(self.late):
            found = found.with_input_delay()
        return found


def driven(preview: int, late: int) -> Driven:
    """The machine along the path, with this preview."""
    return Driven(*_along_the_path(preview), late)


@eqx.filter_jit
def _second_derivatives(gantry: Gantry, both: np.ndarray) -> Array:
    def step(one):
        return gantry.step(one[:MOVING], one[MOVING:])

    return jax.vmap(jax.jacfwd(jax.jacfwd(step)))(both)


@cache
def _along_the_path(preview: int) -> tuple[Reference, MachineRun]:
    gantry, reference = Gantry(thesis_gantry(), SAMPLE), reference_path(preview, DWELL)
    currents = currents_along(gantry.parameters, reference.position, SAMPLE)
    return reference, machine_run(gantry, reference, currents, NEAR, 1.0)
