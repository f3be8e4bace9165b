"""Units of what is stored, and the gains of a plan as a table."""

import numpy as np
import pytest

from jcontour.app.files.netcdf import save_gains
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.metrics import Metrics
from tests import canonical


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("rms_contour_error", "m"),
        ("peak_control", "mm/s"),
        ("rms_increment", "mm/s per sample"),
        ("peak_increment", "mm/s per sample"),
        ("duration", "s"),
        ("diverged", "1"),
    ],
)
def test_a_metric_has_its_unit(name, unit):
    assert METRICS[name].si("mm/s") == unit


def test_the_list_holds_every_metric_that_is_computed():
    assert list(METRICS) == list(Metrics.__dataclass_fields__)


def test_gains_are_those_of_the_plan(tmp_path):
    law = ContouringLQ(canonical.plant(2), LQWeights(3.0, 5.0, 1e-6), canonical.PREVIEW)
    plan = prepared(law, canonical.reference(canonical.square()))
    steps = canonical.STEPS - 3
    path = save_gains(plan, steps, canonical.DT, "N/kg", tmp_path / "gains.csv")
    names = path.read_text().split("\n")[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    assert names[:3] == ["k", "t_s", "F_u1_x1_N_per_kg_per_x1"]
    assert names[-1] == "f_u2_N_per_kg" and rows.shape == (steps, len(names))
    np.testing.assert_array_equal(rows[:, 2:-2], np.asarray(plan.F)[:steps].reshape(steps, -1))
