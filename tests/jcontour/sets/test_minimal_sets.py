"""Supports of smallest invariant sets against closed forms, long sums and reference numbers."""

import numpy as np
import pytest

from jcontour.sets.minimal_sets import minimal_supports


def test_supports_of_the_thesis_axis_are_the_reference(axis_numbers, thesis_numbers):
    wanted = thesis_numbers["rpi"]
    scale = np.array(wanted["scale_e"])
    A = np.array(axis_numbers["A"]) * scale / scale[:, None]
    B = np.array(axis_numbers["B"]) * wanted["scale_u"] / scale
    E = np.stack([axis_numbers["E"], axis_numbers["G"]], axis=1) / scale[:, None]
    K = np.array(wanted["K_scaled"])
    found = minimal_supports(A - np.outer(B, K), E, [*np.eye(4), K], precision=1e-9)
    np.testing.assert_allclose(found.value, wanted["min_rpi_support_e_and_Ke"], rtol=2e-9)
    assert 500 < found.terms < 2000


@pytest.mark.parametrize("pole", [0.5, -0.9, 0.99])
def test_first_order_lags_have_a_closed_form(pole):
    found = minimal_supports([[pole]], [2.0], [[3.0]], precision=1e-8)
    assert found.value[0] <= 6 / (1 - abs(pole)) <= found.bound[0] * (1 + 1e-12)


def test_the_remainder_covers_what_was_left_out():
    generator = np.random.default_rng(1)
    for _ in range(20):
        M = generator.normal(size=(4, 4))
        M *= generator.uniform(0.5, 0.97) / np.abs(np.linalg.eigvals(M)).max()
        E, rows = generator.normal(size=(4, 2)), generator.normal(size=(3, 4))
        rough = minimal_supports(M, E, rows, precision=1e-2)
        fine = minimal_supports(M, E, rows, precision=1e-12)
        assert (rough.value <= fine.value).all() and (fine.value <= rough.bound).all()
        assert (rough.remainder <= 1e-2 * rough.value).all()


def test_a_loop_that_is_not_stable_has_no_bound():
    with pytest.raises(ValueError, match="spectral radius is 1.5: no bound is finite"):
        minimal_supports([[1.5]], [1.0], [[1.0]])
    with pytest.raises(ValueError, match="not stable"):
        minimal_supports([[1.0]], [1.0], [[1.0]])


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="need shapes"):
        minimal_supports(np.eye(2) / 2, [1.0, 0.0], [[1.0]])
    with pytest.raises(ValueError, match="precision: needs to be above zero"):
        minimal_supports([[0.5]], [1.0], [[1.0]], precision=0.0)
    with pytest.raises(ValueError, match="takes more than"):
        minimal_supports([[1 - 1e-7]], [1.0], [[1.0]], precision=1e-9)
