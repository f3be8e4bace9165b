import numpy as np
import pytest

from jcontour.app.files.log_file import LogColumns, read_log, read_step

ROWS = 40
TIME = 0.002 * np.arange(ROWS)
HEADS = ("time", "x_command", "y_command", "x_position", "y_position")


def written(tmp_path, time=TIME, heads=HEADS, change=None):
    signals = np.random.default_rng(0).standard_normal((len(time), 4))
    rows = np.column_stack([time, signals])
    if change is not None:
        change(rows)
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, "%.9g", ",", header=",".join(heads), comments="")
    return path, signals


def test_columns_by_their_names(tmp_path):
    path, signals = written(tmp_path)
    log = read_log(path, ("X", "Y"), LogColumns())
    assert log.dt == pytest.approx(0.002)
    assert np.allclose(log.command, signals[:, :2])
    assert np.allclose(log.position, 1e-3 * signals[:, 2:])
    assert log.words == (
        "X: command x_command, position x_position",
        "Y: command y_command, position y_position",
    )


@pytest.mark.parametrize(
    ("dt", "unit", "second"),
    [
        (0.0004, "s", 1),
        (0.1, "s", 1),
        (0.4, "ms", 1e3),
        (2.0, "ms", 1e3),
        (400.0, "us", 1e6),
        (50.0, "us", 1e6),
        (1e6, "ns", 1e9),
    ],
)
def test_times_without_a_unit_are_in_the_one_that_suits_a_drive(tmp_path, dt, unit, second):
    path, _ = written(tmp_path, dt * np.arange(ROWS))
    log = read_log(path, ("X", "Y"), LogColumns())
    assert log.dt == pytest.approx(dt / second)
    said = [words for words in log.words if "states no unit" in words]
    assert len(said) == (unit != "s") and all(f"taken as {unit}" in words for words in said)
    assert read_log(path, ("X", "Y"), LogColumns(period=0.5)).dt == 0.5
    stated, _ = written(tmp_path, dt * np.arange(ROWS), ("time_s", *HEADS[1:]))
    if dt <= 0.5:
        assert read_log(stated, ("X", "Y"), LogColumns()).dt == pytest.approx(dt)
    else:  # no drive's
        with pytest.raises(ValueError, match="is the unit of its column of time right"):
            read_log(stated, ("X", "Y"), LogColumns())
        assert read_log(stated, ("X", "Y"), LogColumns(period=0.001)).dt == 0.001


def test_commands_may_say_their_unit(tmp_path):
    heads = ("time_s", "x_command_V", "Y_Command [V]", *HEADS[3:])
    path, signals = written(tmp_path, heads=heads)
    assert np.allclose(read_log(path, ("X", "Y"), LogColumns()).command, signals[:, :2])


@pytest.mark.parametrize(
    ("heads", "metre"),
    [
        (("t_ms", "A", "b", "qx_um", "qy_m"), 1e-6),
        (("Time [ms]", "a", "b", "Act X [um]", "q [m]"), 1e-6),
        (("t (ms)", "a", "b", "c", "d_m"), 1e-3),
    ],
)
def test_units_in_names_and_names_by_flags(tmp_path, heads, metre):
    path, signals = written(tmp_path, 1e3 * TIME, heads)
    log = read_log(path, ("X", "Y"), LogColumns(None, ("a", "b"), heads[3:]))
    assert log.dt == pytest.approx(0.002)
    assert np.allclose(log.position, signals[:, 2:] * [metre, 1.0])


def test_axes_that_turn(tmp_path):
    heads = ("time_s", "x_command_rpm", "y_command_%", "rec.x_deg", "q_rev_2")
    path, signals = written(tmp_path, heads=heads)
    columns = LogColumns(position=("x_deg", "q_rev_2"))
    log = read_log(path, ("X", "Y"), columns)
    assert np.allclose(log.position, signals[:, 2:] * [np.pi / 180, 2 * np.pi])
    assert log.angles == (True, True) and "1 rad" in log.words[0]
    assert np.allclose(log.command, signals[:, :2])


def test_counts_have_the_length_that_is_given(tmp_path):
    heads = ("time_s", *(f"{one}_counts" for one in HEADS[1:4]), "y_position_inch")
    path, signals = written(tmp_path, heads=heads)
    with pytest.raises(ValueError, match="x_position_counts: give the metres of a count"):
        read_log(path, ("X", "Y"), LogColumns())
    log = read_log(path, ("X", "Y"), LogColumns(length_unit=5e-8))
    assert np.allclose(log.position, signals[:, 2:] * [5e-8, 0.0254])
    assert np.allclose(log.command, signals[:, :2])
    asked = read_log(path, ("X", "Y"), LogColumns(length_unit=5e-8, asked=True))
    assert np.allclose(asked.command, 5e-8 * signals[:, :2])


def test_a_period_in_the_place_of_time(tmp_path):
    path, _ = written(tmp_path, heads=("nothing", *HEADS[1:]))
    with pytest.raises(ValueError, match="no column of time; name it with --time-column"):
        read_log(path, ("X", "Y"), LogColumns())
    log = read_log(path, ("X", "Y"), LogColumns(period=0.004))
    assert log.dt == 0.004 and len(log.command) == ROWS
    timed, _ = written(tmp_path)
    words = read_log(timed, ("X", "Y"), LogColumns(period=0.004)).words
    assert words[-1] == "time: --period-ms 4 counts, column time does not"


def test_the_longest_part_between_gaps_and_restarts(tmp_path):
    time = np.concatenate([TIME[:10], TIME[12:38] + 1, TIME[:4]])
    path, signals = written(tmp_path, time)
    log = read_log(path, ("X", "Y"), LogColumns())
    assert np.allclose(log.command, signals[10:36, :2]) and log.dt == pytest.approx(0.002)
    assert "1 gaps and 1 restarts of the clock, the first after 0.018 s" in log.words[-1]


def test_faults_are_told_with_their_place(tmp_path):
    random = np.random.default_rng(1)
    jitter = np.cumsum(random.choice([0.001, 0.004], ROWS))
    with pytest.raises(ValueError, match="samples are not evenly spaced: after"):
        read_log(written(tmp_path, jitter)[0], ("X", "Y"), LogColumns())
    with pytest.raises(ValueError, match="has to grow"):
        read_log(written(tmp_path, -TIME)[0], ("X", "Y"), LogColumns())
    with pytest.raises(ValueError, match="no column z_command; name one per axis"):
        read_log(written(tmp_path)[0], ("X", "Z"), LogColumns())
    with pytest.raises(ValueError, match="command-columns: needs 2 names"):
        read_log(written(tmp_path)[0], ("X", "Y"), LogColumns(command=("x_command",)))
    with pytest.raises(ValueError, match="has no column of numbers 'ux'"):
        read_log(written(tmp_path)[0], ("X", "Y"), LogColumns(command=("ux", "uy")))

    def broken(rows):
        rows[7, 2] = np.nan

    with pytest.raises(ValueError, match="column y_command holds no number in row 8 behind"):
        read_log(written(tmp_path, change=broken)[0], ("X", "Y"), LogColumns())

    def huge(rows):
        rows[7, 2] = 1e30

    with pytest.raises(ValueError, match=r"y_command holds 1e\+30, more than 1e\+12, in row 8"):
        read_log(written(tmp_path, change=huge)[0], ("X", "Y"), LogColumns())


STEP = [(0.001 * k, float(k > 5), 0.5 * k) for k in range(20)]


def step_log(path, head="time,control,position", rows=STEP, mark=","):
    lines = [mark.join(f"{x:.9g}" for x in row) for row in rows]
    path.write_text("\n".join([head, *lines] if head else lines) + "\n")
    return path


@pytest.mark.parametrize("mark", [",", ";"])
def test_columns_of_a_step_by_name_or_by_place(tmp_path, mark):
    path = step_log(tmp_path / "a.csv", mark.join(("time", "control", "position")), mark=mark)
    named, plain = read_step(path, "mm"), read_step(step_log(tmp_path / "b.csv", ""), "mm")
    assert named.dt == plain.dt == pytest.approx(1e-3)
    assert np.allclose(named.position, 0.5e-3 * np.arange(20)[:, None])
    assert np.array_equal(named.command, plain.command)
    swapped = step_log(tmp_path / "c.csv", "position,time,control", [(p, t, u) for t, u, p in STEP])
    assert np.array_equal(read_step(swapped, "mm").position, named.position)


def test_times_of_a_step_that_cannot_be_seconds(tmp_path):
    rows = [(1e6 * t, u, p) for t, u, p in STEP]
    record = read_step(step_log(tmp_path / "a.csv", rows=rows), "mm")
    assert "taken as us" in record.words[1] and record.dt == pytest.approx(1e-3)


def test_faults_of_a_step_are_told_with_their_place(tmp_path):
    late = [(t + 0.005 * (k % 3), u, p) for k, (t, u, p) in enumerate(STEP)]
    back = [(-t, u, p) for t, u, p in STEP]
    path = tmp_path / "a.csv"
    for change, words in (
        ({"rows": late}, "samples are not evenly spaced: after 0.012 s comes 0.003 s"),
        ({"rows": back}, "the column time has to grow"),
        (
            {"head": "time,current,position"},
            "has no column of numbers 'control'; has time",
        ),
        ({"rows": [*STEP[:9], (0.009, 2.0), *STEP[10:]]}, "holds no number in row 10 behind"),
        ({"rows": STEP[:2]}, "needs at least three samples"),
    ):
        with pytest.raises(ValueError, match=words):
            read_step(step_log(path, **change), "mm")
    path.write_text("")
    with pytest.raises(ValueError, match="is empty"):
        read_step(path, "mm")
    with pytest.raises(ValueError, match="cannot be read"):
        read_step(tmp_path / "none.csv", "mm")
