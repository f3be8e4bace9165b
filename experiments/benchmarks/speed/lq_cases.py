"""Machines and runs that `jcontour bench lq` times."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jcontour import _kernels as kernels
from jcontour.controllers.lq.blockwise_lq import BlockwiseLQ
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line
from jcontour.linear.continuous_axes import (
    ContinuousAxis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from jcontour.linear.plant import LinearPlant, Pattern, steady_motion
from jcontour.motion.references import Reference, along
from jcontour.plants import bridgeport
from jcontour.simulation.evaluation import evaluate, member, stack_plants, stack_references
from jcontour.simulation.metrics import Metrics

STEPS, PREVIEW = 500, 10  # a quarter of a second at the paper's 2 kHz, and its usual horizon
RADIUS, ADVANCE = 0.02, 4e-5  # [m], [m per sample]: 80 mm/s
RESONANCES, DAMPING = (250.0, 500.0, 900.0), 0.05  # [rad/s], of the structures of larger machines
SIZES = ((2, 2), (4, 4), (3, 3, 3), (4, 4, 4), (8, 8), (5, 5, 6))  # states of every axis
DOUBLE, SINGLE = np.dtype("float64"), np.dtype("float32")


class Case(NamedTuple):
    """A machine and a run on it."""

    plant: LinearPlant
    plants: LinearPlant  # the same as a family of one
    references: Reference  # one, stacked
    preview: int
    law: type[ContouringLQ] | type[BlockwiseLQ] = ContouringLQ

    @classmethod
    def of(cls, plant: LinearPlant, reference: Reference, preview: int, dtype: np.dtype) -> "Case":
        """Case with all numbers of one type."""
        family, references = stack_plants([plant]), stack_references([reference])
        return cls(*cast((plant, family, references), dtype), preview)

    @property
    def dtype(self) -> np.dtype:
        """Type of all numbers."""
        return self.plant.A.dtype

    def metrics(self, weights) -> Metrics:
        """Metrics under weights (alpha, beta, rho, then the entries of a profile, if any)."""
        alpha, beta, rho, *profile = weights
        stage = jnp.stack(profile) if profile else None
        controller = self.law(self.plant, LQWeights(alpha, beta, rho, stage), self.preview)
        found = evaluate(self.plants, controller, self.references)
        return jax.tree.map(lambda number: number[0, 0], found)

    def objective(self, weights):
        """RMS contour error and RMS tracking error [m]."""
        metrics = self.metrics(weights)
        return metrics.rms_contour_error + metrics.rms_tracking_error

    def weights(self, batch: int, profile: int = 0):
        """Random weights (batch, 3 + profile)."""
        random = np.random.default_rng(0)
        ends = np.log([(0.1, 10.0), (0.1, 10.0), (1e-12, 1e-9)] + [(0.6, 1.6)] * profile)
        return jnp.asarray(np.exp(random.uniform(*ends.T, (batch, len(ends)))), self.dtype)


def paper_case(dtype: np.dtype, steps: int = STEPS, preview: int = PREVIEW) -> Case:
    """The paper's machine on a circle."""
    reference = along(
        circle(RADIUS), ADVANCE * np.arange(steps), bridgeport().dt, preview, at_rest=False
    )
    return Case.of(bridgeport(), reference, preview, dtype)


def sized_case(states: tuple[int, ...]) -> Case:
    """A machine whose axes have these numbers of states, on a straight line."""
    plant = machine(states)
    path = line([0.0] * plant.axes, [1.0] * plant.axes)
    reference = along(path, ADVANCE * np.arange(STEPS), plant.dt, PREVIEW, at_rest=True)
    return Case.of(plant, reference, PREVIEW, DOUBLE)


def coupled_case() -> Case:
    """The paper's machine and run, where nothing says that its axes are decoupled."""
    case, table = paper_case(DOUBLE), bridgeport()
    every = Pattern(*(tuple((True,) * M.shape[1] for _ in M) for M in (table.A, table.B, table.C)))
    plant = LinearPlant(table.A, table.B, table.C, table.dt, every, steady_motion(table))
    return Case.of(plant, member(case.references, 0), PREVIEW, DOUBLE)


def machine(states: tuple[int, ...]) -> LinearPlant:
    """Speed drives in front of flexible structures, with these numbers of states in the axes.

    An axis has two states, two for every resonance, and one for half a sample of delay where the
    number is odd.
    """
    dt = 1e-3
    axes = [_axis(count, 1.0 + 0.1 * axis, dt) for axis, count in enumerate(states)]
    return sampled_machine(axes, dt)[0]


def _axis(states: int, faster: float, dt: float) -> ContinuousAxis:
    axis = speed_axis(gain=0.1, time_constant=0.02 / faster, delay=0.5 * dt * (states % 2))
    for resonance in range(states // 2 - 1):
        axis = with_resonance(axis, faster * RESONANCES[resonance], DAMPING)
    return axis


def formulation(case: Case) -> str:
    """Form that `evaluate` chooses here: the algebra of decoupled axes or the sweep, and where."""
    reference = member(case.references, 0)
    controller = ContouringLQ(case.plant, LQWeights(1.0, 1.0, 1.0), case.preview)
    form = "sweep" if controller.decoupled_problem(reference) is None else "algebra"
    return f"{form}, {'kernel' if kernels.wanted() else 'XLA'}"


def cast(tree: Any, dtype: np.dtype) -> Any:
    """The tree with its floating-point leaves in another type."""

    def one(leaf):
        return leaf.astype(dtype) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf

    return jax.tree.map(one, tree)
