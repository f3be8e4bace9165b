import numpy as np
import pytest

from jcontour.app.files.record_file import RecordError, load_records, save_records
from tuning.identification.flexible_axis.records import Record

ROWS = 120
RANDOM = np.random.default_rng(8)


def row():
    return RANDOM.normal(size=ROWS)


TESTS = [
    Record("electrical", 1e-4, row(), row(), voltage=row(), current_d=row()),
    Record("sweep", 1e-3, row(), row(), tool=row()),
]


def lines(time=None, current="1.5"):
    time = 1e-3 * np.arange(ROWS) if time is None else time
    return [
        "time,motor_position,current_q",
        *(f"{t:.9g},{0.1 * k},{current}" for k, t in enumerate(time)),
    ]


def written(folder, content):
    path = folder / "data.csv"
    path.write_text("\n".join(content) + "\n")
    return path


def test_round_trip(tmp_path):
    path = save_records(TESTS, tmp_path / "data.csv")
    head = "test,time_s,motor_position_m,current_q_A,tool_position_m,voltage_q_V,current_d_A"
    assert path.read_text().partition("\n")[0] == head
    again = load_records(path)
    for one, other in zip(TESTS, again, strict=True):
        assert other.name == one.name and other.dt == pytest.approx(one.dt, rel=1e-6)
        for a, b in zip(one[2:], other[2:], strict=True):
            assert (a is None) == (b is None)
            if a is not None:
                np.testing.assert_allclose(b, a, rtol=1e-8)


def test_one_test_any_order_of_columns_and_a_byte_order_mark(tmp_path):
    (tmp_path / "data.csv").write_text(
        "\ufeffcurrent_q, time,motor_position\n"
        + "".join(f"2,{1 + 0.002 * k},{k}\n" for k in range(ROWS))
    )
    (record,) = load_records(tmp_path / "data.csv")
    assert record.name == "data" and record.dt == pytest.approx(2e-3) and record.tool is None
    np.testing.assert_array_equal(record.motor, np.arange(ROWS))
    np.testing.assert_array_equal(record.current, 2.0)


def test_jitter_of_a_rounded_clock_is_forgiven(tmp_path):
    (record,) = load_records(written(tmp_path, lines(np.round(np.arange(ROWS) / 3000, 6))))
    assert record.dt == pytest.approx(1 / 3000, rel=1e-4)


LATE = 1e-3 * np.arange(ROWS) + 5e-4 * (np.arange(ROWS) > 60)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (
            [],
            "columns: time, motor_position, current_q missing; "
            "needed are time, motor_position, current_q, received nothing",
        ),
        (["time,position,current_q"], "columns: motor_position missing"),
        (
            ["time,motor_position,current_q,tool"],
            "columns: needs test, time, .* received time, motor_position, current_q, tool",
        ),
        (["time,motor_position,current_q,time"], "each at most once"),
        (["time,motor_position,current_q"], "rows: there are none"),
        (lines()[:50], "test 'data': needs at least 100 rows, received 49"),
        ([*lines(), "1,2"], "line 122: needs 3 cells, received 2"),
        ([*lines(), "0.12,2,nan"], "current_q: row 121 needs a finite number, received 'nan'"),
        ([*lines(), "0.12,2,inf"], "current_q: row 121 needs a finite number, received 'inf'"),
        ([*lines(), "0.12,2,three"], "current_q: row 121 needs a number, received 'three'"),
        ([*lines(), "0.12,,3"], "motor_position: row 121, of test 'data', is empty"),
        (
            lines(LATE),
            "test 'data': samples are not evenly spaced: after 0.06 s comes 0.0615 s, "
            "the others are 0.001 s apart; resample the data, or make",
        ),
        (lines(1e3 * np.arange(ROWS)), "time: needs s, rows of test 'data' look like us"),
        (lines(np.zeros(ROWS)), "test 'data': the column time has to grow"),
        (lines(1e-3 * np.arange(ROWS)[::-1]), "test 'data': the column time has to grow"),
    ],
)
def test_bad_files(tmp_path, content, says):
    with pytest.raises(RecordError, match=says) as caught:
        load_records(written(tmp_path, content))
    assert str(caught.value).startswith(str(tmp_path)) and "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(RecordError, match="cannot be read"):
        load_records(tmp_path / "none.csv")
    (tmp_path / "data.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(RecordError, match="is not a CSV file"):
        load_records(tmp_path / "data.csv")


def test_a_column_half_filled(tmp_path):
    content = lines()
    half = [
        "tool_position," + content[0],
        *(("0.5," if k < 60 else ",") + text for k, text in enumerate(content[1:])),
    ]
    with pytest.raises(RecordError, match="tool_position: row 61, of test 'data', is empty"):
        load_records(written(tmp_path, half))
