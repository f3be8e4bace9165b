from dataclasses import replace

import numpy as np
import pytest

from experiments.benchmarks.records import identify
from experiments.benchmarks.records.hidden_machines import (
    DT,
    PROGRAMS,
    late_by_a_part,
    true_model,
)
from experiments.benchmarks.records.identify import (
    HiddenResult,
    IdentifyBench,
    bandwidth,
    response,
    tables,
)
from experiments.tables import show
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import console_of
from jcontour.linear.continuous_axes import force_axis, position_axis, speed_axis, with_resonance
from tuning.identification.linear.evidence import Response
from tuning.identification.linear.recording import RecordedAxis

HERTZ = np.array([0.5, 5.0, 60.0])


def axis(one, takes, *loop):
    return RecordedAxis(one, takes, 1e-6, 0.0, 0.0, loop)


@pytest.mark.parametrize(
    "one",
    [
        axis(with_resonance(speed_axis(1.0, 0.01, 2e-3), 300.0, 0.1), "speed", 5.0),
        axis(position_axis(1.0, 0.01, 1e-3), "position", 1.0),
        axis(force_axis(35.0, 90.0, 200.0), "force", 5.0, 100.0),
    ],
)
def test_the_true_model_answers_as_the_sampled_axis(one):
    assert np.allclose(true_model(one).response(2 * np.pi * HERTZ), response(one, HERTZ), rtol=1e-4)


def test_the_bandwidth_of_a_first_order_loop():
    """10 / (s + 10): 10 rad/s."""
    one = axis(speed_axis(1.0), "speed", 10.0)
    assert bandwidth(one) == pytest.approx(10 / (2 * np.pi), rel=0.02)


ROW = HiddenResult("contour", 0, "speed", 2, 1.0, 2, True, 3.0, 0.01, 0.9, 0.8, 1.02, 1.0)


def test_axes_that_are_kept_are_not_identified_again(monkeypatch, tmp_path):
    ran = []

    def run(program, machine):
        ran.append((program, machine))
        return [replace(ROW, program=program, seed=2 * machine + k) for k in (0, 1)]

    monkeypatch.setattr(identify, "_identified", run)
    flags = Bench(what="identify", seeds=2, first_seed=3, keep=tmp_path / "axes.json")
    before = identify.measured(flags, print)
    assert ran == [(program, machine) for program in PROGRAMS for machine in (3, 4)]
    ran.clear()
    after = identify.measured(replace(flags, seeds=3), print).axes
    assert ran == [(PROGRAMS[0], 5), (PROGRAMS[1], 5)]
    assert [one.seed for one in after] == 2 * [6, 7, 8, 9, 10, 11]
    assert [one for one in after if one.seed < 10] == before.axes


def test_what_is_printed(capsys):
    rows = [ROW, replace(ROW, seed=2, delay=2.7, seconds=3.0)]
    show(console_of(), tables(IdentifyBench(rows, 60.0)))
    printed = capsys.readouterr().out
    assert "1.02" in printed and "2 s for 60 s" in printed
    whole, parted = (line.split() for line in printed.splitlines() if "contour " in line)
    assert whole[1:5] == ["without", "1", "0", "1"]
    assert parted[1:5] == ["without,", "1", "1", "1"]  # 2 is exact of 2.7


def test_a_part_of_a_sample_is_all_that_is_added():
    one = axis(speed_axis(1.0, 0.01, 2 * DT), "speed", 5.0)
    late = late_by_a_part(one, DT, np.random.default_rng(0))
    assert 2.1 < late.axis.delay / DT < 2.9
    for name, value in vars(one.axis).items():
        if name != "delay":
            np.testing.assert_array_equal(getattr(late.axis, name), value)
    assert {**vars(late), "axis": None} == {**vars(one), "axis": None}


def test_an_interval_that_holds_the_truth_at_half_of_the_frequencies():
    one = axis(speed_axis(1.0, 0.01), "speed", 5.0)
    truth = response(one, HERTZ)
    stated = Response(HERTZ, truth * np.array([1.0, 1.1, 1.0]), np.array([0.01, 0.01, 0.01]))
    assert identify._holds(one, stated) == pytest.approx(2 / 3)
