"""The front door of the tuner."""

import pytest

import tuning


def test_every_file_is_reached_from_the_package():
    assert callable(tuning.tune.tune) and callable(tuning.pareto.trade_off_front)
    assert callable(tuning.sweep.sweep) and callable(tuning.problem.Problem)
    assert callable(tuning.precompensation.precompensate)


def test_what_is_not_there_is_named():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        tuning.nothing  # noqa: B018
