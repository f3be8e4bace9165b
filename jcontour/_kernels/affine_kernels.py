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

import warp as wp

from jcontour._kernels.parts import IN_SHARED, NORMS, at, fence, inverse_root, scoring


@lru_cache
def _stage(n: int, p: int, real):
    """Product H x, and a stage back: factor L, its pivots inverted, and Y."""
    State, Input = (wp.types.vector(length=k, dtype=real) for k in (n, p))
    Triangle, Square = (wp.types.vector(length=k * (k + 1) // 2, dtype=real) for k in (n, p))
    Gain = wp.types.vector(length=p * (n + 1), dtype=real)
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))

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
            x[i] = at(M, wp.int64(0), i * columns + k)
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
    def factors(H: Triangle, g: State, A: Row, B: Row, R: Rows, own: int):
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

    return times, column, factors


@lru_cache
def gain_kernel(n: int, p: int, m: int, real) -> wp.Kernel:
    """Kernel of the gains of every step, for n states, p inputs and m axes.

    Arrays of a run have the runs behind. K holds rows (F, f) of u = f - F x, step by step.
    """
    State = wp.types.vector(length=n, dtype=real)
    Triangle = wp.types.vector(length=n * (n + 1) // 2, dtype=real)
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))
    times, column, factors = _stage(n, p, real)

    @wp.func(inline=True)
    def add_error(H: Triangle, g: State, C: Row, Q: Rows, y_d: Row, scale: real, k: int, run: int):
        """Cost to go with the output error of a sample."""
        for a in range(m):
            for b in range(m):
                weight = scale * Q[(k * m + a) * m + b, run]
                aimed = weight * y_d[k * m + b]
                for i in range(n):
                    g[i] -= at(C, wp.int64(0), a * n + i) * aimed
                    row = at(C, wp.int64(0), a * n + i) * weight
                    for j in range(i + 1):
                        H[i * (i + 1) // 2 + j] += row * at(C, wp.int64(0), b * n + j)
        return H, g

    @wp.kernel(**IN_SHARED)
    def gains(A: Row, B: Row, C: Row, y_d: Row, Q: Rows, stage: Rows, R: Rows, K: Rows):
        k, run = wp.tid()
        N = stage.shape[0]
        H, g = add_error(Triangle(), State(), C, Q, y_d, stage[N - 1, run], k + N, run)
        for back in range(N - 1):
            fence()
            _, Y = factors(H, g, A, B, R, run)
            fence()
            new, next_g = Triangle(), State()
            for c in range(n):
                x = column(A, n, c)
                next_g[c] = wp.dot(x, g)
                HA = times(H, x)
                for i in range(c + 1):
                    for q in range(n):
                        new[c * (c + 1) // 2 + i] += at(A, wp.int64(0), q * n + i) * HA[q]
                for u in range(p):
                    next_g[c] -= Y[u * (n + 1) + c] * Y[u * (n + 1) + n]
                    for i in range(c + 1):
                        new[c * (c + 1) // 2 + i] -= Y[u * (n + 1) + c] * Y[u * (n + 1) + i]
            j = N - 1 - back
            H, g = add_error(new, next_g, C, Q, y_d, stage[j - 1, run], k + j, run)
        L, Y = factors(H, g, A, B, R, run)
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
            K[k * wp.static(p * (n + 1)) + i, run] = Y[i]

    return gains


@lru_cache
def run_kernel(n: int, p: int, m: int, real) -> wp.Kernel:
    """Kernel of runs under gains; `path` and `contour` are those of `parts.scoring`.

    A row of its output: sums and peaks of squares, and whether the run diverged.
    """
    Point, State, Input = (wp.types.vector(length=k, dtype=real) for k in (m, n, p))
    Gain, Sums = (wp.types.vector(length=k, dtype=real) for k in (p * (n + 1), NORMS))
    Row, Rows = (wp.array(dtype=real, ndim=k) for k in (1, 2))
    score = scoring(m, p, real)

    @wp.func(inline=True)
    def gain(K: Rows, k: int, run: int) -> Gain:
        from_memory = Gain()
        for i in range(p * (n + 1)):
            from_memory[i] = K[k * wp.static(p * (n + 1)) + i, run]
        return from_memory

    @wp.kernel(**IN_SHARED)
    def run(A: Row, B: Row, C: Row, start: Row, path: Row, contour: Rows, K: Rows, out: Rows):
        tid = wp.tid()
        x, last = State(), Input()
        for i in range(n):
            x[i] = start[i]
        sums, peaks, diverged = Sums(), Sums(), real(0.0)
        following, steps = gain(K, 0, tid), K.shape[0] // wp.static(p * (n + 1))
        for k in range(steps):
            fence()
            now = following
            following = gain(K, wp.min(k + 1, steps - 1), tid)  # read before it is needed
            y, u = Point(), Input()
            for a in range(m):
                for q in range(n):
                    y[a] += at(C, wp.int64(0), a * n + q) * x[q]
            for v in range(p):
                u[v] = now[v * (n + 1) + n]
                for q in range(n):
                    u[v] -= now[v * (n + 1) + q] * x[q]
            if score.scored(path, k):
                vectors = score.vectors(contour, path, k, y, u, last)
                squares = score.products(vectors, vectors)
                sums += squares
                peaks = wp.max(peaks, squares)
                if score.diverged(contour, squares):
                    diverged = real(1.0)
            last = u
            new = State()
            for i in range(n):
                for v in range(p):
                    new[i] += at(B, wp.int64(0), i * p + v) * u[v]
                for q in range(n):
                    new[i] += at(A, wp.int64(0), i * n + q) * x[q]
            x = new
        for i in range(NORMS):
            out[i, tid] = sums[i]
            out[NORMS + i, tid] = peaks[i]
        out[2 * NORMS, tid] = diverged

    return run
