import numpy as np

from experiments.benchmarks.records.hidden_machines import KINDS, hidden_axis
from tuning.identification.linear.recording import FEEDBACK, recorded

DT, ROWS = 1e-3, 3000


def test_every_hidden_axis_follows_its_reference():
    """All cascades are stable: a slow motion is followed, with a lag and no more."""
    reference = 0.01 * np.sin(2 * np.pi * 0.5 * DT * np.arange(ROWS))
    kinds = set()
    for seed in range(30):
        axis = hidden_axis(np.random.default_rng(seed), DT)
        kinds.add(axis.takes)
        _, y = recorded(axis, reference, DT, np.random.default_rng(seed))
        assert np.abs(y).max() < 0.03, seed
        assert axis.axis.delay / DT in (0, 1, 2, 3)
    assert kinds == set(KINDS)


def test_no_position_loop_rings():
    """The loop's gain is small at every frequency; 1.17 once, and the record of that ran away."""
    hertz, resonant = np.geomspace(0.1, 400.0, 500), 0
    for seed in range(16, 26):
        random = np.random.default_rng([seed, 16])
        for _ in range(2):
            axis = hidden_axis(random, DT, "position").axis
            if len(axis.A) > 1:
                resonant += 1
                assert FEEDBACK * np.abs(axis.response(2 * np.pi * hertz)).max() < 0.51
    assert resonant > 3
