"""A cantilever on a slide: an Euler-Bernoulli beam with a load at its tip, mode by mode.

    (M + m + rho L) p'' + sum_i c_i q_i'' = F - b p'
    c_i p'' + q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = 0                       (Yuan, eq. 2.4)
    c_i = rho int phi_i dx + m phi_i(L),   tip = p + sum_i phi_i(L) q_i
Eq. 2.4 keeps the first mode, here are n of them. Clamped-free shapes phi_i have beta_i of

    1 + cosh beta cos beta + (m beta / rho L) (cos beta sinh beta - sin beta cosh beta) = 0
and w_i = (beta_i / L)^2 sqrt(E I / rho). They are orthogonal with the load at the tip, and scaled
to rho int phi_i^2 dx + m phi_i(L)^2 = 1, which is the thesis's constant alpha_i.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import zoh

NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)  # of integrals along the beam
BISECTIONS = 60  # to the last digit
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
    tip: Float[np.ndarray, " n"]  # phi_i(L) [kg^-1/2]
    share: Float[np.ndarray, " n"]  # c_i [kg^1/2]


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
    low, high = places[below], places[below + 1]
    begins = np.sign(characteristic(low))
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        same = np.sign(characteristic(middle)) == begins
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    beta = (low + high) / 2
    place = (1 + NODES) / 2
    shapes, tips = beam_shapes(beta, place), beam_shapes(beta, np.ones(1))[:, 0]
    mass = beam.density * beam.length / 2 * WEIGHTS
    size = np.sqrt(shapes**2 @ mass + beam.load * tips**2)
    share = (shapes @ mass + beam.load * tips) / size
    rate = np.sqrt(beam.stiffness / beam.density)
    return BeamModes(beta, (beta / beam.length) ** 2 * rate, tips / size, share)


def beam_shapes(
    beta: Float[np.ndarray, " n"], place: Float[np.ndarray, " x"]
) -> Float[np.ndarray, "n x"]:
    """Shapes phi_i at places x / L, without their scale; no large numbers cancel."""
    b, z = beta[:, None], beta[:, None] * place[None]
    below = np.sinh(b) + np.sin(b)
    sigma = (np.cosh(b) + np.cos(b)) / below
    grown = (np.sin(b) - np.cos(b) - np.exp(-b)) / below * np.exp(z) / 2  # (1 - sigma) e^z / 2
    return grown + (1 + sigma) / 2 * np.exp(-z) - np.cos(z) + sigma * np.sin(z)


def cantilever(
    beam: Beam,
    slide_mass: float,
    dt: float,
    modes: int = 1,
    damping: ArrayLike = 0.0,
    viscous: float = 0.0,
    force_constant: float = 1.0,
) -> LinearPlant:
    """Slide and beam; the state is (p, q, p', q'), the output is the tip [m].

    Args:
        beam: with its load.
        slide_mass: M [kg].
        dt: sample period [s].
        modes: n.
        damping: zeta_i, one number or one for each mode.
        viscous: b of the slide [N s/m].
        force_constant: force per unit of the control [N].

    Raises:
        ValueError: as `beam_modes`; or the slide has no mass.
    """
    if not slide_mass > 0:
        raise ValueError(f"slide_mass: needs to be above zero, received {slide_mass}")
    found = beam_modes(beam, modes)
    n, w = modes + 1, found.frequency
    mass = np.eye(n)
    mass[0, 0] = slide_mass + beam.load + beam.density * beam.length
    mass[0, 1:] = mass[1:, 0] = found.share
    lost = np.diag([viscous, *(2 * np.broadcast_to(np.asarray(damping), modes) * w)])
    A, B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 1))
    A[:n, n:] = np.eye(n)
    A[n:] = -np.linalg.solve(mass, np.hstack([np.diag([0.0, *w**2]), lost]))
    B[n:, 0] = np.linalg.solve(mass, np.eye(n)[0]) * force_constant
    C = np.zeros((1, 2 * n))
    C[0, :n] = [1.0, *found.tip]
    return LinearPlant(*zoh(A, B, dt), C, dt)
