"""Weights of contouring control: what they refuse, and the matrix of the control changes."""

import numpy as np
import pytest

from jcontour.mpc.contouring.contouring_weights import ContouringWeights


@pytest.mark.parametrize("given", [60.0, (60.0, 60.0), [[60.0, 0.0], [0.0, 60.0]]])
def test_one_number_stands_for_all_inputs(given):
    matrix = ContouringWeights(control_change=given).control_matrix(2)
    np.testing.assert_array_equal(matrix, 60.0 * np.eye(2))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("contour_error", -1.0),
        ("progress", float("nan")),
        ("lag", float("inf")),
        ("speed_change", 0.0),
        ("length_unit", 0.0),
        ("period", -1.0),
    ],
)
def test_bad_weights(field, value):
    with pytest.raises(ValueError, match=f"^{field}: needs to be finite"):
        ContouringWeights(**{field: value})


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], "positive semidefinite"),
        (0.0, "positive definite"),
        ((1.0, 2.0, 3.0), "one for each of 2 inputs"),
        (np.eye(3), "needs shape"),
    ],
)
def test_bad_control_matrices(given, says):
    with pytest.raises(ValueError, match=f"^control_change: .*{says}"):
        ContouringWeights(control_change=given).control_matrix(2)
