"""Coordinates, lengths and angles as users give them, checked on the host.

Each function returns NumPy's float64, or raises a `ValueError` that says in one line whose input
is wrong, what is needed, and what came.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

Numbers = ArrayLike | Sequence[Any]  # what NumPy makes an array of, nested lists for instance

PLANE_OR_SPACE, ANY_AXES = (2, 3), (1, 2, 3)  # numbers of axes
# lengths [m] and angles [rad] lie between: their squares neither vanish nor overflow
SMALLEST, LARGEST = 1e-100, 1e100


def distinct_points(
    name: str, points: Numbers, least: int, axes: tuple[int, ...] = PLANE_OR_SPACE
) -> Float[np.ndarray, "n m"]:
    """Points (n, m) [m] without those that repeat the one before."""
    points = finite(name, points)
    if points.ndim != 2 or points.shape[1] not in axes:
        wanted = " or ".join(f"(n, {m})" for m in axes)
        raise ValueError(f"{name}: needs points of shape {wanted}, received shape {points.shape}")
    # a step this short has no direction
    rounding = 4.0 * np.spacing(np.abs(points).max(initial=0.0))
    moved = np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > rounding)
    points = points[moved[: len(points)]]
    distinct = len(np.unique(points, axis=0))
    if distinct < least:
        raise ValueError(f"{name}: needs at least {least} distinct points, received {distinct}")
    return points


def vector(
    name: str, value: Numbers, axes: tuple[int, ...] = PLANE_OR_SPACE
) -> Float[np.ndarray, " m"]:
    """One point or direction (m,)."""
    value = finite(name, value)
    if value.ndim != 1 or value.size not in axes:
        wanted = " or ".join(f"({m},)" for m in axes)
        raise ValueError(f"{name}: needs shape {wanted}, received shape {value.shape}")
    return value


def number(name: str, value: Numbers) -> float:
    """One number."""
    scalar = finite(name, value)
    if scalar.ndim:
        raise ValueError(f"{name}: needs one number, received shape {scalar.shape}")
    return float(scalar)


def positive(name: str, value: Numbers) -> float:
    """One number above zero."""
    scalar = number(name, value)
    if scalar <= SMALLEST:
        raise ValueError(f"{name}: needs to be above zero, received {scalar}")
    return scalar


def finite(name: str, value: Numbers) -> Float[np.ndarray, "..."]:
    """Numbers in an array of any shape."""
    try:
        value = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: needs numbers in a regular array, received {value!r}") from None
    if not (np.abs(value) < LARGEST).all():
        raise ValueError(
            f"{name}: every entry needs to be finite (below {LARGEST:g}), received NaN, inf or more"
        )
    return value


def per_axis(
    name: str, value: Numbers, axes: int, infinite: bool = False
) -> Float[np.ndarray, " m"]:
    """One number above zero, or one for each axis; infinite ones where that is allowed."""
    value = np.asarray(value, float)
    good = (value > 0) & (np.isfinite(value) | infinite)
    if value.shape not in ((), (axes,)) or not good.all():
        raise ValueError(
            f"{name}: needs one number or one for each of the {axes} axes, finite and above zero, "
            f"received {value.tolist()}"
        )
    return np.broadcast_to(value, (axes,))


def per_piece(name: str, value: Numbers, count: int) -> Float[np.ndarray, " P"]:
    """One number above zero, or one for each of so many pieces."""
    value = np.asarray(value, float)
    if value.shape not in ((), (count,)):
        raise ValueError(
            f"{name}: needs one number or one for each of the {count} pieces, "
            f"received shape {value.shape}"
        )
    good = np.isfinite(value) & (value > 0)
    if not good.all():
        raise ValueError(
            f"{name}: needs to be finite and above zero on every piece, "
            f"received {value[~good].ravel()[0]} (rapid moves have none: give them one)"
        )
    return np.broadcast_to(value, (count,))
