import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.linear.model_schedule import ModelSchedule
from jcontour.linear.plant import LinearPlant

POINTS = [-0.2, 0.1, 0.3]


@pytest.fixture(scope="module")
def schedule():
    random = np.random.default_rng(0)
    matrices = [random.standard_normal((3, *shape)) for shape in ((4, 4), (4, 2), (2, 4))]
    models = eqx.filter_jit(eqx.filter_vmap(lambda *m: LinearPlant(*m, 1e-3)))(*matrices)
    return ModelSchedule(models, POINTS, output=1)


def test_models_between_the_points_are_on_straight_lines(schedule):
    """Entry by entry, against numpy.interp."""
    path = np.array([[9.0, -0.2], [9.0, -0.13], [9.0, 0.1], [9.0, 0.25], [9.0, 0.3]])
    along = schedule.along(placed(path))
    for actual, rows in (
        (along.A, schedule.models.A),
        (along.B, schedule.models.B),
        (along.C, schedule.models.C),
    ):
        for entry in np.ndindex(*rows.shape[1:]):
            np.testing.assert_allclose(
                actual[:, *entry], np.interp(path[:, 1], POINTS, rows[:, *entry]), rtol=1e-13
            )
    assert along.dt == 1e-3


def test_a_path_beyond_the_points_is_refused(schedule):
    path = np.array([[0.0, 0.0], [0.0, 0.31]])
    with pytest.raises(
        ValueError,
        match=r"points: the models cover -0.2 to 0.3 m of output 1, the path goes from 0 to 0.31 m",
    ):
        schedule.along(placed(path))
    traced = np.asarray(jax.jit(lambda position: schedule.along(position).A)(path))
    assert np.isfinite(traced[0]).all() and np.isnan(traced[1]).all()


@pytest.mark.parametrize(
    ("points", "message"),
    [([0.0], "two positions"), ([0.1, 0.0, 0.2], "rising"), ([0.0, 0.1], "received 3")],
)
def test_bad_schedules_are_named(schedule, points, message):
    with pytest.raises(ValueError, match=message):
        ModelSchedule(schedule.models, points, output=0)
