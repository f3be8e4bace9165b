"""The receding-horizon LQ run and its slopes in Warp: one thread a run, gains never formed.

The algebra is that of `riccati.decoupled`. With f = beta / (alpha + beta), w = f v, and the errors
of the window scaled by the root of the stage profile, a step solves

    S w = sum_a r_a (f M_a e_a),   S_ij = 1_ij (1 - f |r_i|^2) + sum_a r_ai (f M_aij) r_aj
    eta_a = e_a - r_a w,           u_a = -(kappa M_a h_a)' eta_a
The cost is homogeneous in (alpha, beta, rho): the slopes with log kappa and with f say all. From
kappa dM/dkappa = M M - M,

    kappa d/dkappa: S w' = r'(f M e' + f (M M - M) eta),  u' = -(kappa M h)' (e' - r w')
                                                               - (kappa M M h)' eta
          d/df:     S w' = r' f M e' + v,                 u' = -(kappa M h)' (e' - r w')

with e' = O x', the slope of the free error. f is at least `LEAST`, so that v = w / f.

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
LANES = 32  # runs side by side in memory
LEAST = 1e-20  # of f


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


@wp.func_native("return numbers.data[first + k];")
def at(numbers: wp.array(dtype=wp.float64), first: wp.int64, k: int) -> wp.float64:
    """A number, without a multiplication by a stride: `k` is a constant of the instruction."""
    ...


@wp.func_native("return numbers.data[first + k];")
def at(numbers: wp.array(dtype=wp.float32), first: wp.int64, k: int) -> wp.float32:  # noqa: F811
    """A number, without a multiplication by a stride: `k` is a constant of the instruction."""
    ...


@lru_cache
def kernels(m: int, n: int, N: int, real=wp.float64, profiled: bool = False) -> Kernels:
    """Kernels for m axes of at most n states and a window of N samples.

    Arrays of a run: f (1, runs), and in tiles of `LANES` runs (tiles, rows, LANES) the lower
    triangles of f M (m T rows) and kappa M h (m N rows), for slopes both followed by their slopes
    with log kappa; the roots of the profile (N, runs). What all runs share: A (m n n), B, C
    (m n), O (m N n), zeros (steps + 2,), tangents and desired positions (m S), what the model's
    response at rest is above its position (m N), the control there, arc lengths, what is scored
    (steps,), the first state (m, n), the pieces of the contour, and its length, size, closedness
    and number of pieces.
    """
    T = N * (N + 1) // 2  # numbers of a symmetric matrix, its lower triangle row by row
    Point, Window = (wp.types.vector(length=k, dtype=real) for k in (m, N))
    Triangle, States = (wp.types.vector(length=k, dtype=real) for k in (T, m * n))
    Sums, Slope = wp.types.vector(length=ROWS, dtype=real), wp.types.matrix((2, ROWS), real)
    Row, Rows, Cube = (wp.array(dtype=real, ndim=k) for k in (1, 2, 3))

    @wp.func(inline=True)
    def tile(rows: int, tid: int) -> wp.int64:
        """Index of the first of a run's numbers; the next are `LANES` apart."""
        return wp.int64(tid // LANES) * wp.int64(rows * LANES) + wp.int64(tid % LANES)

    @wp.func(inline=True)
    def ahead_of(rows: Row, stride: int, a: int, k: int) -> Window:
        """Samples k + 1 to k + N of an axis."""
        w, first = Window(), wp.int64(a * stride + k + 1)
        for i in range(N):
            w[i] = at(rows, first, i)
        return w

    @wp.func(inline=True)
    def free(observed: Row, scale: Rows, x: States, a: int, now: int, tid: int) -> Window:
        """Free outputs of an axis over the window, scaled."""
        e = Window()
        for i in range(N):
            for q in range(n):
                e[i] += at(observed, wp.int64(now), (a * N + i) * n + q) * x[a * n + q]
            if wp.static(profiled):
                e[i] *= scale[i, tid]
        return e

    @wp.func(inline=True)
    def desired(
        y_d: Row, rest: Row, scale: Rows, stride: int, a: int, k: int, now: int, tid: int
    ) -> Window:
        w = ahead_of(y_d, stride, a, k)
        for i in range(N):
            w[i] += at(rest, wp.int64(now), a * N + i)
            if wp.static(profiled):
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
    def paired(Mh: Row, first: wp.int64, a: int, e: Window) -> real:
        """Product (kappa M h)' e of an axis."""
        u = real(0.0)
        for i in range(N):
            u += at(Mh, first, (a * N + i) * LANES) * e[i]
        return u

    @wp.func(inline=True)
    def moved(A: Row, B: Row, x: States, u: Point, now: int) -> States:
        new = States()
        for a in range(m):
            for i in range(n):
                new[a * n + i] = at(B, wp.int64(now), a * n + i) * u[a]
                for q in range(n):
                    new[a * n + i] += at(A, wp.int64(now), (a * n + i) * n + q) * x[a * n + q]
        return new

    @wp.func(inline=True)
    def output(C: Row, x: States, now: int) -> Point:
        y = Point()
        for a in range(m):
            for q in range(n):
                y[a] += at(C, wp.int64(now), a * n + q) * x[a * n + q]
        return y

    @wp.func(inline=True)
    def sample(rows: Row, stride: int, k: int) -> Point:
        p = Point()
        for a in range(m):
            p[a] = rows[a * stride + k]
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
        f: Rows, M: Row, Mh: Row, scale: Rows, A: Row, B: Row, C: Row, observed: Row,
        zero: wp.array(dtype=int), r: Row, y_d: Row, rest: Row, hold: Row, arc: Row,
        scored: wp.array(dtype=int), start: Rows, pieces: Rows, whole: Row,
        out: Rows,  # (2 ROWS + 1, runs): sums, peaks, whether it diverged
    ):  # fmt: skip
        own = wp.tid()
        forgiven = f[0, own]
        stride = scored.shape[0] + N
        own_M, own_Mh = tile(m * T, own), tile(m * N, own)
        x, last, before = begun(start), Point(), int(0)
        sums, peaks, lost = Sums(), Sums(), real(0.0)
        for k in range(scored.shape[0]):
            now = zero[k]
            at_M, at_Mh = own_M + wp.int64(now), own_Mh + wp.int64(now)
            S, c, u = Triangle(), Window(), sample_of(hold)
            for i in range(N):
                S[i * (i + 1) // 2 + i] = real(1.0)
            for a in range(m):
                R = ahead_of(r, stride, a, k)
                e = free(observed, scale, x, a, now, own) - desired(
                    y_d, rest, scale, stride, a, k, now, own
                )
                s = Window()
                for i in range(N):
                    for j in range(i):
                        entry = at(M, at_M, (a * T + i * (i + 1) // 2 + j) * LANES)
                        s[i] += entry * e[j]
                        s[j] += entry * e[i]
                        S[i * (i + 1) // 2 + j] += R[i] * R[j] * entry
                    entry = at(M, at_M, (a * T + i * (i + 1) // 2 + i) * LANES)
                    s[i] += entry * e[i]
                    S[i * (i + 1) // 2 + i] += R[i] * R[i] * (entry - forgiven)
                for i in range(N):
                    c[i] += R[i] * s[i]
                u[a] -= paired(Mh, at_Mh, a, e)
            w = solved(cholesky(S), c)
            late = zero[k + 1]
            for a in range(m):
                lag = wp.cw_mul(ahead_of(r, stride, a, k + late), w)
                u[a] += paired(Mh, own_Mh + wp.int64(late), a, lag)
            y, tangent = output(C, x, now), sample(r, stride, k)
            error = y - sample(y_d, stride, k)
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
    def factored(M: Row, first: wp.int64, r: Row, stride: int, k: int, forgiven: real) -> Triangle:
        S = Triangle()
        for i in range(N):
            S[i * (i + 1) // 2 + i] = real(1.0)
        for a in range(m):
            R = ahead_of(r, stride, a, k)
            for i in range(N):
                for j in range(i):
                    entry = at(M, first, (a * T + i * (i + 1) // 2 + j) * LANES)
                    S[i * (i + 1) // 2 + j] += R[i] * R[j] * entry
                entry = at(M, first, (a * T + i * (i + 1) // 2 + i) * LANES)
                S[i * (i + 1) // 2 + i] += R[i] * R[i] * (entry - forgiven)
        return cholesky(S)

    @wp.kernel(enable_backward=False, module="unique")
    def slopes(
        f: Rows, M: Row, Mh: Row, scale: Rows, A: Row, B: Row, C: Row, observed: Row,
        zero: wp.array(dtype=int), r: Row, y_d: Row, rest: Row, hold: Row, arc: Row,
        scored: wp.array(dtype=int), start: Rows, pieces: Rows, whole: Row,
        out: Rows, slope: Cube,  # (2, 2 ROWS, runs): of half of the sums and peaks
    ):  # fmt: skip
        """Both slopes of a run by one thread: with log kappa, and with f."""
        own = wp.tid()
        forgiven = f[0, own]
        stride = scored.shape[0] + N
        own_M, own_Mh = tile(2 * m * T, own), tile(2 * m * N, own)
        x, x1, x2, before = begun(start), States(), States(), int(0)
        last, last1, last2 = Point(), Point(), Point()
        sums, peaks, lost, sum_slopes, peak_slopes = Sums(), Sums(), real(0.0), Slope(), Slope()
        for k in range(scored.shape[0]):
            now = zero[k]
            at_M, at_Mh = own_M + wp.int64(now), own_Mh + wp.int64(now)
            c, c1, c2 = Window(), Window(), Window()
            u, u1, u2 = sample_of(hold), Point(), Point()
            for a in range(m):
                e = free(observed, scale, x, a, now, own) - desired(
                    y_d, rest, scale, stride, a, k, now, own
                )
                e1 = free(observed, scale, x1, a, now, own)
                e2 = free(observed, scale, x2, a, now, own)
                u[a] -= paired(Mh, at_Mh, a, e)
                u1[a] -= paired(Mh, at_Mh, a, e1) + paired(Mh, at_Mh, a + m, e)
                u2[a] -= paired(Mh, at_Mh, a, e2)
                s, s1, s2 = Window(), Window(), Window()
                for i in range(N):
                    for j in range(i):
                        entry = at(M, at_M, (a * T + i * (i + 1) // 2 + j) * LANES)
                        s[i] += entry * e[j]
                        s[j] += entry * e[i]
                        s1[i] += entry * e1[j]
                        s1[j] += entry * e1[i]
                        s2[i] += entry * e2[j]
                        s2[j] += entry * e2[i]
                    entry = at(M, at_M, (a * T + i * (i + 1) // 2 + i) * LANES)
                    s[i] += entry * e[i]
                    s1[i] += entry * e1[i]
                    s2[i] += entry * e2[i]
                R = ahead_of(r, stride, a, k)
                for i in range(N):
                    c[i] += R[i] * s[i]
                    c1[i] += R[i] * s1[i]
                    c2[i] += R[i] * s2[i]
            late = zero[k + 1]
            L = factored(M, own_M + wp.int64(late), r, stride, k + late, forgiven)
            w = solved(L, c)
            late = zero[k + 2]
            at_M, at_Mh = own_M + wp.int64(late), own_Mh + wp.int64(late)
            for a in range(m):
                lag = wp.cw_mul(ahead_of(r, stride, a, k + late), w)
                eta = (
                    free(observed, scale, x, a, late, own)
                    - desired(y_d, rest, scale, stride, a, k + late, late, own)
                    - lag
                )
                u[a] += paired(Mh, at_Mh, a, lag)
                u1[a] += paired(Mh, at_Mh, a + m, lag)
                s = Window()
                for i in range(N):
                    for j in range(i):
                        entry = at(M, at_M, ((a + m) * T + i * (i + 1) // 2 + j) * LANES)
                        s[i] += entry * eta[j]
                        s[j] += entry * eta[i]
                    s[i] += at(M, at_M, ((a + m) * T + i * (i + 1) // 2 + i) * LANES) * eta[i]
                c1 += wp.cw_mul(ahead_of(r, stride, a, k + late), s)
            w1, w2 = solved(L, c1), solved(L, w / forgiven + c2)
            late = zero[k + 1]
            for a in range(m):
                R = ahead_of(r, stride, a, k + late)
                u1[a] += paired(Mh, own_Mh + wp.int64(late), a, wp.cw_mul(R, w1))
                u2[a] += paired(Mh, own_Mh + wp.int64(late), a, wp.cw_mul(R, w2))
            y, y1, y2 = output(C, x, now), output(C, x1, now), output(C, x2, now)
            tangent = sample(r, stride, k)
            error = y - sample(y_d, stride, k)
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
            out[i, own] = sums[i]
            out[ROWS + i, own] = peaks[i]
            for t in range(2):
                slope[t, i, own] = sum_slopes[t, i]
                slope[t, ROWS + i, own] = peak_slopes[t, i]
        out[2 * ROWS, own] = lost

    return Kernels(run, slopes)
