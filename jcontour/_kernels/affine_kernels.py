"""Gains of a receding horizon, a thread for every step of every run; and runs under such gains.

`gains` is the sweep of `riccati.receding_horizon` with the output terminal, for any linear machine.
With Y = L^-1 (B' H A, B' g) and L L' = B' H B + R a stage back is

    H_j = A' H A - Y_x' Y_x + C' Q_j C,   g_j = A' g - Y_x' y_g - C' Q_j y_d(k+j)
    F = L'^-1 Y_x,   f = -L'^-1 y_g
"""

# The language of a kernel is not quite Python: a number that changes is made by its type.
# ruff: noqa: UP018
# pyright: reportArgumentType=false, reportOperatorIssue=false, reportRedeclaration=false
# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportReturnType=false

from functools import lru_cache
from typing import NamedTuple

import warp as wp

from jcontour._kernels.parts import IN_SHARED, NORMS, at, contour_scores, fence, inverse_root


class AffineKernels(NamedTuple):
    """Gains of every step, and a run under gains."""

    gains: wp.Kernel
    run: wp.Kernel


@lru_cache
def affine_kernels(n: int, p: int, m: int, real) -> AffineKernels:
    """Kernels for n states, p inputs and m axes.

    Arrays of a run have the runs behind. K holds rows (F, f) of u = f - F x, step by step.
    """
    Point, State, Input = (wp.types.vector(length=k, dtype=real) for k in (m, n, p))
    Triangle = wp.types.vector(length=n * (n + 1) // 2, dtype=real)
    Square = wp.types.vector(length=p * (p + 1) // 2, dtype=real)
    Gain = wp.types.vector(length=p * (n + 1), dtype=real)
    Sums = wp.types.vector(length=NORMS, dtype=real)
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))
    scores = contour_scores(m, real)

    @wp.func(inline=True)
    def number(row: Row, k: int) -> real:
        return at(row, wp.int64(0), k)

    @wp.func(inline=True)
    def weighed(
        H: Triangle, g: State, C: Row, Q: Rows, y_d: Row, scale: real, sample: int, own: int
    ):
        """Cost to go with the output error of a sample."""
        for a in range(m):
            for b in range(m):
                weight = scale * Q[(sample * m + a) * m + b, own]
                aimed = weight * y_d[sample * m + b]
                for i in range(n):
                    g[i] -= number(C, a * n + i) * aimed
                    row = number(C, a * n + i) * weight
                    for j in range(i + 1):
                        H[i * (i + 1) // 2 + j] += row * number(C, b * n + j)
        return H, g

    @wp.func(inline=True)
    def times(H: Triangle, x: State) -> State:
        """Product H x."""
        y = State()
        for i in range(n):
            for j in range(i):
                y[i] += H[i * (i + 1) // 2 + j] * x[j]
                y[j] += H[i * (i + 1) // 2 + j] * x[i]
            y[i] += H[i * (i + 1) // 2 + i] * x[i]
        return y

    @wp.func(inline=True)
    def column(M: Row, columns: int, k: int) -> State:
        x = State()
        for i in range(n):
            x[i] = number(M, i * columns + k)
        return x

    @wp.func(inline=True)
    def lower(L: Square, y: Input) -> Input:
        """Product L^-1 y."""
        for u in range(p):
            for w in range(u):
                y[u] -= L[u * (u + 1) // 2 + w] * y[w]
            y[u] *= L[u * (u + 1) // 2 + u]
        return y

    @wp.func(inline=True)
    def forced(H: Triangle, g: State, A: Row, B: Row, R: Rows, own: int):
        """Factor L, its pivots inverted, and Y."""
        L, Y, now = Square(), Gain(), Input()
        HB = wp.matrix(shape=(p, n), dtype=real)
        for u in range(p):
            b = column(B, p, u)
            HB[u] = times(H, b)
            now[u] = wp.dot(b, g)
            for w in range(u + 1):
                s = wp.dot(HB[w], b) + R[u * p + w, own]
                for q in range(w):
                    s -= L[u * (u + 1) // 2 + q] * L[w * (w + 1) // 2 + q]
                if w < u:
                    L[u * (u + 1) // 2 + w] = s * L[w * (w + 1) // 2 + w]
                else:
                    L[u * (u + 1) // 2 + u] = inverse_root(s)
        now = lower(L, now)
        for u in range(p):
            Y[u * (n + 1) + n] = now[u]
        for c in range(n):
            x = column(A, n, c)
            for u in range(p):
                now[u] = wp.dot(HB[u], x)
            now = lower(L, now)
            for u in range(p):
                Y[u * (n + 1) + c] = now[u]
        return L, Y

    @wp.kernel(**IN_SHARED)
    def gains(A: Row, B: Row, C: Row, y_d: Row, Q: Rows, stage: Rows, R: Rows, K: Rows):
        k, own = wp.tid()
        N = stage.shape[0]
        H, g = weighed(Triangle(), State(), C, Q, y_d, stage[N - 1, own], k + N, own)
        for back in range(N - 1):
            fence()
            _, Y = forced(H, g, A, B, R, own)
            fence()
            new, ahead = Triangle(), State()
            for c in range(n):
                x = column(A, n, c)
                ahead[c] = wp.dot(x, g)
                moved = times(H, x)
                for i in range(c + 1):
                    for q in range(n):
                        new[c * (c + 1) // 2 + i] += number(A, q * n + i) * moved[q]
                for u in range(p):
                    ahead[c] -= Y[u * (n + 1) + c] * Y[u * (n + 1) + n]
                    for i in range(c + 1):
                        new[c * (c + 1) // 2 + i] -= Y[u * (n + 1) + c] * Y[u * (n + 1) + i]
            j = N - 1 - back
            H, g = weighed(new, ahead, C, Q, y_d, stage[j - 1, own], k + j, own)
        L, Y = forced(H, g, A, B, R, own)
        for c in range(n + 1):
            for v in range(p):
                u = p - 1 - v
                s = Y[u * (n + 1) + c]
                for w in range(u + 1, p):
                    s -= L[w * (w + 1) // 2 + u] * Y[w * (n + 1) + c]
                Y[u * (n + 1) + c] = s * L[u * (u + 1) // 2 + u]
        for u in range(p):
            Y[u * (n + 1) + n] = -Y[u * (n + 1) + n]
        for i in range(p * (n + 1)):
            K[k * wp.static(p * (n + 1)) + i, own] = Y[i]

    @wp.func(inline=True)
    def gain(K: Rows, k: int, own: int) -> Gain:
        from_memory = Gain()
        for i in range(p * (n + 1)):
            from_memory[i] = K[k * wp.static(p * (n + 1)) + i, own]
        return from_memory

    @wp.func(inline=True)
    def sample(rows: Row, k: int) -> Point:
        point = Point()
        for a in range(m):
            point[a] = rows[k * m + a]
        return point

    @wp.kernel(**IN_SHARED)
    def run(
        A: Row, B: Row, C: Row, r: Row, y_d: Row, arc: Row, scored: wp.array(dtype=int),
        start: Row, pieces: Rows, whole: Row, K: Rows,
        out: Rows,  # (2 NORMS + 1, runs): sums, peaks, whether it diverged
    ):  # fmt: skip
        own = wp.tid()
        x, last, before = State(), Input(), int(0)
        for i in range(n):
            x[i] = start[i]
        sums, peaks, lost = Sums(), Sums(), real(0.0)
        ahead = gain(K, 0, own)
        for k in range(scored.shape[0]):
            fence()
            now = ahead
            ahead = gain(K, wp.min(k + 1, scored.shape[0] - 1), own)  # read before it is needed
            y, u = Point(), Input()
            for a in range(m):
                for q in range(n):
                    y[a] += number(C, a * n + q) * x[q]
            for v in range(p):
                u[v] = now[v * (n + 1) + n]
                for q in range(n):
                    u[v] -= now[v * (n + 1) + q] * x[q]
            if scored[k] != 0:
                error = y - sample(y_d, k)
                offset, across = scores(pieces, whole, y, error, sample(r, k), arc[k])
                squares = Sums()
                squares[0] = wp.length_sq(offset)
                squares[1] = wp.length_sq(across)
                squares[2] = wp.length_sq(error)
                squares[3] = wp.length_sq(u)
                if before != 0:
                    squares[4] = wp.length_sq(u - last)
                sums += squares
                peaks = wp.max(peaks, squares)
                if not (squares[2] <= whole[1] * whole[1]) or not wp.isfinite(squares[3]):
                    lost = real(1.0)
            last = u
            before = int(scored[k])
            new = State()
            for i in range(n):
                for v in range(p):
                    new[i] += number(B, i * p + v) * u[v]
                for q in range(n):
                    new[i] += number(A, i * n + q) * x[q]
            x = new
        for i in range(NORMS):
            out[i, own] = sums[i]
            out[NORMS + i, own] = peaks[i]
        out[2 * NORMS, own] = lost

    return AffineKernels(gains, run)
