import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.simulation.metrics import Metrics
from tuning.outcome import LoopPeaks, Outcome


def outcome(lost, radii):
    metrics = Metrics(
        **{name: jnp.ones((1, 2)) for name in Metrics.__dataclass_fields__ if name != "diverged"},
        diverged=np.asarray([[False, lost]]),
    )
    loops = (
        None
        if radii is None
        else LoopPeaks(jnp.ones(2), jnp.ones(2), jnp.asarray(radii), jnp.zeros(2))
    )
    return Outcome(metrics, loops)


@pytest.mark.parametrize(
    ("lost", "radii", "wanted"),
    [
        (False, None, False),
        (True, None, True),
        (False, [0.5, 0.999], False),
        (False, [0.5, 1.0], True),
        (False, [0.5, np.nan], True),
        (True, [0.5, 0.5], True),
    ],
)
def test_a_run_that_leaves_or_an_unstable_loop_is_divergence(lost, radii, wanted):
    assert bool(outcome(lost, radii).diverged) is wanted
