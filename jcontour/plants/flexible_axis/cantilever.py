"""Modes of a cantilever: an Euler-Bernoulli beam with a load at its tip (Yuan, section 2.2).

Clamped-free shapes phi_i have beta_i of

    1 + cosh beta cos beta + (m beta / rho L) (cos beta sinh beta - sin beta cosh beta) = 0
and w_i = (beta_i / L)^2 sqrt(E I / rho). They are orthogonal with the load at the tip.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

FINENESS = 64  # places in pi of beta at which the sign of the characteristic equation is looked at


class Beam(NamedTuple):
    """A uniform beam with a load at its tip.

    Attributes:
        length: L [m].
        stiffness: E I [N m^2].
        density: rho, mass per length [kg/m].
        load: m at the tip [kg].
    """

    length: float
    stiffness: float
    density: float
    load: float = 0.0


class BeamModes(NamedTuple):
    """The first n modes of a clamped beam."""

    beta: Float[np.ndarray, " n"]  # roots of the characteristic equation
    frequency: Float[np.ndarray, " n"]  # w_i [rad/s]


def thesis_beam(load: float = 0.0) -> Beam:
    """The aluminium beam of Yuan's test bench, section 3.2: 350 mm, 40 x 4 mm."""
    width, thickness = 0.04, 0.004
    return Beam(0.35, 71e9 * width * thickness**3 / 12, 2.7e3 * width * thickness, load)


def beam_modes(beam: Beam, count: int) -> BeamModes:
    """The first modes of a beam.

    >>> modes = beam_modes(thesis_beam(), 3)
    >>> (modes.frequency / (2 * np.pi)).round(2).tolist()  # [Hz]
    [27.05, 169.51, 474.64]

    Raises:
        ValueError: a number of the beam is not above zero (the load may be), or no mode is asked
            for.
    """
    if not (min(beam[:3]) > 0 and beam.load >= 0 and np.isfinite(beam).all()):
        raise ValueError(f"beam: needs length, stiffness and density above zero, received {beam}")
    if count < 1:
        raise ValueError(f"count: needs at least one mode, received {count}")
    ratio = beam.load / (beam.density * beam.length)

    def characteristic(beta):  # over cosh beta
        return (
            1 / np.cosh(beta)
            + np.cos(beta)
            + ratio * beta * (np.cos(beta) * np.tanh(beta) - np.sin(beta))
        )

    places = np.linspace(1e-3, np.pi * (count + 0.5), FINENESS * (count + 1))
    below = np.flatnonzero(np.diff(np.sign(characteristic(places))))[:count]
    ends = zip(places[below], places[below + 1], strict=True)
    beta = np.array([brentq(characteristic, *pair, xtol=1e-15) for pair in ends])
    return BeamModes(beta, (beta / beam.length) ** 2 * np.sqrt(beam.stiffness / beam.density))


def beam_shapes(
    beta: Float[np.ndarray, " n"], place: Float[np.ndarray, " x"]
) -> Float[np.ndarray, "n x"]:
    """Shapes phi_i at places x / L, without their scale; no large numbers cancel."""
    b, z = beta[:, None], beta[:, None] * place[None]
    below = np.sinh(b) + np.sin(b)
    sigma = (np.cosh(b) + np.cos(b)) / below
    grown = (np.sin(b) - np.cos(b) - np.exp(-b)) / below * np.exp(z) / 2  # (1 - sigma) e^z / 2
    return grown + (1 + sigma) / 2 * np.exp(-z) - np.cos(z) + sigma * np.sin(z)
