"""l1 optima against the reference, closed forms and the weak duality of any filter."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

from jcontour.controllers.feedforward.l1 import l1_optimum
from jcontour.controllers.feedforward.model_matching import ModelMatching


def test_general_zeros_are_the_reference(general_problems):
    for problem, wanted in general_problems:
        actual = l1_optimum(problem)
        assert actual.cost == pytest.approx(wanted["J_l1"], rel=1e-9), wanted["name"]
        assert abs(actual.gap) < 1e-9
        assert list(actual.support) == wanted["l1_support"]
        taps = np.zeros(max(actual.taps.size, len(wanted["e_l1"])))
        taps[: actual.taps.size] = actual.taps
        taps[: len(wanted["e_l1"])] -= wanted["e_l1"]
        np.testing.assert_allclose(taps, 0, atol=1e-8)


def test_no_gap_on_random_zeros(random_problems):
    for problem in random_problems:
        actual = l1_optimum(problem)
        assert abs(actual.gap) <= 1e-9 * max(actual.cost, 1.0)
        values = polynomial.polyval(problem.zeros, actual.taps)
        np.testing.assert_allclose(values, problem.values, rtol=1e-9, atol=1e-9)


def test_no_other_filter_is_better(random_problems):
    """Weak duality on filters that meet the conditions: the optimum plus multiples of the zeros."""
    random = np.random.default_rng(1)
    for problem in random_problems[:20]:
        actual = l1_optimum(problem)
        vanishing = np.real(polynomial.polyfromroots(problem.zeros))
        for size in (1e-6, 1e-2):
            change = np.convolve(size * random.standard_normal(5), vanishing)
            other = polynomial.polyadd(actual.taps, change)
            assert np.abs(other).sum() >= actual.bound * (1 - 1e-12)


@pytest.mark.parametrize("zero", [-0.3075, 0.6, -0.95])
@pytest.mark.parametrize("preview", [1, 4])
def test_one_zero_beside_the_origin(zero, preview):
    """|b|^(N_p - 1): Alter & Tsao, eq. 8."""
    model = np.eye(1, preview + 1, preview)[0]
    actual = l1_optimum(ModelMatching([0.0, zero], model))
    assert actual.cost == pytest.approx(abs(zero) ** (preview - 1), rel=1e-12)
    assert actual.bound == pytest.approx(actual.cost, rel=1e-12)


def test_zeros_on_the_circle_are_table_2(alter_tsao):
    for row in alter_tsao["table2"]:
        for which in ("b_printed", "b_fitted"):
            b, wanted = alter_tsao[which], row[which]
            through = wanted["M_b"] / (1 - b) * np.array([1.0, -1.0])  # M_b at b, 0 at 1
            actual = l1_optimum(ModelMatching([b], through), on_circle=[1.0], taps=40)
            assert actual.cost == pytest.approx(wanted["lp_J1"], rel=1e-9)
            np.testing.assert_allclose(actual.taps[:2], wanted["lp_e_first4"][:2], rtol=1e-8)
            assert actual.bound == pytest.approx(actual.cost, rel=1e-9)


def test_a_pair_on_the_circle():
    pair = np.exp([0.7j, -0.7j])
    actual = l1_optimum(ModelMatching([-0.4], [1.0, 0.5]), on_circle=pair, taps=60)
    values = polynomial.polyval(pair, actual.taps)
    np.testing.assert_allclose(values, 1 + 0.5 * pair, atol=1e-9)
    assert actual.bound <= actual.cost * (1 + 1e-12)


@pytest.mark.parametrize(
    "circle", [[1j, -1j], [1.0, -1.0], [1.0, -1.0, 1j, -1j], np.exp([0.7j, -0.7j, 2.1j, -2.1j])]
)
def test_several_conditions_on_the_circle_without_a_length(circle):
    """All conditions hold, and no combination of the zeros' polynomial makes the filter cheaper."""
    problem = ModelMatching([-0.3], [0.0, 0.0, 1.0])
    actual = l1_optimum(problem, on_circle=circle)
    for zero in (-0.3, *circle):
        assert polynomial.polyval(zero, actual.taps) == pytest.approx(zero**2, abs=1e-9)
    assert actual.bound <= actual.cost * (1 + 1e-12)
    vanishing = np.real(polynomial.polyfromroots([-0.3, *circle]))
    random = np.random.default_rng(2)
    for size in (1e-6, 1e-3, 1e-1):
        change = np.convolve(size * random.standard_normal(3), vanishing)
        assert np.abs(polynomial.polyadd(actual.taps, change)).sum() >= actual.bound * (1 - 1e-12)


def test_a_filter_that_misses_the_circle_is_refused():
    with pytest.raises(ValueError, match="no filter of 2 taps"):
        l1_optimum(ModelMatching([-0.3], [0.0, 0.0, 1.0]), on_circle=[1j, -1j], taps=2)
    with pytest.raises(ValueError, match="on_circle: the complex zero .* without its conjugate"):
        l1_optimum(ModelMatching([-0.3], [0.0, 0.0, 1.0]), on_circle=[-1j])


def test_no_zero_and_bad_input():
    assert l1_optimum(ModelMatching([], [1.0])).cost == 0
    with pytest.raises(ValueError, match="on the unit circle"):
        l1_optimum(ModelMatching([0.3], [1.0]), on_circle=[0.9])
    with pytest.raises(ValueError, match="no filter of 1 taps"):
        l1_optimum(ModelMatching([0.3, -0.5], [0.0, 1.0]), taps=1)
