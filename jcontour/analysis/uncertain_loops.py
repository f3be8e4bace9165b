"""Frozen loops around a plant whose response is known to some part of itself only. Host side.

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
from jcontour.analysis.frozen_loops import FrozenLoop, blocks
from jcontour.analysis.loop_slopes import Ends, slope_of, turned
from jcontour.analysis.spectral import times

GRID = np.pi * np.geomspace(1e-3, 1.0, 160)  # [rad per sample] that is looked at in any case
DEVIATIONS = 1.96  # in half an interval of 95 %
BORNE = 0.5  # of W T_u: a factor of two stays on everything that is not known


class Doubt(NamedTuple):
    """How far off the response of a plant may be.

    Attributes:
        frequency: [rad per sample], rising, above 0.
        relative: largest |P_true / P - 1| behind each control. In between it is linear in the
            logarithm of the frequency; beyond the ends it stays.
    """

    frequency: Float[np.ndarray, " F"]
    relative: Float[np.ndarray, "F p"]

    def at(self, frequency: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any p"]:
        """W on its diagonal."""
        wanted, known = np.log(frequency), np.log(self.frequency)
        return np.stack([np.interp(wanted, known, one) for one in self.relative.T], axis=-1)


class Lines(NamedTuple):
    """What was measured of the response behind one control, at some frequencies.

    Attributes:
        frequency: [rad per sample].
        off: P_true / P - 1.
        half_width: of its 95 % interval.
    """

    frequency: Float[np.ndarray, " F"]
    off: Complex[np.ndarray, " F"]
    half_width: Float[np.ndarray, " F"]


def measured_sensitivity(responses: Responses, lines: Sequence[Lines]) -> float:
    """Largest sensitivity of loops around the measured response, at worst within a deviation of it.

    With P (I + E) in place of P it is (I - T_u E)^-1 S_u; one axis is replaced at a time.

    Args:
        responses: of the loops.
        lines: for every control; not all are empty.
    """
    largest = 0.0
    for k, (frequency, off, half_width) in enumerate(lines):
        T = responses.control_complementary(frequency)
        eye = np.eye(T.shape[-1])
        turned_by = off[:, None, None] * np.diag(eye[k])
        S = np.linalg.solve(eye - T @ turned_by, eye + T)
        left = np.abs(1 - T[..., k, k] * off)
        sure = left - np.abs(T[..., k, k]) * half_width / DEVIATIONS
        with np.errstate(divide="ignore"):
            worst = np.where(sure > 0, left / np.maximum(sure, 0.0), np.inf)
        largest = max(largest, float(np.max(largest_singular(S) * worst, initial=0.0)))
    return largest


def doubt_measure(
    loop: FrozenLoop,
    closed: Float[np.ndarray, "*loops N N"],
    responses: Responses,
    places: Float[np.ndarray, "*loops F"],
    doubt: Doubt,
) -> tuple[Float[np.ndarray, "*loops"], FrozenLoop]:
    """Largest sigma(W T_u), and its slope in the matrices of the loop (envelope theorem).

    Args:
        loop: stable, batched in front.
        closed: the matrix of the closed loop.
        responses: of the same loops.
        places: frequencies [rad per sample], looked at beside `GRID` and those of the doubt.
        doubt: W.
    """
    batch = places.shape[:-1]
    own = np.concatenate([GRID, doubt.frequency])
    own = np.broadcast_to(own, (*batch, own.size))
    frequency = np.concatenate([places, own], axis=-1)
    heights = largest_singular(
        doubt.at(frequency)[..., None] * responses.control_complementary(frequency)
    )
    best = np.argmax(np.nan_to_num(heights, posinf=0.0), axis=-1)[..., None]
    top = np.take_along_axis(frequency, best, axis=-1)[..., 0]
    return _at(loop, closed, np.exp(1j * top), doubt.at(top))


def _at(loop: FrozenLoop, closed, z, weight) -> tuple[np.ndarray, FrozenLoop]:
    """sigma(W T_u) at one frequency, and its slope."""
    (_, B, H), (W, _, K, D) = loop
    c, p = W.shape[-1], B.shape[-1]
    entry = blocks([[B], [np.zeros((c, p))]])
    leave = blocks([[D @ H, K]])
    resolvent = np.linalg.inv(z[..., None, None] * np.eye(closed.shape[-1]) - closed)
    U, heights, V = np.linalg.svd(weight[..., None] * (leave @ resolvent @ entry))
    of_control, control = weight * np.conj(U[..., 0]), np.conj(V[..., 0, :])
    right = times(resolvent, times(entry, control))
    left = times(turned(leave @ resolvent), of_control)
    nothing = np.zeros(())
    return heights[..., 0], slope_of(loop, left, right, Ends(control, nothing, of_control, nothing))
