import numpy as np

from jcontour.export.c_replay import plan_file, replay_file


def test_files_read_back_to_the_last_bit(law_and_plan, recorded, tmp_path):
    law, plan = law_and_plan
    y, u = recorded
    path = tmp_path / "numbers.csv"
    path.write_text(replay_file(y, u))
    assert np.array_equal(np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2), np.hstack([y, u]))
    path.write_text(plan_file(plan))
    names = path.read_text().partition("\n")[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    assert np.array_equal(rows[:, : law.inputs], plan.f)
    if plan.F is not None:
        first = names.index("F1")
        assert np.array_equal(rows[6, first : first + plan.F[0].size], plan.F[plan.used[6]].ravel())
    assert len(names) == rows.shape[1]
