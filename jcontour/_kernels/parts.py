"""Functions that the kernels share: readings of memory, the inverse root, the nearest point."""

# The language of a kernel is not quite Python: a number that changes is made by its type.
# ruff: noqa: UP018
# pyright: reportArgumentType=false, reportOperatorIssue=false, reportRedeclaration=false
# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportReturnType=false

from functools import lru_cache
from typing import Any

import warp as wp

BLOCK = 64  # threads; a kernel is compiled anew for every other number
# vectors of which a run sums the squares of the norms and keeps the largest, in their order
VECTORS = ("contour_error", "projected_error", "tracking_error", "control", "increment")
NORMS = len(VECTORS)
# options of a kernel whose registers are spilled to memory that the threads of a block share
IN_SHARED: dict[str, Any] = {
    "enable_backward": False,
    "module": "unique",
    "enable_cuda_smem_spilling": True,
    "launch_bounds": BLOCK,
}


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    double y = (double)rsqrtf((float)s);
    y = y * (1.5 - 0.5 * s * y * y);
    return y * (1.5 - 0.5 * s * y * y);
#else
    return 1.0 / sqrt(s);
#endif
""")
def inverse_root(s: wp.float64) -> wp.float64:
    """Inverse of a square root, without a branch on a GPU."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return rsqrtf(s);
#else
    return 1.0f / sqrt(s);
#endif
""")
def inverse_root(s: wp.float32) -> wp.float32:  # noqa: F811
    """Inverse of a square root."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("" ::: "memory");
#endif
""")
def fence():
    """Point that no reading of memory moves across."""
    ...


@wp.func_native("return numbers.data[first + k];")
def at(numbers: wp.array(dtype=wp.float64), first: wp.int64, k: int) -> wp.float64:
    """A number, without a multiplication by a stride: `k` is a constant of the instruction."""
    ...


@wp.func_native("return numbers.data[first + k];")
def at(numbers: wp.array(dtype=wp.float32), first: wp.int64, k: int) -> wp.float32:  # noqa: F811
    """A number, without a multiplication by a stride: `k` is a constant of the instruction."""
    ...


@lru_cache
def contour_scores(m: int, real) -> wp.Function:
    """Function of m axes: vectors from the contour and from the tangent of a sample."""
    Point = wp.types.vector(length=m, dtype=real)
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))

    @wp.func(inline=True)
    def of_piece(pieces: Rows, k: int, first: int) -> Point:
        p = Point()
        for a in range(m):
            p[a] = pieces[k, first + a]
        return p

    @wp.func(inline=True)
    def from_piece(pieces: Rows, k: int, p: Point, low: real, high: real) -> Point:
        """Vector from the nearest point of an interval of a line or an arc."""
        offset, slope = p - of_piece(pieces, k, 0), of_piece(pieces, k, m)
        cosine, sine = of_piece(pieces, k, 2 * m), of_piece(pieces, k, 3 * m)
        rate = pieces[k, 4 * m]
        if rate > real(0.0):
            along, across = wp.dot(offset, cosine), wp.dot(offset, sine)
            radius = real(1.0) / rate
            s = wp.atan2(across, along) * radius
            turns = (real(0.5) * (low + high) - s) * (rate * real(0.5 / wp.PI))
            s += real(wp.TAU) * radius * wp.floor(turns + real(0.5))
            square = along * along + across * across
            if s >= low and s <= high and square > real(0.0):  # no need of the angle
                size = inverse_root(square)
                return offset - slope * s - cosine * (along * size) - sine * (across * size)
            s = wp.clamp(s, low, high)
            return offset - slope * s - cosine * wp.cos(rate * s) - sine * wp.sin(rate * s)
        return offset - slope * wp.clamp(wp.dot(offset, slope), low, high)

    @wp.func
    def from_contour(pieces: Rows, whole: Row, p: Point, e: Point, arc: real) -> Point:
        """Vector from the nearest point around an arc length, as `metrics.contour_error` seeks."""
        distance, length = wp.length(e), whole[0]
        reach = real(0.0)  # a diverged sample is not worth a search
        if distance <= whole[1]:
            reach = real(wp.PI) * distance
        begin, end = arc - reach, arc + reach
        lap = real(0.0)  # arc length in front of the piece's lap
        if whole[2] > real(0.0):
            reach = wp.min(reach, real(0.5) * length)
            begin, end = arc - reach, arc + reach
            lap = length * wp.floor(begin / length)
        else:
            begin, end = wp.clamp(begin, real(0.0), length), wp.clamp(end, real(0.0), length)
        count = int(whole[3])
        k = int(0)
        while k + 1 < count and pieces[k + 1, 4 * m + 1] + lap <= begin:
            k += 1
        start, extent = pieces[k, 4 * m + 1] + lap, pieces[k, 4 * m + 2]
        low = begin - start
        best = from_piece(pieces, k, p, low, wp.max(low, wp.min(end - start, extent)))
        while pieces[k, 4 * m + 1] + pieces[k, 4 * m + 2] + lap < end:
            k += 1
            if k == count:
                k = int(0)
                lap += length
            high = wp.min(end - lap - pieces[k, 4 * m + 1], pieces[k, 4 * m + 2])
            other = from_piece(pieces, k, p, real(0.0), high)
            if wp.length_sq(other) < wp.length_sq(best):
                best = other
        return best

    @wp.func(inline=True)
    def scores(pieces: Rows, whole: Row, y: Point, error: Point, tangent: Point, arc: real):
        """Vectors from the nearest point of the contour, and from the tangent."""
        return from_contour(pieces, whole, y, error, arc), error - tangent * wp.dot(error, tangent)

    return scores
