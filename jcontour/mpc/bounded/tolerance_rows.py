"""Rows that keep the tool within a tolerance of a path, sample by sample.

In the frame of the reference point p_k, tangent t and normal n, the tool is at p_k + nu n + tau t.
The distance to the path is 1-Lipschitz, so with D_k(b) the largest distance of p_k + sigma t from
the path over |sigma| <= b,

    |nu| <= eps - D_k(b) and |tau| <= b    keep the tool within eps of the path,
on lines, arcs, splines and at corners. D is the largest of samples along the tangent, plus half of
their spacing. On a single axis the tracking error itself is kept within eps.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.motion.references import Reference
from jcontour.sets.finite_responses import FiniteResponse

SPACINGS = 64  # of a tangent's samples: half of one adds 1/64 of b to D, less than 2 %
WIDER = 1.02  # room along the path beyond what nominal run and disturbances need


class Frames(NamedTuple):
    """Directions of every sample, the one that the tolerance bounds last, and their room.

    Attributes:
        directions: unit rows (S, r, m): (tangent, normal) of a plane path, one on a single axis.
        nominal: deviation of the nominal run from the reference along them (S, r) [m].
        peak: what the disturbances add at most (S, r) [m].
        growth: of these peaks over the samples of a plan (S, r, N+1) [m].
        off: D, distance of the path from its own tangent (S,) [m].
        along: limit b on the deviation along the path (S,) [m]; the first direction's.
    """

    directions: Float[np.ndarray, "S r m"]
    nominal: Float[np.ndarray, "S r"]
    peak: Float[np.ndarray, "S r"]
    growth: Float[np.ndarray, "S r M"]
    off: Float[np.ndarray, " S"]
    along: Float[np.ndarray, " S"]

    @property
    def certified(self) -> Float[np.ndarray, " S"]:
        """Tolerance that every sample can be promised at the least [m]."""
        return np.abs(self.nominal[:, -1]) + self.peak[:, -1] + self.off

    def room(self, tolerance: float) -> Float[np.ndarray, "S r"]:
        """Limits on the deviation along every direction for a tolerance [m]."""
        across = (tolerance - self.off)[:, None]
        if self.directions.shape[1] == 1:
            return across
        return np.concatenate([self.along[:, None], across], axis=1)


def frames_of(
    reference: Reference,
    output: Float[np.ndarray, "S m"],
    C: Float[np.ndarray, "m n"],
    response: FiniteResponse,
) -> Frames:
    """Frames along all samples of a reference.

    Args:
        reference: of one or two axes.
        output: the tool in the nominal run [m].
        C: output matrix.
        response: of the policy that the plan is tightened by.

    Raises:
        ValueError: the reference has three axes.
    """
    position, tangent = np.asarray(reference.position), np.asarray(reference.tangent)
    S, m = position.shape
    if m > 2:
        raise ValueError("reference: a bounded MPC takes one or two axes, received 3")
    if m == 1:
        directions = np.ones((S, 1, 1))
    else:
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        directions = np.stack([tangent, normal], axis=1)
    nominal = np.einsum("srm,sm->sr", directions, output - position)
    still = np.zeros((*directions.shape[:2], response.model.inputs))
    growth = response.growth(directions @ C, still)
    peak = growth[..., -1]
    along = WIDER * (np.abs(nominal[:, 0]) + peak[:, 0])
    off = np.zeros(S) if m == 1 else _off_the_tangent(reference, along)
    return Frames(directions, nominal, peak, growth, off, along)


def _off_the_tangent(
    reference: Reference, along: Float[np.ndarray, " S"]
) -> Float[np.ndarray, " S"]:
    """Bound on D of every sample: distances of points along the tangent from the path.

    Samples beyond the control steps may lie beyond an open contour, straight on.
    """
    shares = np.linspace(-1.0, 1.0, SPACINGS + 1)
    lengths = along[:, None] * shares
    arc, tangent = np.asarray(reference.arc), np.asarray(reference.tangent)
    points = np.asarray(reference.position)[:, None] + lengths[..., None] * tangent[:, None]
    places = arc[:, None] + lengths
    foot = reference.contour.nearest(points, places, 2 * along[:, None])
    distance = np.linalg.norm(points - np.asarray(reference.contour.position(foot)), axis=-1)
    straight = np.linalg.norm(points - np.asarray(reference.contour.position(places)), axis=-1)
    distance[reference.steps :] = np.minimum(distance, straight)[reference.steps :]
    return distance.max(axis=1) + along / SPACINGS
