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
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import warp as wp

from jcontour._kernels.parts import IN_SHARED, NORMS, at, fence, inverse_root, scoring

LONGEST_PREVIEW = 16  # samples: loops over more are not unrolled
SEGMENT = 25  # samples between stored states; in reverse those between are computed again
TILE = 32  # runs side by side in memory
LEAST_RATIO = 1e-20  # of beta / (alpha + beta)


class Size(NamedTuple):
    """Size of a run and type of its numbers, for which a kernel is compiled."""

    m: int  # axes
    n: int  # states of an axis, at most
    N: int  # preview [samples]
    real: type = wp.float64
    staged: bool = False  # whether there is a stage profile

    @property
    def places(self) -> tuple[int, ...]:
        """First numbers of B, C, O, the response and control at rest, and the state in `model`."""
        m, n, N, *_ = self
        return tuple(np.cumsum([m * n * n, m * n, m * n, m * N * n, m * N, m]).tolist())


@lru_cache
def lq_kernel(name: str, size: Size) -> wp.Kernel:
    """Kernel of a run, of one that stores its states, of one with its slopes, or of the adjoint.

    The inputs are flat arrays:

    - `design`, in tiles of `TILE` runs: f, lower triangles of f M (m T), kappa M h (m N), roots of
      the stage profile (N, if any), with T = N (N + 1) / 2;
    - `model`, the same for all runs: A (m n n), B, C (m n), O (m N n), the model's response at rest
      above its position (m N), the control there (m), the first state (m n);
    - `path` and `contour` as in `parts.scoring`.

    The adjoint has two more: cotangents of half of the sums and peaks (2 NORMS, runs), and the
    output of `storing_run`. The outputs have the rows of `output_rows`.
    """
    if name == "slopes":
        return _slopes(size)
    return _adjoint(size) if name == "adjoint" else _run(size, stores=name == "storing_run")


def output_rows(name: str, size: Size, steps: int) -> int:
    """Number of rows of a kernel's output (rows, runs).

    - `run`: sums and peaks of the squares, and whether the run diverged;
    - `storing_run`: these, the samples of the peaks, the controls, the state before each segment;
    - `slopes`: those of `run`, and the slopes of half of the sums and peaks with log kappa, with f;
    - `adjoint`: the slopes with log kappa, f and the logarithms of the roots of the stage profile,
      then the states of a segment, which are of no use outside.
    """
    m, n, N, *_ = size
    return {
        "run": 2 * NORMS + 1,
        "storing_run": 3 * NORMS + 1 + m * steps + m * n * -(-steps // SEGMENT),
        "slopes": 6 * NORMS + 1,
        "adjoint": 2 + N + m * n * SEGMENT,
    }[name]


@lru_cache
def _triangles(N: int, real) -> SimpleNamespace:
    """Functions of symmetric matrices, given by their lower triangles row by row."""
    Window, Triangle = (wp.types.vector(length=k, dtype=real) for k in (N, N * (N + 1) // 2))
    Row = wp.array(dtype=real, ndim=1)

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
    def solve(L: Triangle, c: Window) -> Window:
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
    def product(design: Row, start: wp.int64, row: int, e: Window) -> Window:
        """Product of the triangle from a row of the design on."""
        s = Window()
        for i in range(N):
            for j in range(i):
                entry = at(design, start, (row + i * (i + 1) // 2 + j) * TILE)
                s[i] += entry * e[j]
                s[j] += entry * e[i]
            s[i] += at(design, start, (row + i * (i + 1) // 2 + i) * TILE) * e[i]
        return s

    @wp.func(inline=True)
    def products(design: Row, start: wp.int64, row: int, e: Window, d: Window):
        """Products of a triangle with two windows, each number read once."""
        s, t = Window(), Window()
        for i in range(N):
            for j in range(i):
                entry = at(design, start, (row + i * (i + 1) // 2 + j) * TILE)
                s[i] += entry * e[j]
                s[j] += entry * e[i]
                t[i] += entry * d[j]
                t[j] += entry * d[i]
            entry = at(design, start, (row + i * (i + 1) // 2 + i) * TILE)
            s[i] += entry * e[i]
            t[i] += entry * d[i]
        return s, t

    return SimpleNamespace(cholesky=cholesky, solve=solve, product=product, products=products)


@lru_cache
def _axes(size: Size) -> SimpleNamespace:
    """Functions of the axes' models and of their windows, samples k + 1 to k + N."""
    m, n, N, real, staged = size
    B, C, maps, rest, _, first = size.places
    first_roots = 1 + m * N * (N + 1) // 2 + m * N  # in `design`
    columns = 2 * m + 2  # of `path`
    Row = wp.array(dtype=real, ndim=1)
    Window, Point, States = (wp.types.vector(length=k, dtype=real) for k in (N, m, m * n))

    @wp.func(inline=True)
    def window(path: Row, column: int, k: int) -> Window:
        w, first = Window(), wp.int64((k + 1) * columns)
        for i in range(N):
            w[i] = at(path, first, i * columns + column)
        return w

    @wp.func(inline=True)
    def weighted(design: Row, start: wp.int64, w: Window) -> Window:
        """Window times the roots of the stage profile."""
        if wp.static(staged):
            for i in range(N):
                w[i] *= at(design, start, (first_roots + i) * TILE)
        return w

    @wp.func(inline=True)
    def free_response(design: Row, start: wp.int64, model: Row, x: States, a: int) -> Window:
        """Free outputs of an axis, weighted."""
        e = Window()
        for i in range(N):
            for q in range(n):
                e[i] += at(model, wp.int64(0), maps + (a * N + i) * n + q) * x[a * n + q]
        return weighted(design, start, e)

    @wp.func(inline=True)
    def free_error(
        design: Row, start: wp.int64, model: Row, path: Row, x: States, a: int, k: int
    ) -> Window:
        """Free outputs above the desired positions, weighted."""
        y_d = window(path, m + a, k)
        for i in range(N):
            y_d[i] += at(model, wp.int64(0), rest + a * N + i)
        return free_response(design, start, model, x, a) - weighted(design, start, y_d)

    @wp.func(inline=True)
    def next_state(model: Row, x: States, u: Point) -> States:
        new = States()
        for a in range(m):
            for i in range(n):
                new[a * n + i] = at(model, wp.int64(0), B + a * n + i) * u[a]
                for q in range(n):
                    new[a * n + i] += at(model, wp.int64(0), (a * n + i) * n + q) * x[a * n + q]
        return new

    @wp.func(inline=True)
    def output(model: Row, x: States) -> Point:
        y = Point()
        for a in range(m):
            for q in range(n):
                y[a] += at(model, wp.int64(0), C + a * n + q) * x[a * n + q]
        return y

    @wp.func(inline=True)
    def first_state(model: Row) -> States:
        x = States()
        for i in range(m * n):
            x[i] = at(model, wp.int64(0), first + i)
        return x

    return SimpleNamespace(
        States=States, window=window, weighted=weighted, free_response=free_response,
        free_error=free_error, next_state=next_state, output=output, first_state=first_state,
    )  # fmt: skip


@lru_cache
def _law(size: Size) -> SimpleNamespace:
    """Functions of the design of a run, whose numbers begin at `start`."""
    m, _, N, real, staged = size
    T = N * (N + 1) // 2
    rows = 1 + m * T + m * N + N * int(staged)
    control_at_rest = size.places[4]
    Row, axes = wp.array(dtype=real, ndim=1), _axes(size)
    Window, Triangle, Point = (wp.types.vector(length=k, dtype=real) for k in (N, T, m))

    @wp.func(inline=True)
    def first_number(run: int) -> wp.int64:
        """Index of the first number of a run; the next are `TILE` apart."""
        return wp.int64(run // TILE) * wp.int64(rows * TILE) + wp.int64(run % TILE)

    @wp.func(inline=True)
    def gain(design: Row, start: wp.int64, a: int, i: int) -> real:
        """Entry of kappa M h of an axis."""
        return at(design, start, (1 + m * T + a * N + i) * TILE)

    @wp.func(inline=True)
    def control(design: Row, start: wp.int64, a: int, e: Window) -> real:
        """Product (kappa M h)' e of an axis."""
        u = real(0.0)
        for i in range(N):
            u += gain(design, start, a, i) * e[i]
        return u

    @wp.func(inline=True)
    def step_system(design: Row, start: wp.int64, model: Row, path: Row, x: axes.States, k: int):
        """S, its right-hand side c = sum_a r_a (f M_a e_a), and the control where w is zero."""
        S, c, u, f = Triangle(), Window(), Point(), at(design, start, 0)
        for i in range(N):
            S[i * (i + 1) // 2 + i] = real(1.0)
        for a in range(m):
            u[a] = at(model, wp.int64(0), control_at_rest + a)
        for a in range(m):
            fence()
            r = axes.window(path, a, k)
            e = axes.free_error(design, start, model, path, x, a, k)
            s = Window()
            for i in range(N):
                for j in range(i):
                    entry = at(design, start, (1 + a * T + i * (i + 1) // 2 + j) * TILE)
                    s[i] += entry * e[j]
                    s[j] += entry * e[i]
                    S[i * (i + 1) // 2 + j] += r[i] * r[j] * entry
                entry = at(design, start, (1 + a * T + i * (i + 1) // 2 + i) * TILE)
                s[i] += entry * e[i]
                S[i * (i + 1) // 2 + i] += r[i] * r[i] * (entry - f)
            for i in range(N):
                c[i] += r[i] * s[i]
            u[a] -= control(design, start, a, e)
        return S, c, u

    return SimpleNamespace(
        first_number=first_number, gain=gain, control=control, step_system=step_system
    )  # fmt: skip


def _run(size: Size, stores: bool) -> wp.Kernel:
    m, n, N, real, _ = size
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))
    Point, Sums = (wp.types.vector(length=k, dtype=real) for k in (m, NORMS))
    matrix, score = _triangles(N, real), scoring(m, m, real)
    axes, law = _axes(size), _law(size)

    @wp.kernel(**IN_SHARED)
    def run(design: Row, model: Row, path: Row, contour: Rows, out: Rows):
        tid = wp.tid()
        start, steps = law.first_number(tid), score.samples(path) - N
        x, last = axes.first_state(model), Point()
        sums, peaks, peak_samples, diverged = Sums(), Sums(), Sums(), real(0.0)
        for k in range(steps):
            S, c, u = law.step_system(design, start, model, path, x, k)
            fence()
            w = matrix.solve(matrix.cholesky(S), c)
            fence()
            for a in range(m):
                u[a] += law.control(design, start, a, wp.cw_mul(axes.window(path, a, k), w))
            if wp.static(stores):
                for a in range(m):
                    out[3 * NORMS + 1 + k * m + a, tid] = u[a]
                if k % SEGMENT == 0:
                    first = 3 * NORMS + 1 + steps * m + k // SEGMENT * m * n
                    for i in range(m * n):
                        out[first + i, tid] = x[i]
            if score.scored(path, k):
                v = score.vectors(contour, path, k, axes.output(model, x), u, last)
                squares = score.products(v, v)
                sums += squares
                if wp.static(stores):
                    for i in range(NORMS):
                        if squares[i] > peaks[i]:
                            peak_samples[i] = real(k)
                peaks = wp.max(peaks, squares)
                if score.diverged(contour, squares):
                    diverged = real(1.0)
            last = u
            x = axes.next_state(model, x, u)
        for i in range(NORMS):
            out[i, tid] = sums[i]
            out[NORMS + i, tid] = peaks[i]
            if wp.static(stores):
                out[2 * NORMS + 1 + i, tid] = peak_samples[i]
        out[2 * NORMS, tid] = diverged

    return run


def _slopes(size: Size) -> wp.Kernel:
    m, _, N, real, _ = size
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))
    Point, Window, Sums = (wp.types.vector(length=k, dtype=real) for k in (m, N, NORMS))
    matrix, score = _triangles(N, real), scoring(m, m, real)
    axes, law, T = _axes(size), _law(size), N * (N + 1) // 2

    @wp.kernel(enable_backward=False, module="unique")
    def slopes(design: Row, model: Row, path: Row, contour: Rows, out: Rows):
        """Both slopes of a run by one thread: with log kappa (1), and with f (2)."""
        tid = wp.tid()
        start, steps = law.first_number(tid), score.samples(path) - N
        f = at(design, start, 0)
        x, x1, x2 = axes.first_state(model), axes.States(), axes.States()
        last, last1, last2 = Point(), Point(), Point()
        sums, peaks, diverged = Sums(), Sums(), real(0.0)
        sums1, sums2, peaks1, peaks2 = Sums(), Sums(), Sums(), Sums()
        for k in range(steps):
            fence()
            S, c, u = law.step_system(design, start, model, path, x, k)
            fence()
            L = matrix.cholesky(S)
            fence()
            w = matrix.solve(L, c)
            c1, c2, u1, u2 = Window(), w / f, Point(), Point()
            for a in range(m):
                r = axes.window(path, a, k)
                lag = wp.cw_mul(r, w)
                eta = axes.free_error(design, start, model, path, x, a, k) - lag
                fence()
                z = matrix.product(design, start, 1 + a * T, eta)
                fence()
                e1 = axes.free_response(design, start, model, x1, a) + z / f
                e2 = axes.free_response(design, start, model, x2, a)
                u[a] += law.control(design, start, a, lag)
                u1[a] -= law.control(design, start, a, e1)
                u2[a] -= law.control(design, start, a, e2)
                fence()
                s1, s2 = matrix.products(design, start, 1 + a * T, e1, e2)
                for i in range(N):
                    c1[i] += r[i] * (s1[i] - z[i])
                    c2[i] += r[i] * s2[i]
            fence()
            w1, w2 = matrix.solve(L, c1), matrix.solve(L, c2)
            fence()
            for a in range(m):
                r = axes.window(path, a, k)
                u1[a] += law.control(design, start, a, wp.cw_mul(r, w1))
                u2[a] += law.control(design, start, a, wp.cw_mul(r, w2))
            fence()
            if score.scored(path, k):
                v = score.vectors(contour, path, k, axes.output(model, x), u, last)
                v1 = score.tangents(path, k, axes.output(model, x1), u1, last1)
                v2 = score.tangents(path, k, axes.output(model, x2), u2, last2)
                squares = score.products(v, v)
                half1, half2 = score.products(v, v1), score.products(v, v2)
                sums += squares
                sums1 += half1
                sums2 += half2
                for i in range(NORMS):
                    if squares[i] > peaks[i]:
                        peaks[i] = squares[i]
                        peaks1[i] = half1[i]
                        peaks2[i] = half2[i]
                if score.diverged(contour, squares):
                    diverged = real(1.0)
            last, last1, last2 = u, u1, u2
            fence()
            x = axes.next_state(model, x, u)
            x1, x2 = axes.next_state(model, x1, u1), axes.next_state(model, x2, u2)
        for i in range(NORMS):
            out[i, tid] = sums[i]
            out[NORMS + i, tid] = peaks[i]
            out[2 * NORMS + 1 + i, tid] = sums1[i]
            out[3 * NORMS + 1 + i, tid] = peaks1[i]
            out[4 * NORMS + 1 + i, tid] = sums2[i]
            out[5 * NORMS + 1 + i, tid] = peaks2[i]
        out[2 * NORMS, tid] = diverged

    return slopes


def _storage(size: Size) -> tuple[wp.Function, wp.Function, wp.Function]:
    """Functions of the way back: a stored control, the states of a segment, the machine's step."""
    m, n, N, real, _ = size
    Rows, Row, axes = wp.array(dtype=real, ndim=2), wp.array(dtype=real, ndim=1), _axes(size)
    Point, States = (wp.types.vector(length=k, dtype=real) for k in (m, m * n))
    B, C, *_ = size.places
    controls = 3 * NORMS + 1  # first row in `stored`

    @wp.func(inline=True)
    def stored_control(stored: Rows, k: int, tid: int) -> Point:
        u = Point()
        for a in range(m):
            u[a] = stored[controls + k * m + a, tid]
        return u

    @wp.func(inline=True)
    def compute_segment(model: Row, stored: Rows, out: Rows, steps: int, k: int, tid: int):
        """States of a segment up to sample k, behind the slopes in `out`."""
        x, place = States(), k % SEGMENT
        for i in range(m * n):
            x[i] = stored[controls + steps * m + k // SEGMENT * m * n + i, tid]
        for j in range(place + 1):
            for i in range(m * n):
                out[2 + N + j * m * n + i, tid] = x[i]
            x = axes.next_state(model, x, stored_control(stored, k - place + j, tid))

    @wp.func(inline=True)
    def before_law(model: Row, x_bar: States, y_bar: Point, u_bar: Point):
        """Cotangents of the state and of the control, without the law."""
        new = States()
        for a in range(m):
            for q in range(n):
                u_bar[a] += at(model, wp.int64(0), B + a * n + q) * x_bar[a * n + q]
                new[a * n + q] = at(model, wp.int64(0), C + a * n + q) * y_bar[a]
                for i in range(n):
                    entry = at(model, wp.int64(0), (a * n + i) * n + q)
                    new[a * n + q] += entry * x_bar[a * n + i]
        return new, u_bar

    return stored_control, compute_segment, before_law


def _adjoint(size: Size) -> wp.Kernel:
    m, n, N, real, staged = size
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))
    Point, Window, Sums = (wp.types.vector(length=k, dtype=real) for k in (m, N, NORMS))
    matrix, score = _triangles(N, real), scoring(m, m, real)
    axes, law = _axes(size), _law(size)
    stored_control, compute_segment, before_law = _storage(size)
    maps, T = size.places[2], N * (N + 1) // 2
    States, Total = (wp.types.vector(length=k, dtype=real) for k in (m * n, 2 + N))

    @wp.kernel(**IN_SHARED)
    def adjoint(
        design: Row, model: Row, path: Row, contour: Rows, bars: Rows, stored: Rows, out: Rows
    ):
        """Slopes of a run with everything that its gains are made from, in reverse."""
        tid = wp.tid()
        start, steps = law.first_number(tid), score.samples(path) - N
        x_bar, increment_bar, total = States(), Point(), Total()
        for back in range(steps):
            k = steps - 1 - back
            if back == 0 or k % SEGMENT == SEGMENT - 1:
                compute_segment(model, stored, out, steps, k, tid)
            x = States()
            for i in range(m * n):
                x[i] = out[2 + N + k % SEGMENT * m * n + i, tid]
            u = stored_control(stored, k, tid)
            y_bar, u_bar = Point(), -increment_bar
            increment_bar = Point()
            if score.scored(path, k):
                bar = Sums()
                for i in range(NORMS):
                    bar[i] = bars[i, tid]
                    if stored[2 * NORMS + 1 + i, tid] == real(k):
                        bar[i] += bars[NORMS + i, tid]
                last = stored_control(stored, wp.max(k - 1, 0), tid)
                v = score.vectors(contour, path, k, axes.output(model, x), u, last)
                y_bar = v.offset * bar[0] + v.across * bar[1] + v.error * bar[2]
                increment_bar = v.increment * bar[4]
                u_bar += u * bar[3] + increment_bar
            new_bar, u_bar = before_law(model, x_bar, y_bar, u_bar)
            fence()
            S, c, _ = law.step_system(design, start, model, path, x, k)
            fence()
            L = matrix.cholesky(S)
            fence()
            w, w_bar = matrix.solve(L, c), Window()
            for a in range(m):
                r = axes.window(path, a, k)
                for i in range(N):
                    w_bar[i] += r[i] * law.gain(design, start, a, i) * u_bar[a]
            fence()
            p = matrix.solve(L, w_bar)
            fence()
            f = at(design, start, 0)
            total[1] += wp.dot(p, w) / f
            for a in range(m):
                r = axes.window(path, a, k)
                lag, g = wp.cw_mul(r, w), wp.cw_mul(r, p)
                eta = axes.free_error(design, start, model, path, x, a, k) - lag
                fence()
                fz, e_bar = matrix.products(design, start, 1 + a * T, eta, g)
                fence()
                z = fz / f
                for i in range(N):
                    e_bar[i] -= law.gain(design, start, a, i) * u_bar[a]
                    total[0] += e_bar[i] * z[i] - g[i] * fz[i]
                    if wp.static(staged):
                        total[2 + i] += e_bar[i] * (real(2.0) * z[i] + lag[i]) - g[i] * fz[i]
                e_bar = axes.weighted(design, start, e_bar)
                for i in range(N):
                    for s in range(n):
                        entry = at(model, wp.int64(0), maps + (a * N + i) * n + s)
                        new_bar[a * n + s] += entry * e_bar[i]
            x_bar = new_bar
        for i in range(2 + N):
            out[i, tid] = total[i]

    return adjoint
