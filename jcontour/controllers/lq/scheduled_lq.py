"""LQ contouring on a machine that changes along its path, and with a long preview.

    x(k+j+1) = A_{k+j} x(k+j) + B_{k+j} u(k+j),   y(k+j) = C_{k+j} x(k+j)
The cost is that of `contouring_lq`. The model of each sample belongs to the desired position there:
it is known before the run starts, and so are the gains. The horizon ends in the infinite-horizon
cost of the model at its end, g = -H_s x_d, with H_s interpolated like the models (McNab & Tsao,
Theorem 1).

A horizon that moves on in blocks has a long preview at a low price. The horizon of a step ends at
least N_p and at most 2 N_p - 1 samples ahead, see `riccati.receding_horizon`. Once the loop forgets
within N_p samples, which is when the product of its transitions over them is below rounding, the
gains are those of ContouringLQ with any longer preview.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour._arrays import is_concrete
from jcontour.controller import check_preview, whole_preview
from jcontour.controllers.lq.contouring_lq import (
    LQWeights,
    ModelFeedback,
    OutputTerminal,
    PlannedFeedback,
    RiccatiTerminal,
    Terminal,
    check_stage,
    contour_weight,
    control_weight,
)
from jcontour.linear.model_schedule import ModelSchedule
from jcontour.linear.plant import AffinePlan, LinearPlant, steady_motion
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare
from jcontour.riccati.receding_horizon import CostToGo, block_ends, blockwise_plan, readable_plan


class ScheduledLQ(PlannedFeedback):
    """Controller u = f - F x with gains from the next `preview` samples and the models there.

    Args:
        schedule: models of the machine; the measurement is their state.
        weights: alpha, beta, rho and the stage profile.
        preview: horizon N_p [samples].

    Raises:
        ValueError: preview not a whole number or < 1, a stage profile of another length, or a model
            whose Riccati equation has no stabilising solution.
    """

    schedule: ModelSchedule
    weights: LQWeights
    preview: int = eqx.field(static=True)

    def __init__(self, schedule: ModelSchedule, weights: LQWeights, preview: int):
        self.schedule, self.weights, self.preview = schedule, weights, whole_preview(preview)
        check_stage(weights, self.preview)
        if is_concrete(*jax.tree.leaves((schedule, weights))):
            for k in range(schedule.points.size):
                model = schedule.model(k)
                Q = (weights.alpha + weights.beta) * model.C.T @ model.C
                check_dare(model.A, model.B, Q, control_weight(model, weights))

    def prepare(self, reference: Reference) -> AffinePlan:
        """Gain schedule of every step of the reference.

        Raises:
            ValueError: the reference looks less far ahead than the controller, or the path leaves
                the schedule.
        """
        check_preview(self, reference)
        weights, seen = self.weights, reference.steps + self.preview
        position, tangent = reference.position[:seen], reference.tangent[:seen]
        stage = jnp.ones(self.preview) if weights.stage is None else weights.stage
        Q = contour_weight(weights.alpha, weights.beta, tangent)
        R = control_weight(self.schedule.models, weights)
        models, terminal = self.schedule.along(position), self._terminal(position, stage[-1])
        return readable_plan(models, Q, position, stage, R, terminal)

    def _terminal(self, position: Float[Array, "S m"], scale: Float[Array, ""]) -> CostToGo:
        end, before = position[self.preview :], position[self.preview - 1 : -1]

        def solution(model):
            return RiccatiTerminal().solution(model, self.weights)

        solutions = jax.vmap(solution)(self.schedule.models)
        H = scale * self.schedule.interpolated(solutions, end)
        x_d = steady_motion(self.schedule.model(0)).state(end, end - before)
        return CostToGo(H, -jnp.einsum("tij,tj->ti", H, x_d))


class BlockwiseLQ(ModelFeedback):
    """Controller u = f - F x; every step sees at least `preview` samples of the path.

    Args:
        model: model of the machine; the measurement is its state.
        weights: alpha, beta and rho.
        preview: samples N_p of a block, and the fewest that a step sees.
        terminal: cost at the end of every block's horizon.

    Raises:
        ValueError: preview not a whole number or < 1, weights with a stage profile, which would
            have to move with the horizon, or a matrix rho of another size.
    """

    model: LinearPlant
    weights: LQWeights
    preview: int = eqx.field(static=True)
    terminal: Terminal

    def __init__(
        self, model: LinearPlant, weights: LQWeights, preview: int, terminal: Terminal | None = None
    ):
        if weights.stage is not None:
            raise ValueError("stage: a horizon that moves in blocks takes no stage profile")
        self.model, self.preview = model, whole_preview(preview)
        self.weights = jax.tree.map(lambda weight: jnp.asarray(weight, model.A.dtype), weights)
        self.terminal = OutputTerminal() if terminal is None else terminal
        self.terminal.check(model, self.preview)
        control_weight(model, weights)

    def gain_schedule(self, reference: Reference) -> AffinePlan:
        weights, model, steps = self.weights, self.model, reference.steps
        seen = steps + self.preview
        Q = contour_weight(weights.alpha, weights.beta, reference.tangent[:seen])
        y_d, R = reference.position[:seen], control_weight(model, weights)

        ends = block_ends(steps, self.preview)
        terminal = self.terminal.cost(model, weights, Q, y_d, ends)
        return blockwise_plan(model, Q, y_d, R, terminal, self.preview)
