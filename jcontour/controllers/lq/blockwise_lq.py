"""LQ contouring control whose horizon moves on in blocks: a long preview at a low price.

The cost is that of `contouring_lq`. The horizon of a step ends at least N_p and at most 2 N_p - 1
samples ahead, see `riccati.blockwise`. Once the loop forgets within N_p samples, which is when
the product of its transitions over them is below rounding, the gains are those of ContouringLQ with
any longer preview.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from jcontour.controller import whole_preview
from jcontour.controllers.lq.contouring_lq import (
    LQWeights,
    OutputTerminal,
    Terminal,
    contour_weight,
    control_weight,
)
from jcontour.controllers.lq.planned_feedback import ModelFeedback
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.motion.references import Reference
from jcontour.riccati.blockwise import block_ends, blockwise_plan


class BlockwiseLQ(ModelFeedback):
    """Controller u = f - F x; every step sees at least `preview` samples of the path.

    >>> import numpy as np
    >>> from jcontour.geometry.contours import circle
    >>> from jcontour.motion.references import along
    >>> from jcontour.plants.bridgeport import bridgeport
    >>> table = bridgeport()
    >>> controller = BlockwiseLQ(table, LQWeights(alpha=1e8, beta=1e9, rho=1e-2), preview=40)
    >>> path = along(circle(0.01), 2.5e-5 * np.arange(60), table.dt, preview=40, at_rest=False)
    >>> controller.prepare(path).F.shape
    (60, 2, 8)

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
        control_weight(model, weights)

    def gain_schedule(self, reference: Reference) -> AffinePlan:
        """F and f of every step."""
        weights, model, steps = self.weights, self.model, reference.steps
        seen = steps + self.preview
        Q = contour_weight(weights.alpha, weights.beta, reference.tangent[:seen])
        y_d, R = reference.position[:seen], control_weight(model, weights)

        ends = block_ends(steps, self.preview)
        terminal = self.terminal.cost(model, weights, Q, y_d, ends)
        return blockwise_plan(model, Q, y_d, R, terminal, self.preview)
