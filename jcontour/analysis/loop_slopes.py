"""Slopes of frozen loops: a change of any matrix, through a state and its weights. Host side."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex

from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine
from jcontour.analysis.spectral import real_outer, times


class Ends(NamedTuple):
    """Where a disturbance comes into a loop, and what of its answer counts, by weights.

    Attributes:
        control: added to the control.
        reading: added to what the controller reads.
        of_control: weights of the control.
        of_reading: weights of what the sensors show.
    """

    control: Complex[np.ndarray, "*loops p"]
    reading: Complex[np.ndarray, "*loops q"]
    of_control: Complex[np.ndarray, "*loops p"]
    of_reading: Complex[np.ndarray, "*loops q"]


NO_ENDS = Ends(*[np.zeros(())] * 4)


def slope_of(loop: FrozenLoop, left, right, ends: Ends = NO_ENDS) -> FrozenLoop:
    """Derivative of Re(left' M right), ends included, with respect to the matrices of the loop.

    x and w are the states that `right` stands for, y what the controller reads and u the control
    then. of_x, ... are the weights of their changes, as far as `left` stands for them.
    """
    (A, B, H), (_, E, K, D) = loop
    n = A.shape[-1]
    x, w, of_x, of_w = right[..., :n], right[..., n:], left[..., :n], left[..., n:]
    y = times(H, x) + ends.reading
    u = times(D, y) + times(K, w) + ends.control
    of_u = times(turned(B), of_x) + ends.of_control
    of_y = times(turned(D), of_u) + times(turned(E), of_w) + ends.of_reading
    return FrozenLoop(
        LinearMachine(real_outer(of_x, x), real_outer(of_x, u), real_outer(of_y, x)),
        LinearLaw(
            real_outer(of_w, w), real_outer(of_w, y), real_outer(of_u, w), real_outer(of_u, y)
        ),
    )


def turned(matrix: Any) -> np.ndarray:
    """The transpose of the last two axes."""
    return np.swapaxes(matrix, -1, -2)
