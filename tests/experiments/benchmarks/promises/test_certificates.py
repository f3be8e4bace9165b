"""Random laps of the benchmark: inside their box, of every kind, and below the bound."""

import jax
import numpy as np
import pytest

from experiments.benchmarks.promises.certificates import disturbances, random_laps


def test_disturbances_stay_inside_their_box_and_attacks_keep_most_signs():
    adverse = np.sign(np.random.default_rng(0).standard_normal((3, 40, 2)))
    drawn = jax.jit(disturbances, static_argnums=1)
    found = np.asarray(drawn(jax.random.key(1), 30, adverse))
    assert found.shape == (30, 40, 2) and np.abs(found).max() <= 1.0
    even, two, telegraph, waves, attacks = (found[kind::5] for kind in range(5))
    assert len(np.unique(even)) == even.size
    for kind in (two, telegraph, waves, attacks):
        assert set(np.unique(kind)) <= {-1.0, 0.0, 1.0}
    changes = [np.mean(kind[:, 1:] != kind[:, :-1]) for kind in (two, telegraph)]
    assert 0.4 < changes[0] < 0.6 and changes[1] < 0.4
    assert np.mean(attacks == np.asarray(adverse)[np.arange(6) % 3]) > 0.99
    assert np.array_equal(found, drawn(jax.random.key(1), 30, adverse))


@pytest.mark.slow
def test_laps_come_close_to_the_bound_and_stay_below_it():
    told = []
    reached = np.concatenate(random_laps(25, 2, 0, told.append))
    assert reached.shape == (50,) and len(told) == 2
    assert 0.95 < reached.max() <= 1 + 1e-9
