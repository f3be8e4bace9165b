"""The receding-horizon LQ run and its slopes in Warp: one thread a run, gains never formed.

The algebra is that of `riccati.decoupled`. With f = beta / (alpha + beta), t = 1 - f, and the
errors of the window scaled by the root of the stage profile, a step solves

    S v = sum_a r_a (M_a e_a),   S_ij = 1_ij (t + f (1 - |r_i|^2)) + f sum_a r_ai M_aij r_aj
    eta_a = e_a - f r_a v,       u_a = -(kappa M_a h_a)' eta_a
The cost is homogeneous in (alpha, beta, rho): the slopes with log kappa and with f say all. From
kappa dM/dkappa = M M - M,

    kappa d/dkappa: S v' = r'M (e' + M eta - eta),    u' = -(kappa M h)' (M eta + e' - f r v')
          d/df:     S v' = r'M (e' - r v) + |r|^2 v,  u' = -(kappa M h)' (e' - r v - f r v')
with e' = O x', the slope of the free error.

M does not fit into registers, nor do the addresses of its numbers. A compiler keeps both if it can,
and spills them. So a run adds a zero from memory (`zero`) to the index of each reading.
"""

# The language of a kernel is not quite Python: a number that changes is made by its type.
# ruff: noqa: UP018
# pyright: reportArgumentType=false, reportOperatorIssue=false, reportRedeclaration=false

from functools import lru_cache
from typing import NamedTuple

import warp as wp

ROWS = 5  # squares: contour, projected, tracking, control, increment
LONGEST_WINDOW = 16  # samples: loops over more are not unrolled


class Kernels(NamedTuple):
    """Run, and run with slopes."""

    run: wp.Kernel
    slopes: wp.Kernel


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


@lru_cache
def kernels(m: int, n: int, N: int, real=wp.float64) -> Kernels:
    """Kernels for m axes of at most n states and a window of N samples.

    Arrays of a run: f and t (2, runs), the lower triangles of M (m T, runs), kappa M h (m N, runs),
    the roots of the profile (N, runs) or (0, 0). What all runs share: A (1, m, n, n), B, C (1, m,
    n), O (1, m, N, n), zeros (steps + 2,), tangents and desired positions (m, S),
    what the model's response at rest is above its position (m, N), the control there, arc lengths,
    what is scored (steps,), the first state (m, n), the pieces of the contour, and its length,
    size, closedness and number of pieces.
    """
    T = N * (N + 1) // 2  # numbers of a symmetric matrix, its lower triangle row by row
    Point, Window = (wp.types.vector(length=k, dtype=real) for k in (m, N))
    Triangle, States = (wp.types.vector(length=k, dtype=real) for k in (T, m * n))
    Windows, Triangles = (wp.types.vector(length=k, dtype=real) for k in (m * N, m * T))
    Sums, Slope = wp.types.vector(length=ROWS, dtype=real), wp.types.matrix((2, ROWS), real)
    Row, Rows, Cube, Tensor = (wp.array(dtype=real, ndim=k) for k in (1, 2, 3, 4))

    @wp.func(inline=True)
    def tangents(r: Rows, a: int, k: int) -> Window:
        w = Window()
        for i in range(N):
            w[i] = r[a, k + 1 + i]
        return w

    @wp.func(inline=True)
    def free(ahead: Tensor, scale: Rows, x: States, a: int, now: int, tid: int) -> Window:
        """Free outputs of an axis over the window, scaled."""
        e = Window()
        for i in range(N):
            for q in range(n):
                e[i] += ahead[now, a, i, q] * x[a * n + q]
            if scale.shape[0] > 0:
                e[i] *= scale[i, tid]
        return e

    @wp.func(inline=True)
    def desired(y_d: Rows, rest: Rows, scale: Rows, a: int, k: int, tid: int) -> Window:
        w = Window()
        for i in range(N):
            w[i] = y_d[a, k + 1 + i] + rest[a, i]
            if scale.shape[0] > 0:
                w[i] *= scale[i, tid]
        return w

    @wp.func(inline=True)
    def cholesky(S: Triangle) -> Triangle:
        """Lower factor, its pivots inverted."""
        L = Triangle()
        for i in range(N):
            for j in range(i + 1):
                s = S[i * (i + 1) // 2 + j]
                for k in range(j):
                    s -= L[i * (i + 1) // 2 + k] * L[j * (j + 1) // 2 + k]
                if j < i:
                    L[i * (i + 1) // 2 + j] = s * L[j * (j + 1) // 2 + j]
                else:
                    L[i * (i + 1) // 2 + i] = inverse_root(s)
        return L

    @wp.func(inline=True)
    def solved(L: Triangle, c: Window) -> Window:
        v = Window()
        for i in range(N):
            z = c[i]
            for k in range(i):
                z -= L[i * (i + 1) // 2 + k] * v[k]
            v[i] = z * L[i * (i + 1) // 2 + i]
        for k in range(N):
            i = N - 1 - k
            z = v[i]
            for j in range(i + 1, N):
                z -= L[j * (j + 1) // 2 + i] * v[j]
            v[i] = z * L[i * (i + 1) // 2 + i]
        return v

    @wp.func(inline=True)
    def paired(Mh: Rows, a: int, tid: int, e: Window) -> real:
        """Product (kappa M h)' e of an axis."""
        u = real(0.0)
        for i in range(N):
            u += Mh[a * N + i, tid] * e[i]
        return u

    @wp.func(inline=True)
    def moved(A: Tensor, B: Cube, x: States, u: Point, now: int) -> States:
        new = States()
        for a in range(m):
            for i in range(n):
                new[a * n + i] = B[now, a, i] * u[a]
                for q in range(n):
                    new[a * n + i] += A[now, a, i, q] * x[a * n + q]
        return new

    @wp.func(inline=True)
    def output(C: Cube, x: States, now: int) -> Point:
        y = Point()
        for a in range(m):
            for q in range(n):
                y[a] += C[now, a, q] * x[a * n + q]
        return y

    @wp.func(inline=True)
    def sample(rows: Rows, k: int) -> Point:
        p = Point()
        for a in range(m):
            p[a] = rows[a, k]
        return p

    @wp.func(inline=True)
    def sample_of(row: Row) -> Point:
        p = Point()
        for a in range(m):
            p[a] = row[a]
        return p

    @wp.func(inline=True)
    def begun(start: Rows) -> States:
        x = States()
        for a in range(m):
            for q in range(n):
                x[a * n + q] = start[a, q]
        return x

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
            s = wp.atan2(wp.dot(offset, sine), wp.dot(offset, cosine)) / rate
            lap = real(2.0) * real(wp.PI) / rate
            s += lap * wp.floor((real(0.5) * (low + high) - s) / lap + real(0.5))
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

    @wp.kernel(enable_backward=False, module="unique")
    def run(
        f: Rows, M: Rows, Mh: Rows, scale: Rows, A: Tensor, B: Cube, C: Cube, ahead: Tensor,
        zero: wp.array(dtype=int), r: Rows, y_d: Rows, rest: Rows, hold: Row, arc: Row,
        scored: wp.array(dtype=int), start: Rows, pieces: Rows, whole: Row,
        out: Rows,  # (2 ROWS + 1, runs): sums, peaks, whether it diverged
    ):  # fmt: skip
        own = wp.tid()
        forgiven, tracked = f[0, own], f[1, own]
        x, last, before = begun(start), Point(), int(0)
        sums, peaks, lost = Sums(), Sums(), real(0.0)
        for k in range(scored.shape[0]):
            now = zero[k]
            tid = own + now
            S, c, u = Triangle(), Window(), sample_of(hold)
            for i in range(N):
                lost_square = real(1.0)
                for a in range(m):
                    lost_square -= r[a, k + 1 + i] * r[a, k + 1 + i]
                S[i * (i + 1) // 2 + i] = tracked + forgiven * lost_square
            for a in range(m):
                R = tangents(r, a, k)
                e = free(ahead, scale, x, a, now, tid) - desired(y_d, rest, scale, a, k, tid)
                s = Window()
                for i in range(N):
                    for j in range(i):
                        entry = M[a * T + i * (i + 1) // 2 + j, tid]
                        s[i] += entry * e[j]
                        s[j] += entry * e[i]
                        S[i * (i + 1) // 2 + j] += forgiven * R[i] * R[j] * entry
                    entry = M[a * T + i * (i + 1) // 2 + i, tid]
                    s[i] += entry * e[i]
                    S[i * (i + 1) // 2 + i] += forgiven * R[i] * R[i] * entry
                for i in range(N):
                    c[i] += R[i] * s[i]
                u[a] -= paired(Mh, a, tid, e)
            v = solved(cholesky(S), c)
            tid = own + zero[k + 1]
            late = k + zero[k + 1]
            for a in range(m):
                u[a] += forgiven * paired(Mh, a, tid, wp.cw_mul(tangents(r, a, late), v))
            y, tangent = output(C, x, now), sample(r, k)
            error = y - sample(y_d, k)
            if scored[k] != 0:
                across = error - tangent * wp.dot(error, tangent)
                offset = from_contour(pieces, whole, y, error, arc[k])
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
            x = moved(A, B, x, u, now)
        for i in range(ROWS):
            out[i, own] = sums[i]
            out[ROWS + i, own] = peaks[i]
        out[2 * ROWS, own] = lost

    @wp.func(inline=True)
    def all_axes(rows: Rows, tid: int) -> Triangles:
        """M of all axes; the loop is longer than Warp unrolls, so that M lies in local memory."""
        M = Triangles()
        for k in range(m * T):
            M[k] = rows[k, tid]
        return M

    @wp.func(inline=True)
    def factored(M: Triangles, R: Windows, forgiven: real, tracked: real) -> Triangle:
        S = Triangle()
        for i in range(N):
            lost_square = real(1.0)
            for a in range(m):
                lost_square -= R[a * N + i] * R[a * N + i]
            S[i * (i + 1) // 2 + i] = tracked + forgiven * lost_square
            for j in range(i + 1):
                s = real(0.0)
                for a in range(m):
                    s += R[a * N + i] * R[a * N + j] * M[a * T + i * (i + 1) // 2 + j]
                S[i * (i + 1) // 2 + j] += forgiven * s
        return cholesky(S)

    @wp.func(inline=True)
    def times_all(M: Triangles, e: Windows) -> Windows:
        s = Windows()
        for a in range(m):
            for i in range(N):
                for j in range(i):
                    entry = M[a * T + i * (i + 1) // 2 + j]
                    s[a * N + i] += entry * e[a * N + j]
                    s[a * N + j] += entry * e[a * N + i]
                s[a * N + i] += M[a * T + i * (i + 1) // 2 + i] * e[a * N + i]
        return s

    @wp.func(inline=True)
    def free_all(ahead: Tensor, scale: Rows, x: States, now: int, tid: int) -> Windows:
        e = Windows()
        for a in range(m):
            w = free(ahead, scale, x, a, now, tid)
            for i in range(N):
                e[a * N + i] = w[i]
        return e

    @wp.func(inline=True)
    def desired_all(y_d: Rows, rest: Rows, scale: Rows, k: int, tid: int) -> Windows:
        e = Windows()
        for a in range(m):
            w = desired(y_d, rest, scale, a, k, tid)
            for i in range(N):
                e[a * N + i] = w[i]
        return e

    @wp.func(inline=True)
    def tangents_all(r: Rows, k: int) -> Windows:
        R = Windows()
        for a in range(m):
            for i in range(N):
                R[a * N + i] = r[a, k + 1 + i]
        return R

    @wp.func(inline=True)
    def along(R: Windows, s: Windows) -> Window:
        c = Window()
        for i in range(N):
            for a in range(m):
                c[i] += R[a * N + i] * s[a * N + i]
        return c

    @wp.func(inline=True)
    def spread(R: Windows, v: Window) -> Windows:
        w = Windows()
        for a in range(m):
            for i in range(N):
                w[a * N + i] = R[a * N + i] * v[i]
        return w

    @wp.func(inline=True)
    def command(Mh: Windows, e: Windows) -> Point:
        u = Point()
        for a in range(m):
            for i in range(N):
                u[a] -= Mh[a * N + i] * e[a * N + i]
        return u

    @wp.kernel(enable_backward=False, module="unique")
    def slopes(
        f: Rows, M_rows: Rows, Mh_rows: Rows, scale: Rows, A: Tensor, B: Cube, C: Cube,
        ahead: Tensor, zero: wp.array(dtype=int), r: Rows, y_d: Rows, rest: Rows, hold: Row,
        arc: Row, scored: wp.array(dtype=int), start: Rows, pieces: Rows, whole: Row,
        out: Rows, slope: Cube,  # (2, 2 ROWS, runs): of half of the sums and peaks
    ):  # fmt: skip
        """Both slopes of a run by one thread: with log kappa, and with f."""
        tid = wp.tid()
        forgiven, tracked = f[0, tid], f[1, tid]
        M, Mh = all_axes(M_rows, tid), Windows()
        for k in range(m * N):
            Mh[k] = Mh_rows[k, tid]
        x, x1, x2, before = begun(start), States(), States(), int(0)
        last, last1, last2 = Point(), Point(), Point()
        sums, peaks, lost, sum_slopes, peak_slopes = Sums(), Sums(), real(0.0), Slope(), Slope()
        for k in range(scored.shape[0]):
            now = zero[k]
            R = tangents_all(r, k)
            e = free_all(ahead, scale, x, now, tid) - desired_all(y_d, rest, scale, k, tid)
            e1 = free_all(ahead, scale, x1, now, tid)
            e2 = free_all(ahead, scale, x2, now, tid)
            L = factored(M, R, forgiven, tracked)
            s = times_all(M, e)
            lags = spread(R, solved(L, along(R, s)))
            p = times_all(M, lags)
            eta, M_eta = e - forgiven * lags, s - forgiven * p
            u = sample_of(hold) + command(Mh, eta)
            v1 = solved(L, along(R, times_all(M, e1 + M_eta - eta)))
            u1 = command(Mh, M_eta + e1 - forgiven * spread(R, v1))
            v2 = solved(L, along(R, times_all(M, e2) - p + lags))
            u2 = command(Mh, e2 - lags - forgiven * spread(R, v2))
            y, y1, y2 = output(C, x, now), output(C, x1, now), output(C, x2, now)
            tangent = sample(r, k)
            error = y - sample(y_d, k)
            if scored[k] != 0:
                across = error - tangent * wp.dot(error, tangent)
                offset = from_contour(pieces, whole, y, error, arc[k])
                squares, ds = Sums(), Slope()
                squares[0] = wp.length_sq(offset)
                squares[1] = wp.length_sq(across)
                squares[2] = wp.length_sq(error)
                squares[3] = wp.length_sq(u)
                ds[0, 0] = wp.dot(offset, y1)
                ds[1, 0] = wp.dot(offset, y2)
                ds[0, 1] = wp.dot(across, y1)
                ds[1, 1] = wp.dot(across, y2)
                ds[0, 2] = wp.dot(error, y1)
                ds[1, 2] = wp.dot(error, y2)
                ds[0, 3] = wp.dot(u, u1)
                ds[1, 3] = wp.dot(u, u2)
                if before != 0:
                    squares[4] = wp.length_sq(u - last)
                    ds[0, 4] = wp.dot(u - last, u1 - last1)
                    ds[1, 4] = wp.dot(u - last, u2 - last2)
                sums += squares
                sum_slopes += ds
                for i in range(ROWS):
                    if squares[i] > peaks[i]:
                        peaks[i] = squares[i]
                        peak_slopes[0, i] = ds[0, i]
                        peak_slopes[1, i] = ds[1, i]
                if not (squares[2] <= whole[1] * whole[1]) or not wp.isfinite(squares[3]):
                    lost = real(1.0)
            last, last1, last2 = u, u1, u2
            before = int(scored[k])
            x, x1, x2 = moved(A, B, x, u, now), moved(A, B, x1, u1, now), moved(A, B, x2, u2, now)
        for i in range(ROWS):
            out[i, tid] = sums[i]
            out[ROWS + i, tid] = peaks[i]
            for t in range(2):
                slope[t, i, tid] = sum_slopes[t, i]
                slope[t, ROWS + i, tid] = peak_slopes[t, i]
        out[2 * ROWS, tid] = lost

    return Kernels(run, slopes)
