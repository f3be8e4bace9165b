"""Frozen loops around a plant with a relative uncertainty of its response. Host side.

The true plant is P (I + E W), E diagonal with entries of magnitude at most 1 at every frequency, W
diagonal: the relative uncertainty of the response behind each control. The closed loop is stable
for all of them if the nominal one is, and

    max over w of sigma(W T_u) < 1,        T_u = (I - K P)^-1 K P
(small gain; Skogestad & Postlethwaite, Multivariable Feedback Control, section 8.6). For one axis
by itself this is necessary too.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from jcontour.analysis.frequency_response import Responses, largest_singular
from jcontour.analysis.frozen_loops import (
    Ends,
    FrozenLoop,
    blocks,
    slope_of,
    times,
    turned,
)

GRID = np.pi * np.geomspace(1e-3, 1.0, 160)  # [rad per sample] searched in any case
DEVIATIONS = 1.96  # in half an interval of 95 %
BORNE = 0.5  # largest W T_u accepted: a margin of two on the uncertainty
NEARER = 0.5  # of its sensitivity, by which a loop at other amplitudes is judged


class Lines(NamedTuple):
    """What was measured of the response behind one control, at some frequencies."""

    frequency: Float[np.ndarray, " F"]  # [rad per sample]
    error: Complex[np.ndarray, " F"]  # relative: P_true / P - 1
    half_width: Float[np.ndarray, " F"]  # of its 95 % interval


class ResponseUncertainty(NamedTuple):
    """Relative uncertainty of the response of a plant."""

    frequency: Float[np.ndarray, " F"]  # [rad per sample], rising, above 0
    # largest |P_true / P - 1| behind each control. In between it is linear in the logarithm of the
    # frequency; beyond the ends it stays.
    relative: Float[np.ndarray, "F p"]
    # what was measured of the nominal plant behind each control; empty where nothing was
    lines: tuple[Lines, ...] = ()
    # its responses at other amplitudes, likewise: less and less of a coupling, a load that dry
    # friction damps; a loop has to be stable with them, and may be nearer to instability
    other_amplitudes: tuple[Lines, ...] = ()

    def at(self, frequency: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any p"]:
        """W on its diagonal."""
        wanted, known = np.log(frequency), np.log(self.frequency)
        return np.stack([np.interp(wanted, known, one) for one in self.relative.T], axis=-1)


def measured_sensitivity(
    loop: FrozenLoop,
    closed: Float[np.ndarray, "*loops N N"],
    responses: Responses,
    lines: Sequence[Lines],
) -> tuple[Float[np.ndarray, "*loops"], FrozenLoop]:
    """Largest sensitivity of loops around a measured response, and its slope (envelope theorem).

    With P (I + E) in place of P it is (I - T_u E)^-1 S_u. One axis is replaced at a time; its E is
    the one within a deviation of the measured one that comes nearest to instability. Where E makes
    the loop unstable the sensitivity is infinite, with slope 0.

    Args:
        loop: stable, batched in front.
        closed: the matrix of the closed loop.
        responses: of the same loops.
        lines: for every control; not all are empty.
    """
    values, frequencies, errors = [], [], []
    for k, (frequency, error, half_width) in enumerate(lines):
        T = responses.control_complementary(frequency)
        left = 1 - T[..., k, k] * error
        radius = np.abs(T[..., k, k]) * half_width / DEVIATIONS
        nearer = np.minimum(radius / np.maximum(np.abs(left), 1e-300), 1.0) * left
        E = error + nearer / np.where(T[..., k, k] == 0, 1e-300, T[..., k, k])
        chosen = np.eye(T.shape[-1])[k]
        S = _around(T, E[..., None] * chosen)
        fails = (np.real(left) <= 0) & (np.abs(np.imag(left)) <= radius) | (radius >= np.abs(left))
        values.append(np.where(fails, np.inf, largest_singular(S)))
        frequencies.append(np.broadcast_to(frequency, values[-1].shape))
        errors.append(E[..., None] * chosen)
    height = np.concatenate(values, axis=-1)
    best = np.argmax(height, axis=-1)[..., None]
    top = np.take_along_axis(height, best, axis=-1)[..., 0]
    w = np.take_along_axis(np.concatenate(frequencies, axis=-1), best, axis=-1)[..., 0]
    E = np.take_along_axis(np.concatenate(errors, axis=-2), best[..., None], axis=-2)[..., 0, :]
    T = _complementary(loop, closed, np.exp(1j * w))[0]
    U, _, V = np.linalg.svd(_around(T, E))
    u, v = U[..., 0], np.conj(V[..., 0, :])
    own = np.swapaxes(np.eye(T.shape[-1]) - T * E[..., None, :], -1, -2)
    left_vector = np.linalg.solve(own, np.conj(u)[..., None])[..., 0]
    control = v + E * times(_around(T, E), v)
    slope = _slope(loop, closed, np.exp(1j * w), left_vector, control)
    return top, slope.only(np.isfinite(top))


def _around(T: Complex[np.ndarray, "*any p p"], E: Complex[np.ndarray, "*any p"]) -> np.ndarray:
    """(I - T E)^-1 (I + T) with a diagonal E."""
    eye = np.eye(T.shape[-1])
    return np.linalg.solve(eye - T * E[..., None, :], eye + T)


def uncertainty_measure(
    loop: FrozenLoop,
    closed: Float[np.ndarray, "*loops N N"],
    responses: Responses,
    frequencies: Float[np.ndarray, "*loops F"],
    uncertainty: ResponseUncertainty,
) -> tuple[Float[np.ndarray, "*loops"], FrozenLoop]:
    """Largest sigma(W T_u), and its slope in the matrices of the loop (envelope theorem).

    Args:
        loop: stable, batched in front.
        closed: the matrix of the closed loop.
        responses: of the same loops.
        frequencies: [rad per sample], searched beside `GRID` and those of the uncertainty.
        uncertainty: W.
    """
    batch = frequencies.shape[:-1]
    own = np.concatenate([GRID, uncertainty.frequency])
    own = np.broadcast_to(own, (*batch, own.size))
    frequency = np.concatenate([frequencies, own], axis=-1)
    values = largest_singular(
        uncertainty.at(frequency)[..., None] * responses.control_complementary(frequency)
    )
    best = np.argmax(np.nan_to_num(values, posinf=0.0), axis=-1)[..., None]
    top = np.take_along_axis(frequency, best, axis=-1)[..., 0]
    return _at(loop, closed, np.exp(1j * top), uncertainty.at(top))


def _at(loop: FrozenLoop, closed, z, weight) -> tuple[np.ndarray, FrozenLoop]:
    """sigma(W T_u) at one frequency, and its slope."""
    T, _ = _complementary(loop, closed, z)
    U, values, V = np.linalg.svd(weight[..., None] * T)
    left_vector, control = weight * np.conj(U[..., 0]), np.conj(V[..., 0, :])
    return values[..., 0], _slope(loop, closed, z, left_vector, control)


def _complementary(loop: FrozenLoop, closed, z) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """T_u at one frequency, and its factors: output map, resolvent, input map."""
    (_, B, H), (W, _, K, D) = loop
    entry = blocks([[B], [np.zeros((W.shape[-1], B.shape[-1]))]])
    leave = blocks([[D @ H, K]])
    resolvent = np.linalg.inv(z[..., None, None] * np.eye(closed.shape[-1]) - closed)
    return leave @ resolvent @ entry, (leave, resolvent, entry)


def _slope(loop: FrozenLoop, closed, z, left_vector, control) -> FrozenLoop:
    """Slope of Re(left_vector' T_u control) in the matrices of the loop."""
    leave, resolvent, entry = _complementary(loop, closed, z)[1]
    right = times(resolvent, times(entry, control))
    left = times(turned(leave @ resolvent), left_vector)
    nothing = np.zeros(())
    return slope_of(loop, left, right, Ends(control, nothing, left_vector, nothing))
