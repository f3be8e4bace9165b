"""The two passes of a time-optimal feed over nodes in the phase plane (Bobrow et al. 1985).

Between node i and the next one the square q of the speed is held by rows r:

    q_i     <= per_end_r q_i+1 + at_rest_r       so that the rest can be mastered
    q_i+1   <= q_i + gain_r - loss_r q_i         what is reached from q_i
"""

import numpy as np

from jcontour._compiled import compiled


@compiled
def sweep(rows: np.ndarray, square: np.ndarray) -> None:
    """Lower the squares at the nodes, in place: backwards by the first rule, forwards by the other.

    Args:
        rows: (4, n, R) of `per_end`, `at_rest`, `gain` and `loss` [1, m^2/s^2, m^2/s^2, 1].
        square: (n+1,) greatest squares of the speed [m^2/s^2].
    """
    steps, count = rows.shape[1], rows.shape[2]
    for i in range(steps - 1, -1, -1):
        for r in range(count):
            most = rows[0, i, r] * square[i + 1] + rows[1, i, r]
            square[i] = most if most < square[i] else square[i]
    for i in range(steps):
        reached = square[i]
        for r in range(count):
            most = reached + (rows[2, i, r] - rows[3, i, r] * reached)
            square[i + 1] = most if most < square[i + 1] else square[i + 1]
