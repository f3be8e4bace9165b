"""`verify` and `trace` from the command line."""

import json

import numpy as np
import pytest

from experiments.cli import main
from experiments.commands.trace import contour_of, setup_of
from experiments.commands.verify import limits_of
from experiments.files.netcdf import load_dataset
from experiments.options import Trace, Verify


@pytest.fixture(scope="module")
def tuned(tmp_path_factory, machine_file, part_file):
    folder = tmp_path_factory.mktemp("tuned") / "run"
    effort = [
        "--scatter",
        "0",
        "--starts",
        "1",
        "--inner-steps",
        "2",
        "--outer-steps",
        "1",
        "--preview",
        "4",
    ]
    assert (
        main(
            [
                "tune",
                str(part_file),
                "--plant",
                str(machine_file),
                *effort,
                "--json",
                "--out",
                str(folder),
            ]
        )
        == 0
    )
    return folder


@pytest.mark.slow
def test_verify_tells_what_limits_cost(tuned, tmp_path, capsys):
    capsys.readouterr()
    code = main(
        [
            "verify",
            str(tuned),
            "--max-increment",
            "5",
            "--json",
            "--out",
            str(tmp_path / "verified"),
        ]
    )
    summary = json.loads(capsys.readouterr().out)
    assert code == (1 if any(gap["failure"] for gap in summary["gaps"]) else 0)
    assert any(gap["active_fraction"] > 0 for gap in summary["gaps"]) and all(
        gap["residual"] <= 1e-8 for gap in summary["gaps"]
    )
    assert (tmp_path / "verified" / "result.json").exists()
    stored = sorted((tmp_path / "verified").glob("run-*.nc"))
    assert len(stored) == len(summary["gaps"])
    assert np.abs(np.diff(load_dataset(stored[0]).control.values, axis=0)).max() <= 5 * (1 + 1e-9)


def test_trace_arrives_and_stores_what_it_did(tmp_path, capsys):
    assert main(["trace", "square", "--json", "--out", str(tmp_path / "run")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["arrived"] and summary["residual"] <= 1e-8 and 0.1 < summary["time_s"] < 2
    assert (
        summary["peak_um"] < 100
        and max(abs(u) for row in summary["signals"]["control"] for u in row) <= 0.5 + 1e-9
    )
    assert {path.name for path in (tmp_path / "run").iterdir()} == {
        "settings.json",
        "result.json",
        "trace.png",
    }


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["circle", "--plant", "bridgeport"], "max-control"),
        (["circle", "--period-ms", "2.5"], "period-ms"),
        (["nowhere"], "lobes, circle"),
        (["circle", "--horizon", "0"], "horizon"),
        (["circle", "--solver", "magic"], "magic"),
        (["circle", "--q-theta", "-1"], "q-theta: "),
        (["circle", "--r-control", "0"], "r-control: "),
        (["circle", "--max-speed-mm-s", "nan"], "max-speed-mm-s: "),
        (["circle", "--max-control", "-1"], "max-control: "),
    ],
)
def test_bad_traces_are_one_line(tmp_path, capsys, flags, says):
    assert main(["trace", *flags, "--out", str(tmp_path / "run")]) == 2
    captured = capsys.readouterr()
    assert (
        says in captured.err and captured.err.count("\n") == 1 and not (tmp_path / "run").exists()
    )


def test_verify_needs_a_run(tmp_path, capsys):
    assert main(["verify", str(tmp_path)]) == 2
    assert "settings.json" in capsys.readouterr().err


def test_limits_of_the_machine_and_of_the_flags(machine_file):
    from experiments.catalogue.choices import machine_named

    machine = machine_named(str(machine_file))
    own, changed = (
        limits_of(Verify(), machine),
        limits_of(Verify(max_control=7.0, max_speed_mm_s=50.0), machine),
    )
    assert (
        own.speed[1].tolist() == [0.2, 0.2]
        and changed.speed[1] == 0.05
        and changed.control[1] == 7.0
    )
    assert changed.increment[1].tolist() == own.increment[1].tolist()
    with pytest.raises(ValueError, match="max-control"):
        limits_of(Verify(max_control=-1.0), machine)


def test_setup_of_a_machine_file(machine_file):
    setup = setup_of(Trace(plant=str(machine_file)))
    assert setup.every == 1 and list(setup.limit) == [300.0, 300.0]
    assert contour_of(Trace()).axes == 2
