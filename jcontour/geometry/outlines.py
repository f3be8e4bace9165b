"""Points of a whole contour, for its figure and its bounding box."""

import numpy as np
from jaxtyping import Float

from jcontour.geometry.contour import Contour

POINTS = 2000  # of a contour at least
PARTS = 16  # of every piece at least


def outline(contour: Contour) -> Float[np.ndarray, "K m"]:
    """Points along a single contour [m], in order: the ends of all pieces, and points between.

    The extreme points of circular arcs, and of helices across their axis, are among them.
    """
    pieces = contour.pieces
    cosine, sine, rate, start, extent = (
        np.asarray(rows, float)[np.asarray(contour.mask)] for rows in pieces[1:]
    )
    parts = max(PARTS, -(-POINTS // len(start)))
    arc = start[:, None] + extent[:, None] * np.linspace(0.0, 1.0, parts + 1)
    along = _turning(cosine, sine, rate, extent)
    extreme = (start[:, None, None] + along)[np.isfinite(along)]
    whole = np.unique(np.append(arc, extreme))
    # the end of a closed path would be its start
    return np.asarray(contour.position(np.minimum(whole, np.nextafter(whole[-1], 0.0))))


def _turning(
    cosine: Float[np.ndarray, "P m"],
    sine: Float[np.ndarray, "P m"],
    rate: Float[np.ndarray, " P"],
    extent: Float[np.ndarray, " P"],
) -> Float[np.ndarray, "P m 2"]:
    """Where the wave of every piece is largest and least in every axis [m]; NaN where it is not.

    The wave is c cos(rate s) + d sin(rate s); its extremes are at rate s = atan2(d, c) + k pi.
    """
    angle = np.sign(rate)[:, None, None] * np.arctan2(sine, cosine)[..., None]
    turn = np.abs(rate)[:, None, None]
    waves = turn > 0
    along = np.mod(angle + [0.0, np.pi], 2 * np.pi) / np.where(waves, turn, 1.0)
    inside = waves & (along <= extent[:, None, None])
    return np.where(inside, along, np.nan)
