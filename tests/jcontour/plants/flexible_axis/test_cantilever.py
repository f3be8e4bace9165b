"""The cantilever against closed forms and finite elements."""

import numpy as np
import pytest

from jcontour.plants.flexible_axis.cantilever import beam_modes, beam_shapes, thesis_beam

# roots of 1 + cosh b cos b = 0, from tables
ROOTS = [1.8751040687119611, 4.694091132974174, 7.854757438237613, 10.995540734875467]


def elements(beam, count=60):
    """Frequencies of Hermite beam elements with a load at the tip [rad/s]."""
    h, size = beam.length / count, 2 * count + 2
    k = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]]
    k += [[-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    m = [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]]
    m += [[54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    K, M = np.zeros((size, size)), np.zeros((size, size))
    for i in range(count):
        part = slice(2 * i, 2 * i + 4)
        K[part, part] += beam.stiffness / h**3 * np.array(k)
        M[part, part] += beam.density * h / 420 * np.array(m)
    M[-2, -2] += beam.load
    values = np.linalg.eigvals(np.linalg.solve(M[2:, 2:], K[2:, 2:]))
    return np.sqrt(np.sort(values.real))


def test_frequencies_are_those_of_the_closed_form():
    beam, modes = thesis_beam(), beam_modes(thesis_beam(), 4)
    np.testing.assert_allclose(modes.beta, ROOTS, rtol=1e-12)
    wanted = (np.array(ROOTS) / beam.length) ** 2 * np.sqrt(beam.stiffness / beam.density)
    np.testing.assert_allclose(modes.frequency, wanted, rtol=1e-10)
    assert modes.frequency[0] / (2 * np.pi) == pytest.approx(27.05, abs=0.01)  # [Hz]


def test_a_load_at_the_tip_is_that_of_finite_elements():
    beam = thesis_beam(load=0.3)
    found = beam_modes(beam, 3)
    np.testing.assert_allclose(found.frequency, elements(beam)[:3], rtol=1e-6)
    places, weights = np.polynomial.legendre.leggauss(80)
    shapes = beam_shapes(found.beta, (1 + places) / 2)
    tip = beam_shapes(found.beta, np.ones(1))[:, 0]
    mass = beam.density * beam.length / 2 * weights
    products = (shapes * mass) @ shapes.T + beam.load * np.outer(tip, tip)
    sizes = np.sqrt(np.diag(products))
    np.testing.assert_allclose(products / np.outer(sizes, sizes), np.eye(3), rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("load", "count", "why"), [(-1.0, 1, "beam: needs length"), (0.0, 0, "count: needs at least")]
)
def test_beams_that_cannot_be_are_refused(load, count, why):
    with pytest.raises(ValueError, match=why):
        beam_modes(thesis_beam()._replace(load=load), count)
