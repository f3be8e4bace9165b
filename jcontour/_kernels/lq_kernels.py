"""The receding-horizon LQ run and its slopes in Warp: one thread a run, gains never formed.

The algebra is that of `riccati.decoupled`. With f = beta / (alpha + beta), w = f v, and the errors
over the horizon scaled by the root of the stage profile, a step solves

    S w = sum_a r_a (f M_a e_a),   S_ij = 1_ij (1 - f |r_i|^2) + sum_a r_ai (f M_aij) r_aj
    eta_a = e_a - r_a w,           u_a = -(kappa M_a h_a)' eta_a
The cost is homogeneous in (alpha, beta, rho): the slopes with log kappa and with f say all. With
z_a = M_a eta_a, e' = O x' the slope of the free error, and kappa dM/dkappa = M M - M,

    kappa d/dkappa: S w' = sum_a r_a (f M (e' + z) - f z),  u' = -(kappa M h)' (e' + z - r w')
          d/df:     S w' = sum_a r_a f M e' + v,            u' = -(kappa M h)' (e' - r w')
f is at least `LEAST_RATIO`, so that v = w / f.

In reverse, from the cotangents u_bar of the controls, a step solves S p = sum_a r_a g_a u_bar_a,
with g = kappa M h. The free error has the cotangent e_bar_a = f M_a r_a p - g_a u_bar_a. The slopes
with log kappa, f, and half of the logarithm of entry j of the stage profile are

    sum_a (e_bar_a' z_a - f p' r_a z_a),   p' w / f,
    sum_a (e_bar_aj (2 z_aj + r_aj w_j) - f p_j r_aj z_aj)

M does not fit into registers. A compiler keeps what it has read if it can, and spills it. So it is
kept from moving readings across the parts of a step (`fence`).
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

LONGEST_PREVIEW = 16  # samples: loops over more are not unrolled
SEGMENT = 25  # samples between stored states; in reverse those between are computed again
TILE = 32  # runs side by side in memory
LEAST_RATIO = 1e-20  # of beta / (alpha + beta)


class Kernels(NamedTuple):
    """Run, run with slopes, run that keeps its states and controls, and slopes in reverse."""

    run: wp.Kernel
    slopes: wp.Kernel
    keeping_run: wp.Kernel
    adjoint: wp.Kernel


@lru_cache
def kernels(m: int, n: int, N: int, real=wp.float64, staged: bool = False) -> Kernels:
    """Kernels for m axes of at most n states and a horizon of N samples.

    Arrays of a run: f (1, runs), and in tiles of `TILE` runs (tiles, rows, TILE) the lower
    triangles of f M (m T rows) and kappa M h (m N rows); roots of the stage profile (N, runs). What
    all runs share: A (m n n), B, C (m n), O (m N n), tangents and desired positions (m S), what the
    model's response at rest is above its position (m N), the control there, arc lengths, what is
    scored (steps,), the first state (m, n), the pieces of the contour, and its length, size,
    closedness and number of pieces.
    """
    T = N * (N + 1) // 2  # numbers of a symmetric matrix, its lower triangle row by row
    Point, Window = (wp.types.vector(length=k, dtype=real) for k in (m, N))
    Triangle, States = (wp.types.vector(length=k, dtype=real) for k in (T, m * n))
    Sums, Slope = wp.types.vector(length=NORMS, dtype=real), wp.types.matrix((2, NORMS), real)
    Slopes = wp.types.vector(length=2 + N, dtype=real)
    Row, Rows, Cube = (wp.array(dtype=real, ndim=k) for k in (1, 2, 3))
    scores = contour_scores(m, real)

    @wp.func(inline=True)
    def tile(rows: int, tid: int) -> wp.int64:
        """Index of the first of a run's numbers; the next are `TILE` apart."""
        return wp.int64(tid // TILE) * wp.int64(rows * TILE) + wp.int64(tid % TILE)

    @wp.func(inline=True)
    def ahead_of(rows: Row, stride: int, a: int, k: int) -> Window:
        """Samples k + 1 to k + N of an axis."""
        w, first = Window(), wp.int64(a * stride + k + 1)
        for i in range(N):
            w[i] = at(rows, first, i)
        return w

    @wp.func(inline=True)
    def free(observed: Row, scale: Rows, x: States, a: int, tid: int) -> Window:
        """Free outputs of an axis over the window, scaled."""
        e = Window()
        for i in range(N):
            for q in range(n):
                e[i] += at(observed, wp.int64(0), (a * N + i) * n + q) * x[a * n + q]
            if wp.static(staged):
                e[i] *= scale[i, tid]
        return e

    @wp.func(inline=True)
    def desired(y_d: Row, rest: Row, scale: Rows, stride: int, a: int, k: int, tid: int) -> Window:
        w = ahead_of(y_d, stride, a, k)
        for i in range(N):
            w[i] += at(rest, wp.int64(0), a * N + i)
            if wp.static(staged):
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
    def times(M: Row, first: wp.int64, a: int, e: Window) -> Window:
        """Product f M e of an axis."""
        s = Window()
        for i in range(N):
            for j in range(i):
                entry = at(M, first, (a * T + i * (i + 1) // 2 + j) * TILE)
                s[i] += entry * e[j]
                s[j] += entry * e[i]
            s[i] += at(M, first, (a * T + i * (i + 1) // 2 + i) * TILE) * e[i]
        return s

    @wp.func(inline=True)
    def both(M: Row, first: wp.int64, a: int, e: Window, d: Window):
        """Products f M e and f M d of an axis, each number of M read once."""
        s, t = Window(), Window()
        for i in range(N):
            for j in range(i):
                entry = at(M, first, (a * T + i * (i + 1) // 2 + j) * TILE)
                s[i] += entry * e[j]
                s[j] += entry * e[i]
                t[i] += entry * d[j]
                t[j] += entry * d[i]
            entry = at(M, first, (a * T + i * (i + 1) // 2 + i) * TILE)
            s[i] += entry * e[i]
            t[i] += entry * d[i]
        return s, t

    @wp.func(inline=True)
    def paired(Mh: Row, first: wp.int64, a: int, e: Window) -> real:
        """Product (kappa M h)' e of an axis."""
        u = real(0.0)
        for i in range(N):
            u += at(Mh, first, (a * N + i) * TILE) * e[i]
        return u

    @wp.func(inline=True)
    def moved(A: Row, B: Row, x: States, u: Point) -> States:
        new = States()
        for a in range(m):
            for i in range(n):
                new[a * n + i] = at(B, wp.int64(0), a * n + i) * u[a]
                for q in range(n):
                    new[a * n + i] += at(A, wp.int64(0), (a * n + i) * n + q) * x[a * n + q]
        return new

    @wp.func(inline=True)
    def output(C: Row, x: States) -> Point:
        y = Point()
        for a in range(m):
            for q in range(n):
                y[a] += at(C, wp.int64(0), a * n + q) * x[a * n + q]
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
    def system(
        f: real, M: Row, first: wp.int64, Mh: Row, first_h: wp.int64, scale: Rows, observed: Row,
        r: Row, y_d: Row, rest: Row, hold: Row, x: States, stride: int, k: int, tid: int,
    ):  # fmt: skip
        """S, its right-hand side c = sum_a r_a (f M_a e_a), and the control where w is zero."""
        S, c, u = Triangle(), Window(), sample_of(hold)
        for i in range(N):
            S[i * (i + 1) // 2 + i] = real(1.0)
        for a in range(m):
            fence()
            R = ahead_of(r, stride, a, k)
            e = free(observed, scale, x, a, tid) - desired(y_d, rest, scale, stride, a, k, tid)
            s = Window()
            for i in range(N):
                for j in range(i):
                    entry = at(M, first, (a * T + i * (i + 1) // 2 + j) * TILE)
                    s[i] += entry * e[j]
                    s[j] += entry * e[i]
                    S[i * (i + 1) // 2 + j] += R[i] * R[j] * entry
                entry = at(M, first, (a * T + i * (i + 1) // 2 + i) * TILE)
                s[i] += entry * e[i]
                S[i * (i + 1) // 2 + i] += R[i] * R[i] * (entry - f)
            for i in range(N):
                c[i] += R[i] * s[i]
            u[a] -= paired(Mh, first_h, a, e)
        return S, c, u

    def running(keeps: bool) -> wp.Kernel:
        @wp.kernel(**IN_SHARED)
        def run(
            f: Rows, M: Row, Mh: Row, scale: Rows, A: Row, B: Row, C: Row, observed: Row,
            r: Row, y_d: Row, rest: Row, hold: Row, arc: Row,
            scored: wp.array(dtype=int), start: Rows, pieces: Rows, whole: Row,
            out: Rows,  # (3 NORMS + 1, runs): sums, peaks, diverged, samples of the peaks
            kept: Rows,  # (m steps + m n segments, runs): controls, states before segments
        ):  # fmt: skip
            own = wp.tid()
            ratio = f[0, own]
            stride = scored.shape[0] + N
            own_M, own_Mh = tile(m * T, own), tile(m * N, own)
            x, last, before = begun(start), Point(), int(0)
            sums, peaks, when, lost = Sums(), Sums(), Sums(), real(0.0)
            for k in range(scored.shape[0]):
                S, c, u = system(
                    ratio, M, own_M, Mh, own_Mh, scale, observed,
                    r, y_d, rest, hold, x, stride, k, own,
                )  # fmt: skip
                fence()
                w = solved(cholesky(S), c)
                fence()
                for a in range(m):
                    lag = wp.cw_mul(ahead_of(r, stride, a, k), w)
                    u[a] += paired(Mh, own_Mh, a, lag)
                if wp.static(keeps):
                    for a in range(m):
                        kept[k * m + a, own] = u[a]
                    if k % SEGMENT == 0:
                        for i in range(m * n):
                            kept[scored.shape[0] * m + k // SEGMENT * m * n + i, own] = x[i]
                y, tangent = output(C, x), sample(r, stride, k)
                error = y - sample(y_d, stride, k)
                if scored[k] != 0:
                    offset, across = scores(pieces, whole, y, error, tangent, arc[k])
                    squares = Sums()
                    squares[0] = wp.length_sq(offset)
                    squares[1] = wp.length_sq(across)
                    squares[2] = wp.length_sq(error)
                    squares[3] = wp.length_sq(u)
                    if before != 0:
                        squares[4] = wp.length_sq(u - last)
                    sums += squares
                    if wp.static(keeps):
                        for i in range(NORMS):
                            if squares[i] > peaks[i]:
                                when[i] = real(k)
                    peaks = wp.max(peaks, squares)
                    if not (squares[2] <= whole[1] * whole[1]) or not wp.isfinite(squares[3]):
                        lost = real(1.0)
                last = u
                before = int(scored[k])
                x = moved(A, B, x, u)
            for i in range(NORMS):
                out[i, own] = sums[i]
                out[NORMS + i, own] = peaks[i]
                out[2 * NORMS + 1 + i, own] = when[i]
            out[2 * NORMS, own] = lost

        return run

    @wp.kernel(enable_backward=False, module="unique")
    def slopes(
        f: Rows, M: Row, Mh: Row, scale: Rows, A: Row, B: Row, C: Row, observed: Row,
        r: Row, y_d: Row, rest: Row, hold: Row, arc: Row,
        scored: wp.array(dtype=int), start: Rows, pieces: Rows, whole: Row,
        out: Rows, slope: Cube,  # (2, 2 NORMS, runs): of half of the sums and peaks
    ):  # fmt: skip
        """Both slopes of a run by one thread: with log kappa, and with f."""
        own = wp.tid()
        ratio = f[0, own]
        stride = scored.shape[0] + N
        own_M, own_Mh = tile(m * T, own), tile(m * N, own)
        x, x1, x2, before = begun(start), States(), States(), int(0)
        last, last1, last2 = Point(), Point(), Point()
        sums, peaks, lost, sum_slopes, peak_slopes = Sums(), Sums(), real(0.0), Slope(), Slope()
        for k in range(scored.shape[0]):
            fence()
            S, c, u = system(
                ratio, M, own_M, Mh, own_Mh, scale, observed,
                r, y_d, rest, hold, x, stride, k, own,
            )  # fmt: skip
            fence()
            L = cholesky(S)
            fence()
            w = solved(L, c)
            c1, c2, u1, u2 = Window(), w / ratio, Point(), Point()
            for a in range(m):
                R = ahead_of(r, stride, a, k)
                lag = wp.cw_mul(R, w)
                eta = (
                    free(observed, scale, x, a, own)
                    - desired(y_d, rest, scale, stride, a, k, own)
                    - lag
                )
                fence()
                z = times(M, own_M, a, eta)
                fence()
                e1 = free(observed, scale, x1, a, own) + z / ratio
                e2 = free(observed, scale, x2, a, own)
                u[a] += paired(Mh, own_Mh, a, lag)
                u1[a] -= paired(Mh, own_Mh, a, e1)
                u2[a] -= paired(Mh, own_Mh, a, e2)
                fence()
                s1, s2 = both(M, own_M, a, e1, e2)
                for i in range(N):
                    c1[i] += R[i] * (s1[i] - z[i])
                    c2[i] += R[i] * s2[i]
            fence()
            w1, w2 = solved(L, c1), solved(L, c2)
            fence()
            for a in range(m):
                R = ahead_of(r, stride, a, k)
                u1[a] += paired(Mh, own_Mh, a, wp.cw_mul(R, w1))
                u2[a] += paired(Mh, own_Mh, a, wp.cw_mul(R, w2))
            fence()
            y, y1, y2 = output(C, x), output(C, x1), output(C, x2)
            tangent = sample(r, stride, k)
            error = y - sample(y_d, stride, k)
            if scored[k] != 0:
                offset, across = scores(pieces, whole, y, error, tangent, arc[k])
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
                for i in range(NORMS):
                    if squares[i] > peaks[i]:
                        peaks[i] = squares[i]
                        peak_slopes[0, i] = ds[0, i]
                        peak_slopes[1, i] = ds[1, i]
                if not (squares[2] <= whole[1] * whole[1]) or not wp.isfinite(squares[3]):
                    lost = real(1.0)
            last, last1, last2 = u, u1, u2
            before = int(scored[k])
            fence()
            x, x1, x2 = moved(A, B, x, u), moved(A, B, x1, u1), moved(A, B, x2, u2)
        for i in range(NORMS):
            out[i, own] = sums[i]
            out[NORMS + i, own] = peaks[i]
            for t in range(2):
                slope[t, i, own] = sum_slopes[t, i]
                slope[t, NORMS + i, own] = peak_slopes[t, i]
        out[2 * NORMS, own] = lost

    @wp.kernel(**IN_SHARED)
    def adjoint(
        f: Rows, M: Row, Mh: Row, scale: Rows, A: Row, B: Row, C: Row, observed: Row,
        r: Row, y_d: Row, rest: Row, hold: Row, arc: Row,
        scored: wp.array(dtype=int), start: Rows, pieces: Rows, whole: Row,
        bars: Rows,  # (2 NORMS, runs): cotangents of half of the sums and peaks
        metrics: Rows, kept: Rows,  # of `run`
        slope: Rows,  # (2 + N, runs): with log kappa, f, the logarithms of the roots of the profile
        states: Rows,  # (m n SEGMENT, runs): of a segment
    ):  # fmt: skip
        """Slopes of a run with everything that its gains are made from, in reverse."""
        own = wp.tid()
        ratio = f[0, own]
        stride = scored.shape[0] + N
        own_M, own_Mh = tile(m * T, own), tile(m * N, own)
        x_bar, pull, total = States(), Point(), Slopes()
        for back in range(scored.shape[0]):
            k = scored.shape[0] - 1 - back
            place = k % SEGMENT
            x, u, last = States(), Point(), Point()
            if back == 0 or place == SEGMENT - 1:
                for i in range(m * n):
                    x[i] = kept[scored.shape[0] * m + k // SEGMENT * m * n + i, own]
                for j in range(place + 1):
                    for i in range(m * n):
                        states[j * m * n + i, own] = x[i]
                    for a in range(m):
                        u[a] = kept[(k - place + j) * m + a, own]
                    x = moved(A, B, x, u)
            for i in range(m * n):
                x[i] = states[place * m * n + i, own]
            for a in range(m):
                u[a] = kept[k * m + a, own]
                if k > 0:
                    last[a] = kept[k * m - m + a, own]
            y_bar, u_bar = Point(), -pull
            pull = Point()
            if scored[k] != 0:
                bar = Sums()
                for i in range(NORMS):
                    bar[i] = bars[i, own]
                    if metrics[2 * NORMS + 1 + i, own] == real(k):
                        bar[i] += bars[NORMS + i, own]
                y, tangent = output(C, x), sample(r, stride, k)
                error = y - sample(y_d, stride, k)
                offset, across = scores(pieces, whole, y, error, tangent, arc[k])
                y_bar = offset * bar[0] + across * bar[1] + error * bar[2]
                if k > 0 and scored[wp.max(k - 1, 0)] != 0:
                    pull = (u - last) * bar[4]
                u_bar += u * bar[3] + pull
            next_bar = States()
            for a in range(m):
                for q in range(n):
                    u_bar[a] += at(B, wp.int64(0), a * n + q) * x_bar[a * n + q]
                    next_bar[a * n + q] = at(C, wp.int64(0), a * n + q) * y_bar[a]
                    for i in range(n):
                        entry = at(A, wp.int64(0), (a * n + i) * n + q)
                        next_bar[a * n + q] += entry * x_bar[a * n + i]
            fence()
            S, c, _ = system(
                ratio, M, own_M, Mh, own_Mh, scale, observed,
                r, y_d, rest, hold, x, stride, k, own,
            )  # fmt: skip
            fence()
            L = cholesky(S)
            fence()
            w, w_bar = solved(L, c), Window()
            for a in range(m):
                R = ahead_of(r, stride, a, k)
                for i in range(N):
                    w_bar[i] += R[i] * at(Mh, own_Mh, (a * N + i) * TILE) * u_bar[a]
            fence()
            p = solved(L, w_bar)
            fence()
            total[1] += wp.dot(p, w) / ratio
            for a in range(m):
                R = ahead_of(r, stride, a, k)
                lag, turned = wp.cw_mul(R, w), wp.cw_mul(R, p)
                eta = (
                    free(observed, scale, x, a, own)
                    - desired(y_d, rest, scale, stride, a, k, own)
                    - lag
                )
                fence()
                fz, e_bar = both(M, own_M, a, eta, turned)
                fence()
                z = fz / ratio
                for i in range(N):
                    e_bar[i] -= at(Mh, own_Mh, (a * N + i) * TILE) * u_bar[a]
                    total[0] += e_bar[i] * z[i] - turned[i] * fz[i]
                    if wp.static(staged):
                        total[2 + i] += e_bar[i] * (real(2.0) * z[i] + lag[i]) - turned[i] * fz[i]
                        e_bar[i] *= scale[i, own]
                    for s in range(n):
                        entry = at(observed, wp.int64(0), (a * N + i) * n + s)
                        next_bar[a * n + s] += entry * e_bar[i]
            x_bar = next_bar
        for i in range(2 + N):
            slope[i, own] = total[i]

    return Kernels(running(False), slopes, running(True), adjoint)
