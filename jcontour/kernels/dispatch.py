"""Choice of the kernels for a platform and a problem; light to import.

A CPU therefore never loads the GPU's kernels.
"""

import math

import numpy as np

from jcontour.devices import number_size, on_gpu
from jcontour.geometry.contour import Contour
from jcontour.linear.plant import Pattern, decoupled_axes
from jcontour.tracing import is_concrete

# of one stage, unrolled: 8 coupled states; beyond, the derivative takes minutes to compile
MOST_MULTIPLICATIONS = 1500
# for the cost to go: 9 states in float64, 13 in float32; a lane with more spills, and XLA's sweep
# is faster
MOST_REGISTERS = 110
# of A, B and C: 16 states in two axes; the closed loop reads them at every step
MOST_NON_ZEROS = 160
LONGEST_SYSTEM = 10  # samples of a window: half a minute to compile, a minute for 12
WIDEST_AXIS = 8  # states: its constant part has as many numbers per sample
# [samples] below, the plain sweep is faster (on a CPU: N_p = 55 forward and 150 backward). Lanes
# are faster up to 1700, but their derivative keeps numbers for every sample that a step sees.
SHORTEST_WINDOW = {"cpu": 80, "gpu": 150, "lanes": 500}
# blocks side by side on a CPU: their matrices stay in a core's second-level cache
LONGEST_ROW = 100


def suits_lanes(pattern: Pattern, *arrays) -> bool:
    """Whether the GPU kernels take a plant and numbers of these types.

    The sweep in XLA takes all.
    """
    size = number_size(arrays)
    if not on_gpu() or size is None:
        return False
    n = len(pattern.A)
    registers = (n * (n + 1) // 2 + n) * size // 4
    return registers <= MOST_REGISTERS and multiplications(pattern) <= MOST_MULTIPLICATIONS


def suits_loop(pattern: Pattern, *arrays) -> bool:
    """Whether the GPU's kernel of the closed loop takes a plant and numbers of these types."""
    non_zeros = sum(sum(map(sum, matrix)) for matrix in pattern)
    return on_gpu() and number_size(arrays) is not None and non_zeros <= MOST_NON_ZEROS


def suits_metrics(contour: Contour, *arrays) -> bool:
    """Whether `metric_lanes` takes a contour and numbers of these types.

    It has to be of lines and arcs alone; the nearest point of others takes Newton's steps.
    """
    return on_gpu() and not contour.newton_steps and number_size(arrays) is not None


def suits_rank_one(pattern: Pattern, preview: int, *arrays) -> bool:
    """Whether `rank_one_lanes` takes a plant and a window, and is faster than a sweep.

    The axes have to be decoupled, with one output each, and the plant too large for `suits_lanes`.
    """
    axes = decoupled_axes(pattern)
    if not on_gpu() or number_size(arrays) is None or suits_lanes(pattern, *arrays):
        return False
    if preview > LONGEST_SYSTEM:
        return False
    if any(len(axis.outputs) != 1 or len(axis.states) > WIDEST_AXIS for axis in axes):
        return False
    return rank_one_multiplications(pattern, preview) < preview * multiplications(pattern)


def rank_one_multiplications(pattern: Pattern, preview: int) -> int:
    """Multiplications of one step of `rank_one_lanes`.

    They are those of the system, its elimination, its solutions, the errors and the gains.
    """
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    triangle = preview * (preview + 1) // 2
    return triangle * (4 * m + preview // 3 + 2 * p) + preview * p * (n + m)


def multiplications(pattern: Pattern) -> int:
    """Multiplications of one Riccati stage over the non-zeros of A and B.

    They are those of H B, H - H B L, P A and A' (P A).
    """
    n, p = len(pattern.A), len(pattern.B[0])
    of_A, of_B = (sum(map(sum, matrix)) for matrix in (pattern.A, pattern.B))
    return of_B * n + n * (n + 1) // 2 * p + of_A * n + of_A * n // 2


def suits_spans(stage, lanes: bool = False) -> bool:
    """Whether `sliding_window` suits a stage profile: long enough, and known to be uniform.

    Args:
        stage: profile over the window.
        lanes: whether the plain sweep would be the GPU's kernels.

    A profile that falls geometrically would need R to fall with it: spans are alike up to a scale
    of J against C only as long as that scale is the same at every sample, and the ratio of Q to R
    is not.
    """
    shortest = SHORTEST_WINDOW["lanes" if lanes else "gpu" if on_gpu() else "cpu"]
    return (
        len(stage) >= shortest
        and is_concrete(stage)
        and bool(np.all(np.asarray(stage) == np.asarray(stage)[0]))
    )


def block_length(window: int, steps: int) -> int:
    """Samples of a block: many small ones for a GPU; on a CPU no more than its cache holds."""
    side_by_side = 1 if on_gpu() else -(-steps // LONGEST_ROW)
    return min(window, max(2 * math.isqrt(window), side_by_side))
