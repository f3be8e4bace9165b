"""Frame along the path of a biaxial machine, and the contour error of a position error in it.

The unit tangent is t = (t_x, t_y), the normal to its left n = (-t_y, t_x), and dt/ds = kappa n.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference


class PathFrame(eqx.Module):
    """Tangent and curvature [1/m] at every step of a reference; positive in a turn to the left."""

    tangent: Float[Array, "*T 2"]
    curvature: Float[Array, "*T"]

    @property
    def normal(self) -> Float[Array, "*T 2"]:
        """Tangent turned to the left by a right angle."""
        return jnp.stack([-self.tangent[..., 1], self.tangent[..., 0]], axis=-1)

    def circular(self, error: Float[Array, " 2"]) -> Float[Array, " 2"]:
        """Gains c = n + kappa e / 2 for an error e = r - y [m].

        c'e is the distance to the circle of curvature, to second order in e. Koren & Lo 1991: C_x =
        sin theta - e_x / 2R, C_y = cos theta + e_y / 2R for their e = y - r on the left turn.
        """
        return self.normal + self.curvature * error / 2

    def contour_error(self, error: Float[Array, " 2"]) -> Float[Array, ""]:
        """Contour error eps = c'e [m], positive where the tool is to the right of the path."""
        return self.circular(error) @ error


class PathPlan(eqx.Module):
    """Commands of the axes, and the frame of the path there."""

    command: CascadePlan
    frame: PathFrame


class OnPath(Controller):
    """Common part of the contouring schemes around the cascade of a biaxial machine."""

    cascade: eqx.AbstractVar[Cascade]

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Samples of the future that the cascade needs."""
        return self.cascade.preview

    def prepare(self, reference: Reference) -> PathPlan:
        """Commands and frames of all steps.

        Raises:
            ValueError: as `Cascade.prepare`, or the reference has not two axes.
        """
        axes, steps = reference.position.shape[-1], reference.steps
        if axes != 2:
            raise ValueError(f"reference: contouring schemes need two axes, received {axes}")
        tangent = reference.tangent[:steps]
        bend = reference.contour.curvature_vector(reference.arc[:steps])
        curvature = tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]
        return PathPlan(self.cascade.prepare(reference), PathFrame(tangent, curvature))
