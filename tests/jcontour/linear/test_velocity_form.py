import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from jcontour.linear.velocity_form import velocity_form
from jcontour.plants.linear_machines import bridgeport
from jcontour.plants.xy_table import xy_table

DATA = json.loads((Path(__file__).parents[2] / "data" / "mpcc" / "reference.json").read_text())


@pytest.mark.parametrize("dt", (0.004, 0.001))
def test_eigenvalues_are_the_reference_ones(dt):
    moduli = np.sort(np.abs(np.linalg.eigvals(np.asarray(velocity_form(xy_table(dt)).A))))
    np.testing.assert_allclose(
        moduli, DATA["plant"][f"zoh_{dt}"]["eig_velocity_form_abs"], rtol=0, atol=1e-9
    )


@pytest.mark.parametrize(
    "make", (partial(xy_table, 0.004), bridgeport), ids=("table", "bridgeport")
)
def test_predicts_the_plant_whose_control_is_one_sample_late_even_under_a_constant_load(make):
    plant = make()
    rng = np.random.default_rng(0)
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    n, p = plant.states, plant.inputs
    controls, load = rng.normal(size=(40, p)), 1e-4 * rng.normal(size=n)
    x = [rng.normal(size=n)]
    for k in range(39):
        x.append(
            A @ x[-1] + B @ controls[k] + load
        )  # control k acts during [k, k + 1): the model calls it u(k - 1)
    model = velocity_form(plant)
    state = np.concatenate([x[1] - x[0], controls[1] - controls[0], C @ x[1]])
    for k in range(1, 39):
        np.testing.assert_allclose(model.output(state), C @ x[k], rtol=1e-9, atol=1e-9)
        state = np.asarray(model.step(state, controls[k + 1] - controls[k]))
