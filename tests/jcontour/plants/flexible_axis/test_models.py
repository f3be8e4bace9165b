import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.linear.plant import decoupled_axes
from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis
from jcontour.plants.flexible_axis.models import euler_model, zoh_model

DATA = json.loads((Path(__file__).parents[3] / "data" / "single_axis" / "models.json").read_text())
DT = 1e-3


@pytest.mark.parametrize(("name", "make"), [("euler", euler_model), ("zoh", zoh_model)])
def test_thesis_models(name, make):
    model, wanted = make(thesis_axis(), DT), DATA[name]
    np.testing.assert_allclose(model.A, wanted["A"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.asarray(model.B)[:, 0], wanted["B"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        np.sort(np.abs(np.linalg.eigvals(model.A))), wanted["abs_eig_A"], rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(model.C, [[0, 0, 1, 0]])


def test_two_axes_are_the_plant_without_dry_friction(two_flexible_axes):
    model, axis = (
        zoh_model(two_flexible_axes, DT),
        FlexibleAxis(two_flexible_axes, DT, substeps=200),
    )
    state, control = (
        axis.initial_state(np.array([0.01, 0.02]), np.array([1e-4, -2e-4])),
        jnp.array([0.7, -0.3]),
    )
    after = axis.step(state, control)
    np.testing.assert_allclose(
        model.step(jnp.concatenate(state.motion), control),
        np.concatenate(after.motion),
        rtol=1e-9,
        atol=1e-12,
    )
    np.testing.assert_allclose(
        model.initial_state(np.array([0.01, 0.02]), np.array([1e-4, -2e-4])),
        np.concatenate(state.motion),
        atol=1e-9,
    )


def test_axes_stay_decoupled_under_traced_parameters(two_flexible_axes):
    seen = []
    jax.jit(lambda parameters: seen.append(zoh_model(parameters, DT).pattern))(two_flexible_axes)
    axes = decoupled_axes(seen[0])
    assert [axis.states for axis in axes] == [(0, 2, 4, 6), (1, 3, 5, 7)] and axes[1].inputs == (1,)
