"""Stored predictions of public records; the prediction of a drive is sound."""

from pathlib import Path

import numpy as np
import pytest

from experiments.benchmarks.records.public import (
    RECORDS,
    Sliding,
    cascade_factors,
    emps_error,
    stored,
)
from jcontour.app.files.log_table import read_table
from jcontour.plants import emps

HERE = Path(__file__).parents[4] / "shared" / "data" / "records"


def published(friction=emps.COULOMB / emps.DRIVE_GAIN):
    """The axis with its published parameters."""
    gain, constant = emps.DRIVE_GAIN / emps.VISCOUS, emps.MASS / emps.VISCOUS
    return Sliding(gain, constant, friction, -emps.OFFSET / emps.DRIVE_GAIN)


def test_what_is_stored_are_predictions_of_known_records():
    assert {row.record for row in stored()} <= {title for title, _ in RECORDS.values()}


def test_a_drive_without_friction_lags_by_its_speed():
    """A ramp: the cascade's lag is v / K_p, and the voltage that holds the speed over K_v K_p."""
    time = emps.SAMPLE_PERIOD * np.arange(3000)
    axis, speed = published(friction=0.0), 0.05
    error = emps_error(axis, speed * time, 0 * time, np.ones(2))
    held = speed / axis.gain - axis.offset
    wanted = speed / emps.POSITION_GAIN + held / emps.SPEED_GAIN / emps.POSITION_GAIN
    assert error[-500:].mean() == pytest.approx(wanted, rel=1e-3)


@pytest.mark.skipif(not HERE.exists(), reason="the public records are not here")
def test_published_parameters_predict_the_public_drive():
    """As the publication does, to a tenth of the error itself."""
    table = read_table(HERE / "emps" / "DATA_EMPS.mat")
    seen = table["qg"] - table["qm"]
    factors = cascade_factors(table)
    off = emps_error(published(), table["qg"], 0 * seen, factors) - seen
    assert factors[0] == pytest.approx(1.045, abs=0.005)
    assert np.sqrt(np.mean(off**2)) < 3.2e-6 < 0.01 * np.sqrt(np.mean(seen**2))
