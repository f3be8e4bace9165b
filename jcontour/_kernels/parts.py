"""Functions that the kernels share: reads of memory, the inverse root, the scores of a sample."""

# The language of a kernel is not quite Python: a number that changes is made by its type.
# ruff: noqa: UP018
# pyright: reportArgumentType=false, reportOperatorIssue=false, reportRedeclaration=false
# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportReturnType=false

from functools import lru_cache
from types import SimpleNamespace
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
def nearest_point(m: int, real) -> wp.Function:
    """Function of m axes: vector from the nearest point of a contour of lines and arcs."""
    Point = wp.types.vector(length=m, dtype=real)
    Rows = wp.array(dtype=real, ndim=2)

    @wp.func(inline=True)
    def entries(contour: Rows, k: int, first: int) -> Point:
        p = Point()
        for a in range(m):
            p[a] = contour[k, first + a]
        return p

    @wp.func(inline=True)
    def from_piece(contour: Rows, k: int, p: Point, low: real, high: real) -> Point:
        """Vector from the nearest point of an interval of a line or an arc."""
        offset, slope = p - entries(contour, k, 0), entries(contour, k, m)
        cosine, sine = entries(contour, k, 2 * m), entries(contour, k, 3 * m)
        rate = contour[k, 4 * m]
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
    def from_contour(contour: Rows, p: Point, e: Point, arc: real) -> Point:
        """Vector from the nearest point around an arc length, as `metrics.contour_error` seeks."""
        distance, length = wp.length(e), contour[0, 0]
        reach = real(0.0)  # a diverged sample is not worth a search
        if distance <= contour[0, 1]:
            reach = real(wp.PI) * distance
        begin, end = arc - reach, arc + reach
        lap = real(0.0)  # arc length in front of the piece's lap
        if contour[0, 2] > real(0.0):
            reach = wp.min(reach, real(0.5) * length)
            begin, end = arc - reach, arc + reach
            lap = length * wp.floor(begin / length)
        else:
            begin, end = wp.clamp(begin, real(0.0), length), wp.clamp(end, real(0.0), length)
        count = int(contour[0, 3])
        k = int(1)
        while k < count and contour[k + 1, 4 * m + 1] + lap <= begin:
            k += 1
        start, extent = contour[k, 4 * m + 1] + lap, contour[k, 4 * m + 2]
        low = begin - start
        best = from_piece(contour, k, p, low, wp.max(low, wp.min(end - start, extent)))
        while contour[k, 4 * m + 1] + contour[k, 4 * m + 2] + lap < end:
            k += 1
            if k > count:
                k = int(1)
                lap += length
            high = wp.min(end - lap - contour[k, 4 * m + 1], contour[k, 4 * m + 2])
            other = from_piece(contour, k, p, real(0.0), high)
            if wp.length_sq(other) < wp.length_sq(best):
                best = other
        return best

    return from_contour


@lru_cache
def scoring(m: int, p: int, real) -> SimpleNamespace:
    """Functions that score a sample of a run of m axes and p inputs.

    A row of `path` is a sample: tangent (m), desired position (m), arc length, and whether it is
    scored. The first row of `contour` is its length, its size, whether it is closed, and its number
    of pieces; the others are the pieces.
    """
    Point, Input, Sums = (wp.types.vector(length=k, dtype=real) for k in (m, p, NORMS))
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))
    from_contour, columns = nearest_point(m, real), 2 * m + 2

    @wp.struct
    class Vectors:  # `VECTORS` of a sample, or their derivatives
        offset: Point
        across: Point
        error: Point
        control: Input
        increment: Input

    @wp.func(inline=True)
    def samples(path: Row) -> int:
        return path.shape[0] // columns

    @wp.func(inline=True)
    def scored(path: Row, k: int) -> bool:
        return k >= 0 and path[wp.max(k, 0) * columns + columns - 1] != real(0.0)

    @wp.func(inline=True)
    def point(path: Row, first: int) -> Point:
        q = Point()
        for a in range(m):
            q[a] = path[first + a]
        return q

    @wp.func(inline=True)
    def vectors(contour: Rows, path: Row, k: int, y: Point, u: Input, last: Input) -> Vectors:
        """Errors of an output, and a control and its increment: 0 where the last is not scored."""
        v, first = Vectors(), k * columns
        tangent = point(path, first)
        v.error = y - point(path, first + m)
        v.offset = from_contour(contour, y, v.error, path[first + 2 * m])
        v.across = v.error - tangent * wp.dot(v.error, tangent)
        v.control = u
        if scored(path, k - 1):
            v.increment = u - last
        return v

    @wp.func(inline=True)
    def tangents(path: Row, k: int, y: Point, u: Input, last: Input) -> Vectors:
        """Derivatives of vectors whose scalar products with the vectors are taken."""
        v = Vectors()
        v.offset = y
        v.across = y
        v.error = y
        v.control = u
        if scored(path, k - 1):
            v.increment = u - last
        return v

    @wp.func(inline=True)
    def products(v: Vectors, w: Vectors) -> Sums:
        s = Sums()
        s[0] = wp.dot(v.offset, w.offset)
        s[1] = wp.dot(v.across, w.across)
        s[2] = wp.dot(v.error, w.error)
        s[3] = wp.dot(v.control, w.control)
        s[4] = wp.dot(v.increment, w.increment)
        return s

    @wp.func(inline=True)
    def diverged(contour: Rows, squares: Sums) -> bool:
        largest = contour[0, 1] * contour[0, 1]
        return not (squares[2] <= largest) or not wp.isfinite(squares[3])

    return SimpleNamespace(
        samples=samples, scored=scored, vectors=vectors, tangents=tangents, products=products,
        diverged=diverged,
    )  # fmt: skip
