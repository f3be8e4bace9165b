import jax
import numpy as np
import pytest
from scipy.integrate import quad

from jcontour.geometry.periodic_splines import periodic_spline, polar_lobes
from tests.reference_data import numbers_of

PATH = numbers_of("mpcc/reference")["path"]


def test_lobes_are_the_reference_ones():
    contour = polar_lobes(30e-3, 10e-3, 4)
    np.testing.assert_allclose(contour.length, 1e-3 * PATH["length_mm"], rtol=1e-13)
    starts = np.asarray(contour.start)[::16]
    np.testing.assert_allclose(
        contour.position(starts), 1e-3 * np.array(PATH["knots_every_16"])[:-1], rtol=0, atol=1e-14
    )
    assert bool(contour.closed) and contour.rate.size == 320


def test_other_lobes_have_the_length_of_the_polar_curve():
    contour = polar_lobes(25e-3, 8e-3, 3, phase=0.7, knots=240)
    length = quad(
        lambda a: np.hypot(25e-3 + 8e-3 * np.cos(3 * a), 24e-3 * np.sin(3 * a)),
        0,
        2 * np.pi,
        epsabs=1e-14,
        limit=200,
    )[0]
    np.testing.assert_allclose(contour.length, length, rtol=1e-11)


def test_four_derivatives_are_continuous_and_the_speed_is_nearly_one():
    contour = polar_lobes(30e-3, 10e-3, 4)
    polynomial, h = np.asarray(contour.polynomial), float(np.asarray(contour.extent)[0])
    power = np.arange(6)
    for derivative in range(5):
        fall = np.prod([power - i for i in range(derivative)], axis=0) * np.ones(6)
        lift = np.where(power >= derivative, h ** np.maximum(power - derivative, 0.0), 0.0)
        end, begin = (
            np.einsum("pic,i->pc", polynomial, fall * lift),
            fall[derivative] * polynomial[:, derivative],
        )
        np.testing.assert_allclose(
            end, np.roll(begin, -1, axis=0), rtol=0, atol=1e-9 * np.abs(begin).max() + 1e-12
        )
    pieces = jax.tree.map(lambda rows: np.asarray(rows)[None], contour.pieces)
    speed = np.linalg.norm(pieces.jet(np.linspace(0, h, 9)[:, None])[1], axis=-1)
    assert 3e-4 < np.abs(speed - 1).max() < 4.5e-4  # the reference says up to 4e-4


def test_a_spline_without_a_length_takes_its_own():
    angle = 2 * np.pi * np.arange(40) / 40
    contour = periodic_spline(0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    np.testing.assert_allclose(contour.length, 2 * np.pi * 0.02, rtol=1e-8)
    s = np.linspace(0, float(contour.length), 333)
    np.testing.assert_allclose(np.linalg.norm(contour.position(s), axis=1), 0.02, rtol=1e-8)
    np.testing.assert_allclose(contour.curvature(s), 50.0, rtol=1e-4)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: polar_lobes(0.01, 0.02, 4), "base"),
        (lambda: polar_lobes(0.03, 0.01, 0), "lobes"),
        (lambda: polar_lobes(0.03, 0.01, 4, knots=5), "knots"),
        (lambda: polar_lobes(0.03, 0.01, 2.5), "lobes"),
        (lambda: periodic_spline(np.zeros((4, 2))), "points"),
        (lambda: periodic_spline(np.zeros((8, 2))), "repeated"),
        (lambda: periodic_spline(np.full((8, 2), np.nan)), "finite"),
        (lambda: periodic_spline(np.random.default_rng(0).normal(size=(8, 2)), 0.0), "length"),
    ],
)
def test_bad_input_is_one_line(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_lobes_are_turned_by_the_phase():
    """Where the path is at the angle a, it is as far away as the polar curve at a - phase."""
    phase = 0.7
    path = polar_lobes(20e-3, 4e-3, 3, phase)
    x, y = np.asarray(path.position(np.linspace(0, float(path.length), 200))).T
    assert (x[0], y[0]) == pytest.approx((24e-3 * np.cos(phase), 24e-3 * np.sin(phase)), abs=1e-12)
    radius = 20e-3 + 4e-3 * np.cos(3 * (np.arctan2(y, x) - phase))
    np.testing.assert_allclose(np.hypot(x, y), radius, atol=1e-8)


def test_a_radius_below_zero_between_the_lobes_is_refused():
    with pytest.raises(ValueError, match="^base: "):
        polar_lobes(1e-3, -2e-3, 3)
