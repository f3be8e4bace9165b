"""The receding-horizon LQ run as a plain loop, in NumPy and compiled by numba.

`jcontour bench lq` compares itself with these loops.
"""

from collections.abc import Callable

import numba
import numpy as np


def plain_loop(product: Callable, inverse: Callable) -> Callable:
    """RMS tracking and projected error of one run.

    A Riccati sweep over the horizon comes before every step (McNab & Tsao, eqs. 11-13).
    """

    def run(machine, path, weights, steps, preview, x):
        (A, B, C), (tangent, y_d) = machine, path
        n, m = A.shape[0], C.shape[0]
        alpha, beta, rho = weights
        At, Bt, Ct = np.ascontiguousarray(A.T), np.ascontiguousarray(B.T), np.ascontiguousarray(C.T)
        tracking, projected = 0.0, 0.0
        for k in range(steps):
            e = product(C, x)[:, 0] - y_d[k]
            lag = np.sum(e * tangent[k])
            tracking += np.sum(e**2)
            projected += np.sum((e - lag * tangent[k]) ** 2)
            H, g = np.zeros((n, n)), np.zeros((n, 1))
            for j in range(preview, 0, -1):
                if j < preview:
                    HB, BH = product(H, B), product(Bt, H)
                    K = product(inverse(product(Bt, HB) + rho * np.eye(B.shape[1])), product(BH, A))
                    closed = A - product(B, K)
                    H, g = (
                        product(At, product(H, closed)),
                        product(np.ascontiguousarray(closed.T), g),
                    )
                r = tangent[k + j]
                Q = (alpha + beta) * np.eye(m) - beta * r.reshape(m, 1) * r
                CQ = product(Ct, Q)
                H, g = H + product(CQ, C), g - product(CQ, y_d[k + j].reshape(m, 1))
            G = inverse(product(product(Bt, H), B) + rho * np.eye(B.shape[1]))
            u = -product(G, product(Bt, product(H, product(A, x)) + g))
            x = product(A, x) + product(B, u)
        return np.sqrt(tracking / steps), np.sqrt(projected / steps)

    return run


@numba.njit
def closed_form(M):
    """Inverse of a 2 x 2 matrix."""
    return np.array([[M[1, 1], -M[0, 1]], [-M[1, 0], M[0, 0]]]) / (
        M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    )


@numba.njit
def written_out(X, Y):
    """X Y by three loops: for matrices as small as these faster than a call of a library."""
    Z = np.zeros((X.shape[0], Y.shape[1]))
    for i in range(X.shape[0]):
        for k in range(X.shape[1]):
            for j in range(Y.shape[1]):
                Z[i, j] += X[i, k] * Y[k, j]
    return Z


numpy_loop = plain_loop(np.matmul, np.linalg.inv)
compiled_loop = numba.njit(plain_loop(written_out, closed_form))
