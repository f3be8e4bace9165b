"""Arrays as short words: a value with its unit, or its range, or its shape while it is traced."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

WHOLE = (np.ndarray, np.generic, jax.Array, float, int)


def told(value: Any, unit: str = "", scale: float = 1.0) -> str:
    """A value in words: one number with its unit, or the ends of an array.

    Where there is no value, as under `jit`, it is the type and the shape.

    >>> told(np.array(3.1e-7), "um", 1e6), told(np.array([1.0, 2.0]), "s")
    ('0.31 um', '1 to 2 s')

    Args:
        value: number or array.
        unit: that it is told in.
        scale: of one SI unit in that unit.
    """
    if isinstance(value, Tracer) or not isinstance(value, WHOLE):
        return eqx.tree_pformat(value)
    numbers = scale * np.asarray(value)
    if numbers.size == 0:
        return "none"
    ends = dict.fromkeys(f"{one:.4g}" for one in (numbers.min(), numbers.max()))
    return f"{' to '.join(ends)} {unit}".strip()


def shape(value: Any) -> str:
    """Shape of an array; what else it is where it has none.

    >>> shape(np.zeros((3, 2)))
    '(3, 2)'
    """
    return str(tuple(value.shape)) if hasattr(value, "shape") else eqx.tree_pformat(value)
