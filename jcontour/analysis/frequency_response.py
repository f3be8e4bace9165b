"""Sensitivities of frozen loops at given frequencies. Host side, any batch of loops.

S_u = (I - K P)^-1 and S_y = I + P S_u K J, with plant P and controller K; J says how a change of
the positions shows in the measurement. P and K are evaluated apart, on triangular matrices (Schur
form): much cheaper than the loop as a whole, and loops that share a plant or a controller share its
response.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from jcontour.analysis.frozen_loops import FrozenLoop


class Encoding(NamedTuple):
    """How the r positions in a measurement of q numbers are read, and changed at z.

    The measurement changes by (level + (1 - 1/z) slope) d under a change d of the positions.
    """

    read: Float[np.ndarray, "r q"]
    level: Float[np.ndarray, "q r"]
    slope: Float[np.ndarray, "q r"]

    def at(self, z: Complex[np.ndarray, "*F"]) -> Complex[np.ndarray, "*F q r"]:
        """J(z) = level + (1 - 1/z) slope."""
        return self.level + (1 - 1 / z)[..., None, None] * self.slope


class Triangular(NamedTuple):
    """A linear system with an upper triangular matrix A."""

    A: Complex[np.ndarray, "*loops n n"]
    B: Complex[np.ndarray, "*loops n p"]
    C: Complex[np.ndarray, "*loops q n"]

    @classmethod
    def of(cls, A: Float[np.ndarray, "*loops n n"], B, C) -> "Triangular":
        """Schur form."""
        T, Q = np.zeros(A.shape, complex), np.zeros(A.shape, complex)
        for index in np.ndindex(A.shape[:-2] if A.size else (0,)):
            T[index], Q[index] = scipy.linalg.schur(A[index], "complex")[:2]
        return cls(T, np.conj(np.swapaxes(Q, -1, -2)) @ B, C @ Q)

    def response(self, z: Complex[np.ndarray, "*any F"]) -> Complex[np.ndarray, "*loops F q p"]:
        """C (zI - A)^-1 B by back substitution."""
        A, B, C = self
        n, p = B.shape[-2:]
        batch = np.broadcast_shapes(A.shape[:-2], z.shape[:-1])
        F = z.shape[-1]
        X = np.zeros((*batch, n, F * p), complex)
        for k in reversed(range(n)):
            later = A[..., k : k + 1, k + 1 :] @ X[..., k + 1 :, :]
            known = B[..., k, None, :] + later.reshape(*batch, F, p)
            row = known / (z - A[..., k, k, None])[..., None]
            X[..., k, :] = row.reshape(*batch, F * p)
        values = (C @ X).reshape(*batch, C.shape[-2], F, p)
        return np.swapaxes(values, -3, -2)


class Responses(NamedTuple):
    """Plant and controller of a batch of loops, ready for many frequencies."""

    plant: Triangular
    law: Triangular
    D: Float[np.ndarray, "*loops p q"]
    encoding: Encoding

    @classmethod
    def of(cls, loop: FrozenLoop, encoding: Encoding) -> "Responses":
        """Both in triangular form, each only once where loops share it."""
        (A, B, H), (W, E, K, D) = (_without_repeats(part) for part in loop)
        return cls(Triangular.of(A, B, H), Triangular.of(W, E, K), D, encoding)

    def gains(self, frequency: Float[np.ndarray, "*any F"]) -> Float[np.ndarray, "*loops F 2"]:
        """Largest singular values of S and T, over input and output; 0 where they are infinite.

        Args:
            frequency: [rad per sample].
        """
        z = np.exp(1j * frequency)
        with np.errstate(all="ignore"):  # on a pole of plant or controller
            P, K, S = self._closed(z)
            pairs = [(S, S - np.eye(S.shape[-1]))]
            if len(self.encoding.read):
                T = (self.encoding.read @ P) @ (S @ (K @ self.encoding.at(z)))
                pairs.append((T + np.eye(T.shape[-1]), T))
            curves = [
                np.maximum.reduce([largest_singular(G) for G in both])
                for both in zip(*pairs, strict=True)
            ]
        return np.nan_to_num(np.stack(np.broadcast_arrays(*curves), axis=-1), posinf=0.0)

    def control_complementary(
        self, frequency: Float[np.ndarray, "*any F"]
    ) -> Complex[np.ndarray, "*loops F p p"]:
        """T_u = (I - K P)^-1 K P, what a disturbance of the control comes to in the control.

        Args:
            frequency: [rad per sample].
        """
        with np.errstate(all="ignore"):  # on a pole of plant or controller
            S = self._closed(np.exp(1j * frequency))[-1]
        return S - np.eye(S.shape[-1])

    def _closed(self, z: Complex[np.ndarray, "*any F"]) -> tuple[np.ndarray, ...]:
        """P, K and S_u = (I - K P)^-1."""
        P, K = self.plant.response(z), self.D[..., None, :, :] + self.law.response(z)
        return P, K, _inverse(np.eye(K.shape[-2]) - K @ P)


def _without_repeats(part: Any) -> Any:
    """The same matrices, reduced to one entry along batch axes on which none changes."""
    for axis in range(part[0].ndim - 2):
        first = [M.take([0], axis) for M in part]
        if all((M == one).all() for M, one in zip(part, first, strict=True)):
            part = type(part)(*first)
    return part


def _inverse(G: Complex[np.ndarray, "*any p p"]) -> Complex[np.ndarray, "*any p p"]:
    """Inverse; in closed form up to 2 x 2, where it is much faster and may be infinite."""
    if G.shape[-1] == 1:
        return 1 / G
    if G.shape[-1] > 2:
        return np.linalg.inv(G)
    (a, b), (c, d) = np.moveaxis(G, (-2, -1), (0, 1))
    adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    return adjugate / (a * d - b * c)[..., None, None]


def largest_singular(G: Complex[np.ndarray, "*any p p"]) -> Float[np.ndarray, "*any"]:
    """Largest singular value, in closed form up to 2 x 2."""
    if G.shape[-1] == 1:
        return np.abs(G[..., 0, 0])
    if G.shape[-1] > 2:
        bad = np.logical_not(np.isfinite(G).all(axis=(-2, -1), keepdims=True))
        largest = np.linalg.svd(np.where(bad, 0.0, G), compute_uv=False)[..., 0]
        return np.where(bad[..., 0, 0], np.nan, largest)
    square = np.sum(np.abs(G) ** 2, axis=-2)
    cross = np.abs(np.sum(np.conj(G[..., 0]) * G[..., 1], axis=-1))
    middle = (square[..., 0] + square[..., 1]) / 2
    half = (square[..., 0] - square[..., 1]) / 2
    return np.sqrt(middle + np.hypot(half, cross))
