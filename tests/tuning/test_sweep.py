import jax
import numpy as np
import pytest

from jcontour.simulation.evaluation import all_at_once, evaluate
from tuning.sweeps import design, grid, random_sample, sweep


def test_sweep_is_a_loop_over_designs(proportional_problem):
    problem = proportional_problem()
    designs = grid(x=[0.3, 5.0], y=[0.2, 0.6])
    given = problem.build, designs, problem.plants, problem.references, (2, 15)
    result = jax.device_get(sweep(*given))
    assert result.rms_control.shape == (4, 1, 2)
    single = jax.jit(
        lambda w: evaluate(problem.plants, problem.build(w), problem.references, (2, 15))
    )
    for k in range(4):
        for a, b in zip(
            jax.tree.leaves(design(result, k)),
            jax.tree.leaves(single(design(designs, k))),
            strict=True,
        ):
            np.testing.assert_allclose(a, b, rtol=1e-9)
    assert result.diverged[2:].all() and not result.diverged[:2].any()  # flagged, not dropped
    together = np.asarray(sweep(*given, all_at_once).rms_contour_error)
    np.testing.assert_allclose(together[:2], result.rms_contour_error[:2], rtol=1e-9)


def test_grid_has_the_last_name_fastest():
    designs = grid(alpha=[1, 2], beta=[3, 4, 5])
    np.testing.assert_array_equal(designs["alpha"], [1, 1, 1, 2, 2, 2])
    np.testing.assert_array_equal(designs["beta"], [3, 4, 5, 3, 4, 5])
    with pytest.raises(ValueError, match="beta: needs at least one value"):
        grid(alpha=[1], beta=[])


def test_random_sample_keeps_to_its_bounds_and_seed():
    draw = random_sample(200, 3, alpha=(1e-2, 1e2), rho=(2e-9, 2e-9))
    values = np.asarray(draw["alpha"])
    assert values.shape == (200,) and (values >= 1e-2).all() and (values <= 1e2).all()
    assert abs(np.mean(np.log10(values))) < 0.3  # a logarithmic scale
    np.testing.assert_allclose(draw["rho"], 2e-9, rtol=1e-12)
    np.testing.assert_array_equal(
        random_sample(200, 3, alpha=(1e-2, 1e2), rho=(2e-9, 2e-9))["alpha"], values
    )
    assert not np.array_equal(random_sample(200, 4, alpha=(1e-2, 1e2))["alpha"], values)


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (2.0, 1.0), (1.0, np.inf), (np.nan, 1.0)])
def test_bad_ranges_are_named(bounds):
    with pytest.raises(ValueError, match="alpha: needs bounds"):
        random_sample(3, 0, alpha=bounds)
    with pytest.raises(ValueError, match="count"):
        random_sample(0, 0, alpha=(1.0, 2.0))
