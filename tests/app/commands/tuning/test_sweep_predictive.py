"""`sweep` of predictive control: what is asked for, equal bits on any workers, figures."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.cli import main
from jcontour.app.commands.tuning.sweep_predictive import (
    PredictiveSweepResult,
    dataset_of,
    found_along,
    summary_of,
    swept_of,
)
from jcontour.app.files.netcdf import load_dataset
from jcontour.app.files.results.stored import read_result
from jcontour.app.flags.tuning import Sweep
from jcontour.app.reports.figures.sweeps import (
    design_numbers,
    front_figure,
    surface_figure,
)
from jcontour.app.runs.spread.cluster import Killed
from jcontour.app.runs.spread.predictive_runs import Ending, PredictiveRun

FLAGS = Sweep(
    parts=("circle",),
    plant="xy-table",
    controller="tracking-mpc",
    vary=("increment=6,60",),
    previews=(3, 4),
    speeds_mm_s=(20.0, 40.0),
    workers=0,
    json=True,
)


@pytest.fixture(scope="module")
def asked():
    return swept_of(FLAGS)


@pytest.fixture(scope="module")
def made_up(asked):
    """The quicker the worse; one has diverged, and one was as quick as another and worse."""
    runs = [
        PredictiveRun(Ending.ARRIVED, 8.0 - number, 10.0 + number, 100.0, 0.5, 1e-12)
        for number in range(8)
    ]
    runs[3] = PredictiveRun(Ending.DIVERGED)
    runs[5] = replace(runs[4], rms_um=99.0)
    runs[7] = PredictiveRun(Ending.KILLED)
    return dataset_of(asked, runs)


def test_points_are_the_grid_in_the_order_of_the_dimensions(asked):
    found = [
        (one.design.speed_mm_s, one.design.horizon, one.design.weights["increment"])
        for one in asked.points()
    ]
    assert found == [(v, n, w) for v in (20, 40) for n in (3, 4) for w in (6, 60)]
    assert asked.shape == (1, 2, 2, 2)


def test_summary_counts_endings_and_finds_the_front(asked, made_up):
    found = summary_of(asked, made_up)
    assert (found.runs, found.arrived, found.diverged, found.killed) == (8, 6, 1, 1)
    assert (found.late, found.unsolved) == (0, 0)
    # runs 6, 4, 2, 1, 0: time falls with the number; 5 is as quick as 4
    assert [(one.time_s, round(one.rms_um, 9)) for one in found.front] == [
        (2.0, 16.0),
        (4.0, 14.0),
        (6.0, 12.0),
        (7.0, 11.0),
        (8.0, 10.0),
    ]
    assert found.front[0].weights == {"increment": 6.0} and found.front[0].horizon == 4


def test_two_contours_count_by_their_sum_of_times_and_their_worst_error(asked):
    twice = replace(asked, cases=asked.cases * 2, names=["one", "other"])
    run = PredictiveRun(Ending.ARRIVED, 2.0, 5.0, 6.0, 0.0, 0.0)
    runs = [run] * 8 + [replace(run, time_s=3.0, rms_um=7.0)] * 7 + [PredictiveRun(Ending.LATE)]
    time, error = design_numbers(dataset_of(twice, runs))
    assert time.ravel()[:7] == pytest.approx(5.0) and error.ravel()[:7] == pytest.approx(7.0)
    assert np.isnan(time.ravel()[7]) and np.isnan(error.ravel()[7])


def test_figures_show_the_numbers_and_cross_what_is_lost(made_up):
    above, below = surface_figure(made_up).axes[:2], surface_figure(made_up).axes[2:4]
    shown = np.concatenate([panel.collections[0].get_array() for panel in above])
    np.testing.assert_allclose(np.sort(shown), [10, 11, 12, 14, 16, 99])
    shown = np.concatenate([panel.collections[0].get_array() for panel in below])
    np.testing.assert_allclose(np.sort(shown), [2, 4, 4, 6, 7, 8])
    assert [panel.lines[0].get_xdata().tolist() for panel in above] == [[60.0], [60.0]]
    front = front_figure(made_up).axes[0].lines[-1]
    np.testing.assert_allclose(front.get_ydata(), [16, 14, 12, 11, 10])


def test_killed_runs_are_flagged_and_tried_again(asked, tmp_path, monkeypatch):
    kept = PredictiveRun(Ending.UNSOLVED)

    def answered(call, points, client):
        yield from ((k, Killed() if k == 2 else kept) for k in range(len(points)))

    monkeypatch.setattr("jcontour.app.commands.tuning.sweep_predictive.answers", answered)
    found = found_along(asked, tmp_path)
    assert [run.ending for run in found].count(Ending.KILLED) == 1
    assert found[2].ending is Ending.KILLED and len(list((tmp_path / "parts").iterdir())) == 7
    counted = []
    monkeypatch.setattr(
        "jcontour.app.commands.tuning.sweep_predictive.answers",
        lambda call, points, client: counted.extend(points) or [(0, kept)],
    )
    assert found_along(asked, tmp_path)[2] == kept
    assert [one.design for one in counted] == [list(asked.points())[2].design]


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"vary": ("q_theta=1",)}, "tracking-mpc has no weight 'q_theta'; name some of output"),
        ({"alpha": 1.0}, "alpha: tracking-mpc has no use for it"),
        ({"previews": (3, 101)}, "preview: needs 1 to 100 steps, received 101"),
        ({"speeds_mm_s": (0.0,)}, "speeds-mm-s: need numbers above zero"),
        ({"workers": -1}, "workers: needs at least 0"),
        ({"workers": 2, "scheduler": "tcp://a:1"}, "workers: the scheduler has its own"),
        ({"vary": ("increment=60,-1",)}, "increment: needs"),
        ({"plant": "flexible-axis"}, "axes"),
        ({"plant": "flexible-axes"}, "plant: flexible-axes states no limit on its controls"),
    ],
)
def test_bad_sweeps_are_refused(changed, says):
    with pytest.raises(ValueError, match=says):
        swept_of(replace(FLAGS, **changed))


def test_flags_of_predictive_control_are_refused_elsewhere(capsys):
    assert main(["sweep", "--workers", "2"]) == 2
    assert "workers: is for --controller mpcc, tracking-mpc" in capsys.readouterr().err


@pytest.mark.slow
def test_workers_find_the_same_bits(tmp_path, capsys):
    flags = ["circle", "--controller", "mpcc", "--plant", "xy-table", "--previews", "3", "5"]
    flags += ["--vary", "q_theta=1,30", "--speeds-mm-s", "40", "--json"]
    for workers in "02":
        out = ["--out", str(tmp_path / workers)]
        assert main(["sweep", *flags, "--workers", workers, *out]) == 0
    alone, other = (tmp_path / workers for workers in "02")
    files = sorted(path.name for path in (alone / "parts").iterdir())
    assert len(files) == 4
    assert (other / "result.json").read_bytes() == (alone / "result.json").read_bytes()
    for name in files:
        one = (alone / "parts" / name).read_bytes()
        assert (other / "parts" / name).read_bytes() == one
    assert load_dataset(other / "sweep.nc").identical(load_dataset(alone / "sweep.nc"))
    assert read_result(alone, PredictiveSweepResult).runs == 4
    assert {path.name for path in alone.iterdir()} == {
        *("settings.json", "parts", "sweep.nc", "sweep.png", "front.png", "result.json")
    }
