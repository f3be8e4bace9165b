"""`sweep`: what it makes of its flags, and a small one from the command line."""

import json
import shlex

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from experiments.catalogue.choices import design_for, machine_named
from experiments.cli import _chosen, main
from experiments.commands.tuning.sweep import (
    BestDesign,
    SweepResult,
    Swept,
    _limit_lines,
    _next_steps,
    edge_lines,
    horizons,
    sampled_values,
    swept_of,
)
from experiments.files.netcdf import load_dataset
from experiments.files.results.stored import read_result
from experiments.flags.tuning import Sweep, Tune

NAMES = ("alpha", "beta")


@pytest.fixture(scope="module")
def flags(machine_file, part_file):
    """Four designs with one preview; the large alpha diverges where a drive is late."""
    vary = ["--vary", "alpha=2,2e6", "beta=0.5,5", "--previews", "4"]
    vary += [
        "--controller",
        "contouring-lq-kalman",
        "--weights",
        "control_noise=5",
        "--rho",
        "2e-9",
    ]
    return [str(part_file), "--plant", str(machine_file), *vary]


@pytest.fixture(scope="module")
def swept(tmp_path_factory, flags):
    folder = tmp_path_factory.mktemp("sweep") / "run"
    assert main(["sweep", *flags, "--devices", "1", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def dataset(swept):
    return load_dataset(swept / "sweep.nc")


@pytest.mark.slow
def test_every_file_is_there(swept):
    found = {path.name for path in swept.iterdir()}
    assert found == {"settings.json", "inputs", "parts", "sweep.nc", "sweep.png", "result.json"}


@pytest.mark.slow
def test_designs_are_the_grid(dataset):
    places = list(zip(dataset.alpha.values, dataset.beta.values, strict=True))
    assert places == [(2, 0.5), (2, 5), (2e6, 0.5), (2e6, 5)]
    assert dataset.rms_contour_error.dims == ("preview", "sample", "contour", "plant")
    assert dataset.rms_contour_error.attrs["units"] == "m" and dataset.plant.values[0] == "nominal"


@pytest.mark.slow
def test_the_summary_is_that_of_the_metrics(swept, dataset):
    result = read_result(swept, SweepResult)
    lost = dataset.diverged.values.astype(bool).any(axis=(2, 3))[0]
    assert lost.tolist() == [False, False, True, True]
    assert (result.points, result.diverged) == (4, 2)
    (best,) = result.best
    errors = 1e6 * dataset.rms_contour_error.values[0]
    worst = np.where(lost, np.inf, errors.max(axis=(1, 2)))
    alike = [k for k in range(4) if worst[k] <= 1.01 * worst.min()]
    i = min(alike, key=lambda k: float(dataset.rms_increment.values[0, k].max()))
    assert best.preview == 4
    assert best.weights == {name: float(dataset[name][i]) for name in NAMES}
    assert best.worst_um == errors[i].max() and best.nominal_um == errors[i, :, 0].max()


OWN = """
import jax.numpy as jnp
from jcontour.controller import Controller


class Proportional(Controller):
    gain: float = 1.0
    feedforward: float = 1.0
    preview: int = 0

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return memory, self.gain * (plan - measurement) + 0 * self.feedforward
"""


@pytest.mark.slow
def test_a_finished_sweep_says_what_it_drew_what_diverged_and_what_is_next(swept, capsys):
    assert main(["sweep", "--resume", str(swept)]) == 0
    printed = capsys.readouterr().out
    assert "4 points, 2 diverged, 2 within the limits" in printed
    assert "Diverged: preview 4, alpha 2e+06, beta 0.5\n" in printed
    assert "Drawn: sweep.png" in printed
    assert "Next: tune from the best point with jcontour tune " in printed
    assert f"Run folder: {swept}" in printed


def test_what_is_tuned_next_is_the_controller_that_was_swept(tmp_path):
    (tmp_path / "mine.py").write_text(OWN)
    flags = Sweep(
        parts=("circle",),
        controller=f"{tmp_path / 'mine.py'}:Proportional",
        weights=("feedforward=2",),
        previews=(0,),
        max_sensitivity=1.5,
        max_peak_control=5.0,
    )
    asked = Swept(flags, machine_named(flags.plant), [], {})
    broken = _best(worst_um=0.5, weights={"gain": 1e9}, beyond={"peak_sensitivity": 41.0})
    best = _best(weights={"gain": 15000.0})
    [line] = _next_steps(asked, SweepResult(points=2, diverged=0, within=2, best=[broken, best]))
    words = line[line.index("jcontour ") :]
    assert _chosen(shlex.split(words)[1:])[0] == Tune(
        parts=("circle",),
        controller=flags.controller,
        weights=("feedforward=2", "gain=15000"),
        max_sensitivity=1.5,
        max_peak_control=5.0,
    )


def _best(**other):
    given = {"preview": 0, "weights": {"gain": 1.0}, "worst_um": 1.0, "nominal_um": 1.0}
    return BestDesign(**{**given, "sensitivity": 1.4, "delay_samples": 3, **other})


LIMITED = Swept(Sweep(max_peak_contour_error_um=1.0), machine_named("bridgeport"), [], {})


def judged_as(best, peaks_um=(3.0, 2.0)):
    """Peak errors of two designs with one preview."""
    errors = 1e-6 * np.reshape(peaks_um, (1, 2, 1, 1))
    names = ("preview", "sample", "contour", "plant")
    metrics = ("rms_contour_error", "peak_contour_error", "diverged")
    data = {name: (names, errors) for name in metrics} | {"diverged": (names, 0 * errors)}
    return xr.Dataset(data | {"best": ("preview", [best])}, {"preview": [5]})


def test_where_no_design_keeps_the_limits_it_is_said_and_how_near_they_come():
    nothing = SweepResult(points=2, diverged=0, within=0, best=[])
    (line,) = _limit_lines(LIMITED, judged_as(-1), nothing)
    assert line == (
        "WARNING: preview 5: none of 2 designs keeps the limits; the least of each: "
        "peak contour error 2 um (limit 1)"
    )
    assert _next_steps(LIMITED, nothing)[0].startswith("Next: no design keeps the limits; allow")
    lost = SweepResult(points=2, diverged=2, within=0, best=[])
    assert _next_steps(LIMITED, lost)[0].startswith("Next: every design diverges")


def test_a_best_design_beyond_a_limit_of_its_loops_has_a_warning():
    found = _best(looked=3, beyond={"peak_sensitivity": 41.2, "late_radius": 1.1})
    result = SweepResult(points=3, diverged=0, within=3, best=[found])
    (line,) = _limit_lines(LIMITED, judged_as(0), result)
    assert line.startswith("WARNING: preview 0: the best design breaks a limit: its Ms is 41.2, a ")
    assert line.endswith("--min-delay-margin asks for, and 2 next best ones break a limit as well")
    passed = SweepResult(points=3, diverged=0, within=3, best=[_best(looked=2)])
    (line,) = _limit_lines(LIMITED, judged_as(0), passed)
    assert line.startswith("With preview 0, 1 design with less error")
    kept = SweepResult(points=3, diverged=0, within=3, best=[_best()])
    assert _limit_lines(LIMITED, judged_as(0), kept) == []


@pytest.mark.slow
def test_limits_on_runs_decide_which_design_is_the_best(swept, dataset, flags, tmp_path):
    """A peak control between those of the two designs that do not diverge leaves one of them."""
    peaks = dataset.peak_control.values[0].max(axis=(1, 2))[:2]
    words = ["--max-peak-control", str(float(np.mean(peaks))), "--max-sensitivity", "1.0001"]
    folder = tmp_path / "limited"
    assert main(["sweep", *flags, *words, "--devices", "1", "--out", str(folder)]) == 0
    result, found = read_result(folder, SweepResult), load_dataset(folder / "sweep.nc")
    assert found.within_limits.values.tolist() == [[*(peaks < peaks.mean()).tolist(), 0, 0]]
    assert (result.within, result.best[0].looked) == (1, 1)
    assert result.best[0].beyond["peak_sensitivity"] == pytest.approx(result.best[0].sensitivity)
    assert found.best.values.tolist() == [int(np.argmin(peaks))]


@pytest.mark.parametrize(
    ("word", "value"),
    [("max_sensitivity", 0.9), ("max_count_noise", 0.0), ("max_peak_control", -1.0)],
)
def test_what_is_no_limit_is_refused(word, value):
    with pytest.raises(ValueError, match=word.replace("_", "-")):
        swept_of(Sweep(parts=("circle",), **{word: value}))


def test_previews_have_one_flag():
    with pytest.raises(ValueError, match="preview: a sweep has --previews"):
        swept_of(Sweep(parts=("circle",), preview=5))


def test_a_limit_that_a_sweep_does_not_look_at_is_no_flag_of_it(capsys):
    with pytest.raises(SystemExit):
        main(["sweep", "circle", "--max-effort", "1.2"])
    assert "--max-effort" in capsys.readouterr().err


@pytest.mark.slow
def test_weights_stand_beside_the_errors_in_json(swept):
    (best,) = json.loads((swept / "result.json").read_text())["best"]
    names = ["preview", "alpha", "beta", "worst_um", "nominal_um", "sensitivity", "delay_samples"]
    assert list(best)[:7] == names


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "controller", "found"),
    [
        ("bridgeport", None, (5, 10, 20)),
        ("flexible-axis", "cascade", (1,)),
        ("gantry", "cascade", (1,)),
        ("gantry", "contouring-lq", (5, 10, 20)),
    ],
)
def test_previews_that_differ_are_swept(plant, controller, found):
    assert (
        horizons(
            Sweep(plant=plant, controller=controller, previews=(5, 10, 20, 10)),
            machine_named(plant),
        )
        == found
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "controller", "start", "ends", "count"),
    [
        ("bridgeport", None, {"alpha": 1.2, "beta": 20.0}, (1e-2, 1e4), 49),
        ("gantry", "contouring-lq", {"alpha": 1e8, "beta": 1e9}, (1e-2, 1e4), 49),
        (
            "gantry",
            "cascade",
            {"position": 30.0, "integral_time": 0.05},
            (0.1, 10.0),
            25,
        ),  # the velocity gain of X is not that of Y
    ],
)
def test_what_varies_lies_around_the_start(plant, controller, start, ends, count):
    """Weights of a cost over six decades, gains over two."""
    flags = Sweep(plant=plant, controller=controller)
    values = sampled_values(flags, design_for(machine_named(plant), flags))
    assert list(values) == list(start)
    for name, column in values.items():
        assert column.size == count and start[name] in column
        factors = float(column.min()) / start[name], float(column.max()) / start[name]
        assert factors == pytest.approx(ends)


def test_what_varies_can_be_named():
    flags = Sweep(vary=("alpha=1,2", "beta=0,5,20"))
    values = sampled_values(flags, design_for(machine_named("bridgeport"), flags))
    assert sorted(zip(*map(np.ndarray.tolist, map(np.asarray, values.values())), strict=True)) == [
        (1, 0),
        (1, 5),
        (1, 20),
        (2, 0),
        (2, 5),
        (2, 20),
    ]


def test_a_best_point_on_the_edge_of_its_grid_is_told():
    grid = {"alpha": jnp.array([1.0, 2.0, 3.0]), "beta": jnp.array([4.0, 5.0, 4.0])}
    grid["rho"] = np.full(3, 7.0)  # one value has no edge
    worst = np.array([9.0, 5.0, 8.0])
    (line,) = edge_lines({"alpha": 2.0, "beta": 5.0, "rho": 7.0}, grid, worst)
    assert line.startswith("The best beta, 5, lies on the edge of the grid: try larger ones")
    assert edge_lines({"alpha": 2.0, "beta": 4.5, "rho": 7.0}, grid, worst) == []
    (line,) = edge_lines({"alpha": 1.0, "beta": 4.5, "rho": 7.0}, grid, np.array([5.0, 6.0, 9.0]))
    assert "alpha, 1, lies on the edge of the grid: try smaller ones" in line


def test_an_edge_that_is_no_better_than_the_inside_is_not_told():
    """Where an error hardly falls any more, a wider grid brings nothing."""
    grid, best = {"alpha": jnp.array([1.0, 2.0, 3.0])}, {"alpha": 3.0}
    assert edge_lines(best, grid, np.array([9.0, 5.04, 5.0])) == []
    assert len(edge_lines(best, grid, np.array([9.0, 5.06, 5.0]))) == 1
    grid["beta"] = jnp.array([1.0, 1.0, 2.0])  # of alpha inside, and at an end of beta
    assert len(edge_lines(best | {"beta": 2.0}, grid, np.array([9.0, 5.04, 5.0]))) == 2
