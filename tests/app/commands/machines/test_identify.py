"""`identify` from the command line."""

import numpy as np
import pytest

from jcontour.app.cli import main
from jcontour.app.commands.machines import identified_machine, identify
from jcontour.app.files.results.machine_results import LinearAxisResult, LinearMachineResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.flags.machines import Identify
from jcontour.app.machines import identified
from jcontour.app.machines.from_file import load_machine
from jcontour.linear.continuous_axes import speed_axis
from tests.app.small_runs import partly
from tests.tuning.identification.linear.recorded_axes import RecordedAxis, recorded
from tuning.identification.linear import machine
from tuning.identification.linear.identified_axes import IdentifiedAxis, IdentifiedMachine
from tuning.identification.linear.machine_record import MachineRecord


@pytest.fixture
def demo(tour):
    return tour("identify").folder


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
    for one, (gain, constant, delay) in zip(result.axes, identify.DEMO.values(), strict=True):
        assert one.gain == pytest.approx(gain, rel=0.01)
        assert one.delay * result.dt == pytest.approx(delay)
        assert one.time_constants == pytest.approx([constant], rel=0.05)
    assert load_machine(demo / "machine.json").model.axes == 2


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
    assert main(["identify", *flags]) == 2
    told = capsys.readouterr().err
    assert words in told and len(told.strip().splitlines()) == 1


def test_a_machine_that_tune_would_refuse_is_told_with_what_to_run(monkeypatch, capsys, tmp_path):
    """A file without B."""
    axes = [partly(IdentifiedAxis, name=name, resolution=1e-9) for name in ("X", "Y")]
    record = partly(MachineRecord, position=np.array([[0.0, 0.0], [1e-4, 1e-4]]))
    found = partly(IdentifiedMachine, axes=axes, record=record)
    monkeypatch.setattr(machine, "identify_machine", lambda *_: found)
    monkeypatch.setattr(identified, "machine_fields", lambda *_: {"A": [[1.0]]})
    folder = tmp_path / "run"
    assert main(["identify", "--demo", "--out", str(folder)]) == 2
    told = capsys.readouterr().err
    assert "B: missing" in told and "--excite" in told and len(told.strip().splitlines()) == 1
    assert "Y: moves by 0.1 mm in all, by counts of 1 nm; are the positions in mm?" in told
    assert not folder.exists()


@pytest.mark.parametrize(
    ("dt", "gain", "speed", "words"),
    [
        (1e-3, 0.02, 0.1, []),
        (0.05, 0.02, 0.1, ["time: a sample every 50 ms is no usual period of a drive"]),
        (
            1e-3,
            2.5e7,
            1e8,
            ["X: 6000000000000 mm/min and 0.102 g in the record, and 15"],
        ),
    ],
)
def test_wrong_units_are_questioned(dt, gain, speed, words):
    axis = partly(LinearAxisResult, name="X", gain=gain, integrators=1)
    largest = {"speed": [speed], "acceleration": [1.0]}
    told = identified_machine._period(dt)
    told += identified_machine._questions(Identify(control_unit="V"), [axis], largest)
    assert len(told) == len(words)
    assert all(line.startswith(one) for line, one in zip(told, words, strict=True))


@pytest.mark.slow
def test_a_log_of_one_axis(tmp_path, capsys):
    """Only what was measured is told; the file says that its other axis was not."""
    random, gain = np.random.default_rng(3), 40e-3
    wanted = np.repeat(random.uniform(-5e-3, 5e-3, 80), 50)
    drive = speed_axis(gain, 12e-3, 1e-3)
    axis = RecordedAxis(drive, "speed", 1e-6, 0.4e-6, 2e-3, (15.0 / gain,))
    columns = [1e3 * np.arange(4000), *recorded(axis, wanted, 1e-3, random)]
    log, folder = tmp_path / "log.csv", tmp_path / "run"
    heads = "time,y_command,y_position_m"
    np.savetxt(log, np.column_stack(columns), "%.10g", ",", header=heads, comments="")
    flags = "--axes Y --most-order 1 --most-delay 4 --out".split()
    assert main(["identify", str(log), *flags, str(folder)]) == 0
    printed, result = capsys.readouterr().out, read_result(folder, LinearMachineResult)
    (one,) = result.axes
    assert one.name == "Y" and all(len(values) == 1 for values in result.limits.values())
    assert one.gain == pytest.approx(gain, rel=0.02)
    assert any("um" in line and "on X" not in line for line in result.words)
    assert "is taken as us, a sample every 1 ms" in " ".join(printed.split())
    assert "its X is a copy that nobody measured" in " ".join(printed.split())
    machine = load_machine(folder / "machine.json")
    assert machine.axes == ("Y", "X")
    assert machine.remarks == ["log: X was not measured: it is a copy of Y"]
