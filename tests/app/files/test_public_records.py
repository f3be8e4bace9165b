"""Public records of real machines open as they are, by names of columns alone."""

from pathlib import Path

import numpy as np
import pytest

from jcontour.app.files.log_file import LogColumns, read_log

RECORDS = Path(__file__).parents[4] / "shared" / "data" / "records"
pytestmark = pytest.mark.skipif(not RECORDS.exists(), reason="the public records are not here")


@pytest.mark.parametrize(
    ("file", "columns", "unit", "rows", "dt"),
    [
        ("emps/DATA_EMPS.mat", ("t", "vir", "qm"), "m", 24841, 1e-3),
        ("motor_bench/MultisineTypeA.mat", ("time", "iq_refx", "theta_mx"), "rad", 50000, 4e-4),
        (
            "kuka/rec_A.mat",
            ("rec.time_cont", "ref_pos_deg_1", "act_pos_se_deg_1"),
            "mm",
            2501,
            4e-3,
        ),
        ("lorenz_servo/data_5.txt", (0.001, "5", "1"), "rad", 10002, 1e-3),
        ("ruler_robot/step1.txt", (None, "v", r"$\theta$"), "deg", 2000, 2e-3),
        (
            "camber/LinB__no-load-square-wave-half-travel-3Hz.txt",
            ("1", "3", "4"),
            "mm",
            1528,
            0.013,
        ),
        (
            "umich_cnc/experiment_11.csv",
            (0.1, "X1_CommandPosition", "X1_ActualPosition"),
            "mm",
            2314,
            0.1,
        ),
        ("halscope/halscope.log", (1e-4, *2 * ("joint.3.motor-pos-cmd",)), "mm", 398, 1e-4),
    ],
)
def test_a_public_record(file, columns, unit, rows, dt):
    time, command, position = columns
    period = time if isinstance(time, float) else None
    stamps = time if isinstance(time, str) else None
    log = read_log(
        RECORDS / file, ("X",), LogColumns(stamps, (command,), (position,), unit, period)
    )
    assert len(log.command) == rows and log.dt == pytest.approx(dt, rel=2e-3)
    assert np.isfinite(log.position).all()
