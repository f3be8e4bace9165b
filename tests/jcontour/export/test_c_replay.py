import numpy as np
import pytest

from jcontour.export.c_replay import Units, plan_file, replay_file
from jcontour.export.drive_law import DriveLaw, drive_plan


def test_files_read_back_to_the_last_bit(law_and_plan, recorded, tmp_path):
    law, plan = law_and_plan
    y, u = recorded
    units = Units("V", ("m",) * law.measured)
    path = tmp_path / "numbers.csv"
    path.write_text(replay_file(y, u, units))
    assert np.array_equal(np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2), np.hstack([y, u]))
    path.write_text(plan_file(law, plan, units))
    names = path.read_text().partition("\n")[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    first = names.index("f1_V")
    assert names[:2] == ["k", "t_s"] and np.array_equal(rows[:, 0], np.arange(plan.steps))
    assert rows[7, 1] == pytest.approx(7e-3)  # [s]
    assert np.array_equal(rows[:, first : first + law.inputs], plan.f)
    first = names.index("r1_m")
    assert np.array_equal(rows[:, first : first + law.measured], plan.r)
    if plan.F is not None:
        first = names.index("F1_V_per_state_0")
        assert np.array_equal(rows[6, first : first + plan.F[0].size], plan.F[plan.used[6]].ravel())
    if plan.m is not None:
        assert names[-2:] == ["m1_state_1", "m2_state_3"]
        assert np.array_equal(rows[:, -2:], plan.m)
    assert len(names) == rows.shape[1]


def test_every_column_says_its_unit():
    law = DriveLaw(
        dt=1e-3,
        names=("state 1", "load on control 1"),
        measured=2,
        inputs=1,
        correction=None,
        A=None,
        B=None,
        E=None,
        limit=np.full(1, np.inf),
    )
    ones = np.ones((3, 1, 2))
    plan = drive_plan(ones, ones, np.zeros((3, 1)), np.zeros((3, 2)))
    units = Units("N/kg", ("m", "m/s"))
    head = plan_file(law, plan, units).partition("\n")[0].split(",")
    assert head[:5] == ["k", "t_s", "f1_N_per_kg", "r1_m", "r2_m_per_s"]
    assert head[5:7] == ["F1_N_per_kg_per_state_1", "F2_N_per_kg_per_load_on_control_1"]
    assert head[7:] == ["D1_N_per_kg_per_m", "D2_N_per_kg_per_m_per_s"]
    told = replay_file(np.zeros((3, 2)), np.zeros((3, 1)), units).partition("\n")[0]
    assert told == "y1_m,y2_m_per_s,u1_N_per_kg"
