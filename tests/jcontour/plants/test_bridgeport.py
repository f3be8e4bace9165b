import json
from fractions import Fraction
from pathlib import Path

import numpy as np

from jcontour.linear.plant import decoupled_axes, spectral_radius
from jcontour.plants.bridgeport import bridgeport, exact_bridgeport

PLANTS = json.loads((Path(__file__).parents[2] / "data" / "mcnab" / "plants.json").read_text())


def test_matrices_are_the_reference_ones():
    plant = bridgeport()
    for name in "ABC":
        np.testing.assert_allclose(
            getattr(plant, name), PLANTS["bridgeport"][name], rtol=4e-16, atol=0
        )
    assert plant.dt == 0.5e-3


def test_two_axes_with_an_integrator_each_and_the_same_ramp_gain():
    plant = bridgeport()
    assert decoupled_axes(plant.pattern) == (((0, 1, 2), (0,), (0,)), ((3, 4, 5, 6, 7), (1,), (1,)))
    assert abs(float(spectral_radius(plant.A)) - 1.000041) < 1e-6  # the paper prints four decimals
    gains = []
    for states, inputs, outputs in decoupled_axes(plant.pattern):
        A, B = (
            np.asarray(plant.A)[np.ix_(states, states)],
            np.asarray(plant.B)[np.ix_(states, inputs)],
        )
        values, right = np.linalg.eig(A)
        left = np.linalg.inv(right)
        slow = np.argmax(np.abs(values))
        residue = (
            np.asarray(plant.C)[np.ix_(outputs, states)] @ right[:, [slow]] @ left[[slow]] @ B
        ).real.item()
        gains.append(residue / plant.dt)
        assert np.sort(np.abs(values))[-2] < 0.9
    np.testing.assert_allclose(gains, [0.02261, 0.02234], rtol=5e-3)


def determinant(rows):
    if not rows:
        return 1
    minors = ([row[:j] + row[j + 1 :] for row in rows[1:]] for j in range(len(rows)))
    return sum((-1) ** j * rows[0][j] * determinant(minor) for j, minor in enumerate(minors))


def test_exact_integrators_are_within_the_rounding_of_the_paper():
    """det(A - I) of every axis in rational numbers; for the printed matrices 1e-5 to 1e-4."""
    printed, exact = bridgeport(), exact_bridgeport()
    np.testing.assert_allclose(np.round(np.asarray(exact.A), 4), printed.A, rtol=1e-15)
    assert (
        exact.pattern == printed.pattern and np.count_nonzero(np.not_equal(exact.A, printed.A)) == 2
    )
    for name in ("B", "C", "dt"):
        np.testing.assert_array_equal(getattr(exact, name), getattr(printed, name))
    for states, _, _ in decoupled_axes(exact.pattern):
        rows = (np.asarray(exact.A)[np.ix_(states, states)]).tolist()
        lifted = [
            [Fraction(value) - (i == j) for j, value in enumerate(row)]
            for i, row in enumerate(rows)
        ]
        assert abs(determinant(lifted)) < 1e-17
