"""`identify --machine linear` from the command line."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import lfilter

from experiments.benchmarks.records.emps_record import emps_record
from experiments.cli import main
from experiments.commands.machines import identify_linear
from experiments.files.results.linear_result import LinearMachineResult
from experiments.files.results.stored import read_result
from experiments.machines.from_file import load_machine
from experiments.machines.linear import LinearMachine
from jcontour.linear.continuous_axes import speed_axis
from jcontour.plants import emps
from tuning.identification.linear.output_error import AxisRecord, Structure, fitted
from tuning.identification.linear.recording import RecordedAxis, recorded


@pytest.fixture
def demo(tour):
    return tour("identify-linear").folder


@pytest.mark.slow
def test_the_demonstration(demo):
    assert {path.name for path in demo.iterdir()} == {
        "settings.json",
        "result.json",
        "data.csv",
        "machine.json",
        "prediction.png",
        "bode.png",
        "residuals.png",
    }
    head = "time_s,x_command_V,y_command_V,x_position_m,y_position_m\n"
    assert (demo / "data.csv").read_text().startswith(head)
    result = read_result(demo, LinearMachineResult)
    for one, (gain, constant, delay) in zip(
        result.axes, identify_linear.DEMO.values(), strict=True
    ):
        assert one.gain == pytest.approx(gain, rel=0.01)
        assert one.delay * result.dt == pytest.approx(delay)
        assert one.time_constants == pytest.approx([constant], rel=0.05)
    assert load_machine(demo / "machine.json").model.axes == 2


@pytest.mark.slow
def test_the_file_of_the_demonstration_gives_the_same(demo, tmp_path, capsys):
    flags = ["--machine", "linear", "--most-order", "1", "--most-delay", "4", "--json"]
    assert main(["identify", str(demo / "data.csv"), *flags, "--out", str(tmp_path / "b")]) == 0
    again = json.loads(capsys.readouterr().out)
    first = json.loads((demo / "result.json").read_text())
    for one, other in zip(again["axes"], first["axes"], strict=True):
        assert np.allclose(one["numerator"], other["numerator"], rtol=1e-4)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ([], "needs a log, or --demo"),
        (["--demo", "--axes", "X", "X"], "one to three different names"),
        (["--demo", "--most-order", "0"], "most-order: needs 1 to 8"),
        (["--demo", "--most-delay", "-1"], "most-delay: needs 0 to 40"),
        (["--demo", "--axes", "A", "B"], "simulated data have X and Y"),
        (["none.csv"], "none.csv: cannot be read"),
        (["none.csv", "--period-ms", "0"], "period-ms: needs to be above zero"),
    ],
)
def test_bad_input_is_told_in_one_line(flags, words, capsys):
    assert main(["identify", "--machine", "linear", *flags]) == 2
    told = capsys.readouterr().err
    assert words in told and len(told.strip().splitlines()) == 1


def fit(zeros, second, poles=2):
    """Poles fitted to 0.9 and another one, behind which white commands came with zeros."""
    random = np.random.default_rng(5)
    u = random.standard_normal(2000)
    y = np.asarray(lfilter([0.0, *zeros], np.poly([0.9, second]), u))
    record = AxisRecord(1e-3, u, y + 0.01 * random.standard_normal(len(u)))
    return fitted(record, Structure(poles, poles, 0, 0))


@pytest.mark.parametrize(
    ("first", "second", "words", "fewer"),
    [
        (0.7, 0.4, "Y: a zero cancels one of the model's 2 poles", False),  # X needs both
        (None, 0.4, "Y: a zero cancels one of the model's 2 poles", True),
        (0.7, 0.8, "no controller could be tuned for what fits the record (B: missing", False),
    ],
)
def test_a_machine_that_tune_would_refuse_is_told_with_what_to_run(
    first, second, words, fewer, monkeypatch, capsys, tmp_path
):
    """A file without B; the zero at 0.4 cancels the second pole of Y, or none."""
    shown = fit([1.0], 0.0, 1) if first is None else fit([1.0, -0.4], first)
    doubted = fit([1.0, -0.4], second)
    both = (("X", shown, 1e-6), ("Y", doubted, 1e-9))
    axes = [SimpleNamespace(name=name, fit=one, resolution=count) for name, one, count in both]
    record = SimpleNamespace(position=np.array([[0.0, 0.0], [1e-4, 1e-4]]))
    found = SimpleNamespace(axes=axes, record=record)
    monkeypatch.setattr(identify_linear, "identify_machine", lambda *_: found)
    monkeypatch.setattr(identify_linear, "machine_fields", lambda *_: {"A": [[1.0]]})
    folder = tmp_path / "run"
    assert main(["identify", "--machine", "linear", "--demo", "--out", str(folder)]) == 2
    told = capsys.readouterr().err
    assert words in told and "B: missing" in told and len(told.strip().splitlines()) == 1
    assert ("--most-order 1" in told) is fewer and not folder.exists()
    asked = "Y: moves by 0.1 mm in all, by counts of 1 nm; are the positions in mm?"
    assert (asked in told) is ("zero cancels" not in words) and "X: moves" not in told


@pytest.mark.slow
def test_wrong_units_are_questioned(demo, tmp_path, capsys):
    """Nanometres and micrometres taken for metres and millimetres; too slow a clock."""
    rows = np.loadtxt(demo / "data.csv", delimiter=",", skiprows=1)
    heads = "time,x_command,y_command,x_position_m,y_position_m"
    for factors, words in (
        ([1, 1, 1, 1e9, 1e9], ["g in the record, and 2.5e+07 m/s per control unit"]),
        (
            [1, 1, 1, 1e3, 1e3],
            [
                "X: counts of 1000 um are coarser than those of a machine; are ",
                "If so, name the columns as x_position_um, or give --length-unit um",
            ],
        ),
        ([50, 1, 1, 1, 1], ["time: a sample every 50 ms is no usual period of a drive"]),
    ):
        np.savetxt(tmp_path / "log.csv", rows * factors, "%.10g", ",", header=heads, comments="")
        flags = ["--machine", "linear", "--most-order", "1", "--most-delay", "4", "--json"]
        flags += ["--out", str(tmp_path / words[0][0])]
        main(["identify", str(tmp_path / "log.csv"), *flags])
        notes = json.loads(capsys.readouterr().out)["notes"]
        for one in words:
            assert any(one in note for note in notes), notes


AXES = {"X": (25e-3, 8e-3, 2e-3), "Y": (40e-3, 12e-3, 1e-3), "Z": (10e-3, 15e-3, 3e-3)}


@pytest.mark.slow
@pytest.mark.parametrize("names", ["Y", "XYZ"])
def test_logs_of_one_and_of_three_axes(names, tmp_path, capsys):
    """Only what was measured is told; the file of one axis says that its other one was not."""
    random, columns, heads = np.random.default_rng(3), [1e-3 * np.arange(4000)], ["time_s"]
    wanted = np.repeat(random.uniform(-5e-3, 5e-3, 80), 50)
    for gain, constant, delay in (AXES[name] for name in names):
        drive = speed_axis(gain, constant, delay)
        axis = RecordedAxis(drive, "speed", 1e-6, 0.4e-6, 2e-3, (15.0 / gain,))
        columns += recorded(axis, wanted, 1e-3, random)
    for name in names.lower():
        heads += [f"{name}_command", f"{name}_position_m"]
    log, folder = tmp_path / "log.csv", tmp_path / "run"
    table = np.column_stack(columns)
    np.savetxt(log, table, "%.10g", ",", header=",".join(heads), comments="")
    flags = ["--axes", *names, "--most-order", "1", "--most-delay", "4", "--out", str(folder)]
    assert main(["identify", str(log), "--machine", "linear", *flags]) == 0
    printed, result = capsys.readouterr().out, read_result(folder, LinearMachineResult)
    assert [one.name for one in result.axes] == [*names]
    assert all(len(values) == len(names) for values in result.limits.values())
    for one in result.axes:
        assert one.gain == pytest.approx(AXES[one.name][0], rel=0.02)
        assert f"um on {one.name}" in printed
    machine = load_machine(folder / "machine.json")
    alone = names == "Y"
    assert ("its X is a copy that nobody measured" in printed) is alone
    assert machine.axes == (("Y", "X") if alone else ("X", "Y", "Z"))
    assert machine.remarks == (["log: X was not measured: it is a copy of Y"] if alone else [])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_record_of_one_axis_as_the_public_one_of_emps(tmp_path, capsys, seed):
    """Columns named as in DATA_EMPS.mat, simulated: the file holds the axis twice.

    Its friction takes a tenth of the command, and holds the axis at every rest.
    """
    time = emps.SAMPLE_PERIOD * np.arange(24_000)
    knots = np.random.default_rng(seed).uniform(0.0, 0.24, 25)
    part = np.minimum(time % 1.0 / 0.9, 1.0)
    whole, smooth = time.astype(int), part**3 * (10 - 15 * part + 6 * part**2)
    reference = knots[whole] + (knots[whole + 1] - knots[whole]) * smooth
    voltage, counted = emps_record(reference, 0)
    savemat(tmp_path / "emps.mat", {"t": time, "qm": counted, "vir": voltage, "qg": reference})
    flags = ["--machine", "linear", "--axes", "X", "--command-columns", "vir"]
    flags += ["--position-columns", "qm", "--length-unit", "m", "--most-order", "1"]
    folder = tmp_path / "run"
    assert main(["identify", str(tmp_path / "emps.mat"), *flags, "--out", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert "the machine file has X twice" in printed and "dry friction takes" in printed
    assert "tables of tune have this friction in their runs" in printed
    result = read_result(folder, LinearMachineResult)
    assert result.axes[0].gain == pytest.approx(emps.DRIVE_GAIN / emps.VISCOUS, rel=0.002)
    assert result.axes[0].delay == 0
    machine = load_machine(folder / "machine.json")
    assert isinstance(machine, LinearMachine) and machine.model.axes == 2
    assert machine.friction == result.axes[0].friction
