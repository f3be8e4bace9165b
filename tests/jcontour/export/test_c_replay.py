import numpy as np
import pytest

from jcontour.export.c_replay import plan_file, replay_file


def test_files_read_back_to_the_last_bit(law_and_plan, recorded, tmp_path):
    law, plan = law_and_plan
    y, u = recorded
    path = tmp_path / "numbers.csv"
    path.write_text(replay_file(y, u))
    assert np.array_equal(np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2), np.hstack([y, u]))
    path.write_text(plan_file(plan, law.dt))
    names = path.read_text().partition("\n")[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    first = names.index("f1")
    assert names[:2] == ["k", "t_s"] and np.array_equal(rows[:, 0], np.arange(plan.steps))
    assert rows[7, 1] == pytest.approx(7e-3)  # [s]
    assert np.array_equal(rows[:, first : first + law.inputs], plan.f)
    first = names.index("r1")
    assert np.array_equal(rows[:, first : first + law.measured], plan.r)
    if plan.F is not None:
        first = names.index("F1")
        assert np.array_equal(rows[6, first : first + plan.F[0].size], plan.F[plan.used[6]].ravel())
    assert len(names) == rows.shape[1]
