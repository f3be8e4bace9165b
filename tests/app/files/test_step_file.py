import numpy as np
import pytest

from jcontour.app.files.step_file import read_step

ROWS = [(0.001 * k, float(k > 5), 0.5 * k) for k in range(20)]


def written(path, head="time,control,position", rows=ROWS, mark=","):
    lines = [mark.join(f"{x:.9g}" for x in row) for row in rows]
    path.write_text("\n".join([head, *lines] if head else lines) + "\n")
    return path


@pytest.mark.parametrize("mark", [",", ";"])
def test_columns_by_name_or_by_place(tmp_path, mark):
    path = written(tmp_path / "a.csv", mark.join(("time", "control", "position")), mark=mark)
    named, plain = read_step(path, "mm"), read_step(written(tmp_path / "b.csv", ""), "mm")
    assert named.dt == plain.dt == pytest.approx(1e-3)
    assert np.allclose(named.position, 0.5e-3 * np.arange(20))
    assert np.array_equal(named.control, plain.control)
    swapped = written(tmp_path / "c.csv", "position,time,control", [(p, t, u) for t, u, p in ROWS])
    assert np.array_equal(read_step(swapped, "mm").position, named.position)


def test_times_that_cannot_be_seconds_are_in_the_unit_that_suits_a_drive(tmp_path):
    rows = [(1e6 * t, u, p) for t, u, p in ROWS]
    found = read_step(written(tmp_path / "a.csv", rows=rows), "mm")
    assert found.unit == "us" and found.dt == pytest.approx(1e-3)


def test_faults_are_told_with_their_place(tmp_path):
    late = [*ROWS[:7], (0.0075, 1.0, 3.5), *ROWS[8:]]
    back = [(-t, u, p) for t, u, p in ROWS]
    path = tmp_path / "a.csv"
    for change, words in (
        ({"rows": late}, "after 0.006 s comes 0.0075 s, the others are 0.001 s apart"),
        ({"rows": back}, "the column time has to grow"),
        ({"head": "time,current,position"}, "has no column 'control'; needs time, control"),
        ({"rows": [*ROWS, (1.0, 2.0)]}, "column position holds no number in row 21 behind"),
        ({"rows": ROWS[:2]}, "needs at least three samples"),
    ):
        with pytest.raises(ValueError, match=words):
            read_step(written(path, **change), "mm")
    path.write_text("")
    with pytest.raises(ValueError, match="is empty"):
        read_step(path, "mm")
    with pytest.raises(ValueError, match="cannot be read"):
        read_step(tmp_path / "none.csv", "mm")
