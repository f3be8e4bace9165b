"""How long the tool stays off its path: an offset at the start, and what is left of it at the end.

The spectral radius of a loop does not say this. An integral part that is slow has a pole next to
one, though the feedback brings the tool back at once: a zero all but cancels that pole.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import follow, prepared

OFFSET = 1e-6  # [m], so small that no limit of a drive is met


def offset_lasts(plant: Plant, controller: Controller, reference: Reference) -> float:
    """Samples in which an offset of the tool dies out to a third.

        n = -T / ln r,   r = max_i |y^(i)(T) - y(T)| / delta

    y^(i) is the run of T samples that begins delta = `OFFSET` off the path in direction i, y the
    one that begins on it. Infinite where nothing of it dies out.

    Args:
        plant: without rounding and stick-slip.
        controller: whose plan is that of the path.
        reference: of one path.
    """
    ends = np.asarray(_ends(plant, controller, prepared(controller, reference), reference))
    left = float(np.linalg.norm(ends[1:] - ends[0], axis=1).max()) / OFFSET
    if not left < 1:
        return np.inf
    return -reference.steps / float(np.log(left)) if left > 0 else 0.0


@eqx.filter_jit
def _ends(plant: Plant, controller: Controller, plan, reference: Reference) -> Float[Array, "r m"]:
    """Where runs end that begin on the path, and off it in every direction [m]."""
    begin = reference.position[0]
    offsets = OFFSET * jnp.concatenate([jnp.zeros((1, begin.size)), jnp.eye(begin.size)])

    def end(offset: Float[Array, " m"]) -> Float[Array, " m"]:
        state = plant.initial_state(begin + offset, reference.start_increment)
        rollout = follow(plant, controller, plan, reference, state)
        return plant.output(rollout.final_state)

    return jax.vmap(end)(offsets)
