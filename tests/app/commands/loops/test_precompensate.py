"""`precompensate` from the command line."""

import re
from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.cli import main
from jcontour.app.commands.loops import precompensate
from jcontour.app.commands.loops.precompensate import gain_words, verdict_on
from jcontour.app.files.results.loop_results import BentResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.files.results.verdict import LimitCheck, exceeded
from jcontour.app.jobs.replays import Scenarios, replay
from jcontour.app.runs.loops.bending import Bent

BEYOND = LimitCheck(name="speed of X", value=0.3, allowed=0.2, unit="m/s")


@pytest.fixture
def bent(tour):
    return tour("precompensate").folder


def test_the_nominal_and_the_worst_machine_come_nearer(bent):
    result = read_result(bent, BentResult)
    assert result.nominal_gain > 20 and result.worst_gain > 2 and verdict_on(result).usable
    assert result.asked[1] <= 4.0  # [m/s^2], the limit of the machine
    assert list(result.before) == list(result.after) and not exceeded(result.limits)
    assert result.controller == "linear-cascade"  # unless another one is named
    rows = np.loadtxt(bent / "reference.csv", delimiter=",", skiprows=1)
    assert len(rows) == result.samples
    program = (bent / "part.ngc").read_text()
    assert program.count("G1 ") == result.moves and result.chord <= 0.5e-6
    assert len(result.weights) == 3 and all(f"({line})" in program for line in result.weights)
    assert (bent / "bent.png").exists()


def driven(machine, gains, reference, seconds):
    """Tool (T, 2) [mm] of a cascade in NumPy; it streams a reference [mm] and holds its end.

    Gains are those of the axes: 1/s, control per m/s, s. Positions are counted.
    """
    A, B, C = (np.asarray(machine[name]) for name in "ABC")
    dt, count, limit = machine["dt"], machine["encoder_resolution"], machine["limits"]["control"]
    position, velocity, integral_time = gains
    x, w, before, found = np.linalg.pinv(C) @ reference[0], np.zeros(2), None, []
    held = np.repeat(reference[-1:], round(seconds / dt), axis=0)
    for target in np.concatenate([reference, held]):
        y = count * np.round(C @ x / count)
        before = y if before is None else before
        error = 1e-3 * (position * (target - y) - (y - before) / dt)  # [m/s]
        w = np.clip(w + velocity * dt / integral_time * error, -limit, limit)
        found.append(C @ x)
        x = A @ x + B @ np.clip(velocity * error + w, -limit, limit)
        before = y
    return np.array(found)


def test_a_drive_that_holds_the_last_point_sees_no_more_than_what_is_told(bent, machine_fields):
    """The part ends along -Y at 0, 0, where it began along X."""
    result = read_result(bent, BentResult)
    assert result.rests and result.held > 0.05
    rows = np.loadtxt(bent / "reference.csv", delimiter=",", skiprows=1)[:, 1:]
    assert np.all(rows[-1] == 0)
    number = r"(?<= )[\d.]+(?:e[+-]?\d+)?(?=[, ])"  # not that of "1/s"
    gains = [np.array(re.findall(number, line), float) for line in result.weights]
    tool = driven(machine_fields, gains, rows, seconds=1.0)
    ends = tool[len(rows) - round(result.held / machine_fields["dt"]) - 1 :]
    near = np.minimum(
        np.linalg.norm(ends - np.maximum(ends, 0) * [0, 1], axis=1),
        np.linalg.norm(ends - np.maximum(ends, 0) * [1, 0], axis=1),
    )
    count = machine_fields["encoder_resolution"]
    assert near.max() < 1e3 * result.after["nominal"].peak_contour_error + count
    assert np.abs(tool[len(rows) :]).max() < 2 * count


def test_words_say_what_it_brings_and_when_not_to_use_it(bent):
    result = read_result(bent, BentResult)
    assert "times smaller" in gain_words(result)
    limited = replace(result, limits=[BEYOND])
    assert verdict_on(limited).reasons[0].startswith("speed of X EXCEEDS its limit: 18000 of 12000")
    assert verdict_on(limited).exit_code == 3 and verdict_on(result).exit_code == 0
    anyway = replace(limited, limits_before=[BEYOND])
    assert "exceeds a limit of the machine without any bend" in verdict_on(anyway).reasons[1]
    worse = replace(result, before=result.after, after=result.before)
    assert "times LARGER" in gain_words(worse)
    assert "the worst machine is no better" in verdict_on(worse).reasons[0]
    traded = replace(result, before=_runs(result, 1e-6, 10e-6), after=_runs(result, 3e-6, 9e-6))
    assert "gains less than the nominal one loses" in verdict_on(traded).reasons[0]
    fair = replace(traded, after=_runs(result, 1.05e-6, 9e-6))
    assert verdict_on(fair).usable
    as_before = replace(result, after=result.before, largest=0.0)
    assert "nominal the same, worst of the family the same" in gain_words(as_before)


def unbent(loop, roughness, status):
    """A correction of zero, so that nothing gets better."""
    job, machine, controller = loop.jobs[0], loop.machine, loop.controller
    reference = job.reference(machine.model.dt, controller.preview)
    scenarios = Scenarios.of([job], [False], machine, loop.fed, controller.preview)
    runs = replay(controller, scenarios)
    still = np.zeros((reference.steps, len(machine.axes)))
    told = [], [], (0.0, 0.0)
    return Bent(job, 0, True, reference, still, roughness, scenarios.plants, runs, runs, *told)


@pytest.mark.slow
def test_a_reference_not_to_be_used_is_not_written(
    tmp_path, machine_file, part_file, monkeypatch, capsys
):
    monkeypatch.setattr(precompensate, "bent", unbent)
    flags = ["--plant", str(machine_file), "--out", str(tmp_path / "run")]
    assert main(["precompensate", str(part_file), *flags]) == 3
    told = capsys.readouterr().out
    assert "DO NOT USE THIS REFERENCE" in told
    assert "not written for that reason: reference.csv and part.ngc" in told
    written = {path.name for path in (tmp_path / "run").iterdir()}
    assert written == {"bent.png", "inputs", "result.json", "settings.json"}


def _runs(result, nominal, others):
    """Runs with these RMS contour errors [m]."""
    sizes = [nominal] + [others] * (len(result.after) - 1)
    return {
        name: replace(run, rms_contour_error=size)
        for (name, run), size in zip(result.after.items(), sizes, strict=True)
    }


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ("circle --roughness 0", "roughness: needs to be above zero"),
        (". --preview 5", "preview: the run in . has its own settings"),
        (".", "is not a run folder"),
    ],
)
def test_bad_input_is_one_line(flags, told, tmp_path, capsys):
    assert main(["precompensate", *flags.split(), "--out", str(tmp_path / "bent")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert re.search(told, line) and not (tmp_path / "bent").exists()
