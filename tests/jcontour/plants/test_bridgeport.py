import json
from pathlib import Path

import numpy as np

from jcontour.linear.plant import decoupled_axes, spectral_radius
from jcontour.plants.bridgeport import bridgeport

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
