"""Numbers of a lane by name, how many, and the answer that is made of them."""

from collections.abc import Mapping
from typing import NamedTuple

from jaxtyping import Array

from jcontour.qp.lanes.kernel import Sizes
from jcontour.qp.one_sided import Point
from jcontour.qp.staged import StagedQP, Trajectory

NAMES = (*StagedQP._fields, "guess")
RESULTS = "s", "l", "t", "g", "iterations", "stages", "end", "residual", "beyond"


class Found(NamedTuple):
    """Last point of the path, iterations, and the trajectory of its controls with residuals."""

    point: Point
    iterations: Array
    residual: Array
    beyond: Array

    @classmethod
    def of(cls, sizes: Sizes, numbers: Mapping[str, Array]) -> "Found":
        """Answer from the numbers of a lane, flat."""
        N, _, _, r = sizes
        at = Trajectory(numbers["stages"].reshape(N, sizes.v), numbers["end"])
        limits = (numbers[name].reshape(2, N, r) for name in "sltg")
        iterations = numbers["iterations"][0].astype(int)
        return cls(Point(at, *limits), iterations, numbers["residual"][0], numbers["beyond"][0])


def rows_of(sizes: Sizes) -> dict[str, int]:
    """Numbers of a lane in every array that the iterations change."""
    N, n, p, r = sizes
    v, limits = n + p, ("s", "l", "t", "g", "ds", "dl", "dt", "dg")
    single = "gap", "count", "largest", "before", "iterations", "open", "target", "share"
    single = *single, "far", "ahead", "good", "residual", "beyond"
    return {
        **dict.fromkeys(("stages", "slope", "right", "step"), N * v),
        **dict.fromkeys(("end", "slope_end", "step_end"), n),
        **dict.fromkeys(limits, 2 * N * r),
        **dict.fromkeys(("value", "weight", "moves"), N * r),
        "Y": N * p * n,
        "y": N * p,
        "R": N * p * (p + 1) // 2,
        **dict.fromkeys(single, 1),
    }


def problem_rows(sizes: Sizes) -> dict[str, int]:
    """Numbers of a lane in every array of the problem; of symmetric matrices the lower triangle."""
    N, n, p, r = sizes
    v = sizes.v
    return {
        "A": n * n,
        "B": n * p,
        "c": N * n,
        "x0": n,
        "H": N * (v * (v + 1) // 2),
        "h": N * v,
        "H_end": n * (n + 1) // 2,
        "h_end": n,
        "D": r * v,
        "lower": N * r,
        "upper": N * r,
        "penalty": r,
        "guess": N * p,
    }
