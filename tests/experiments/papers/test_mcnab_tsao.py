"""The reproduction of McNab & Tsao: the paper's numbers, ours, and the verdicts."""

import json
from io import StringIO
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console

from experiments.papers.mcnab_tsao import experiment
from experiments.papers.mcnab_tsao.claims import run_of
from experiments.papers.mcnab_tsao.runs import (
    RHO,
    AnyHorizonLQ,
    Bench,
    Law,
    Member,
    family,
    radii_on_lines,
)
from experiments.papers.verdicts import Verdict
from jcontour.analysis.stability import frozen_spectral_radii
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.plants.wrappers.delays import Delayed

DATA = Path(__file__).parents[2] / "data" / "mcnab"
NUMBERS = {"te": "te_um", "ce": "ce_um", "pce": "projected_um", "u": "control", "du": "increment"}
ALLOWED = {"reproduced", "same ordering", "experimental: shown, not matched", "not reproduced"}


def load(name):
    return json.loads((DATA / f"{name}.json").read_text())


@pytest.fixture(scope="module")
def bench():
    return Bench(family(0.1, 2))


@pytest.fixture(scope="module")
def summary(tmp_path_factory):
    """A --quick run, as the command line stores it."""
    folder, told = tmp_path_factory.mktemp("run"), []
    found = experiment.run(
        experiment.Settings(quick=True), folder, lambda part, doing: told.append(part)
    )
    assert told == sorted(told) and told[0] == 0.0 and told[-1] == 1.0
    assert not list(folder.iterdir())
    return json.loads(json.dumps(found, allow_nan=False))


def test_published_rows_are_the_papers():
    assert [row.case for row in experiment.PUBLISHED] == ["I", "II", "III", "IV", "finite preview"]
    assert [row.te_um for row in experiment.PUBLISHED] == [3.35, 43.07, 4.10, 6.55, 4.10]
    assert [row.ce_um for row in experiment.PUBLISHED] == [3.07, 1.07, 3.78, 1.70, 3.78]


@pytest.mark.parametrize(
    "field, value",
    [("delay", 0), ("gain_error", 1.0), ("gain_error", -0.1), ("gain_error", float("nan"))],
)
def test_settings_name_the_field_that_is_wrong(field, value):
    with pytest.raises(ValueError, match=field):
        experiment.Settings(**{field: value})


def test_family_of_the_reference_numbers():
    wanted = [(m["gx"], m["gy"], m["delay"]) for m in load("tuning")["robust"]["family"]]
    assert [pytest.approx(m) for m in family(0.1, 2)] == wanted


@pytest.mark.parametrize(
    "law, te, ce",
    [
        (Law("output", 8.0, 0.0), 1.872, 1.266),
        (Law("output", 1.2, 20.0), 16.184, 0.341),
        (Law("dare", 3.0, 0.0), 3.378, 2.903),
        (Law("dare", 0.25, 15.0), 11.154, 0.602),
    ],
)
def test_cases_of_table_1_in_steady_state(bench, law, te, ce):
    run = bench.run(bench.plan(law, bench.circle), bench.circle)
    assert 1e6 * run.metrics.rms_tracking_error[0] == pytest.approx(te, abs=6e-4)
    assert 1e6 * run.metrics.rms_contour_error[0] == pytest.approx(ce, abs=6e-4)


def test_u_shape_falls_then_rises_then_loses_stability(bench):
    wanted = load("tuning")["robust"]["u_shape"]
    runs = {
        alpha: bench.run(bench.plan(Law("output", alpha, 0.0), bench.circle), bench.circle)
        for alpha in [*wanted["alpha"], 20.0]
    }
    for alpha, te, ce in zip(wanted["alpha"], wanted["te_um"], wanted["ce_um"], strict=True):
        late = jax.tree.map(lambda values: values[-1], runs[alpha].metrics)
        assert (1e6 * late.rms_tracking_error, 1e6 * late.rms_contour_error) == pytest.approx(
            (te, ce), abs=0.00501
        )
    assert [alpha for alpha, run in runs.items() if run.spectral_radius[-1] >= 1] == [8.0, 20.0]
    assert runs[8.0].spectral_radius[-1] == pytest.approx(1.0023, abs=5e-5)
    assert runs[20.0].spectral_radius[-1] == pytest.approx(1.07, abs=5e-4)
    assert [alpha for alpha, run in runs.items() if run.metrics.diverged[-1]] == [20.0]


@pytest.mark.parametrize(
    "row",
    load("line_spectral_radii"),
    ids=lambda row: f"{row['terminal']}-{row['alpha']:g}-{row['rho']:.0e}",
)
def test_one_recursion_gives_the_radii_of_all_horizons(bench, row):
    angles = jnp.deg2rad(jnp.array(row["theta_deg"]))
    radii = radii_on_lines(
        bench.model, LQWeights(row["alpha"], row["beta"], row["rho"]), angles, 50
    )
    found = radii[np.array(row["Np"]) - 1, ("output", "dare").index(row["terminal"])]
    np.testing.assert_allclose(found, row["radius"], rtol=1e-6)


@pytest.mark.parametrize(
    "terminal, horizon",
    [
        ("output", 1),
        ("dare", 4),
        pytest.param("output", 30, marks=pytest.mark.slow),
        pytest.param("dare", 1, marks=pytest.mark.slow),
    ],
)
def test_any_horizon_is_contouring_lq(bench, terminal, horizon):
    weights = LQWeights(0.25, 15.0, RHO)
    prepared = eqx.filter_jit(lambda controller, reference: controller.prepare(reference))
    shared = prepared(
        AnyHorizonLQ(bench.model, weights, horizon, bench.terminals[terminal]), bench.circle
    )
    plain = prepared(
        ContouringLQ(bench.model, weights, horizon, bench.terminals[terminal]), bench.circle
    )
    for part in ("F", "f"):
        difference = np.max(np.abs(getattr(shared, part) - getattr(plain, part)))
        assert difference < 1e-11 * np.max(np.abs(getattr(plain, part)))


@pytest.mark.slow
@pytest.mark.parametrize("member, machine", list(enumerate(family(0.1, 2)))[2:])
def test_frozen_radius_is_that_of_the_library(bench, member: int, machine: Member):
    law = Law("output", 1.2, 5.0)
    plant = bench.perturbed[member]
    if machine.delay:
        plant = Delayed(plant, jnp.asarray(machine.delay), machine.delay, 2)
    controller = ContouringLQ(bench.model, LQWeights(law.alpha, law.beta, RHO), law.preview)
    library = frozen_spectral_radii(plant, controller, bench.circle)[502:753:5].max()
    F = np.asarray(bench.plan(law, bench.circle).F)[502:753:5]
    assert bench.frozen_radius(F)[member] == pytest.approx(library, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("table, count", [("circle_grid", 60), ("circle_np_scan", 120)])
def test_every_run_on_the_circle(summary, table, count):
    rows = load(table)
    assert len(rows) == count
    for row in rows:
        ours = run_of(summary, row["terminal"], row["alpha"], row["beta"], row["Np"])["machines"][0]
        assert {key: ours[name] for key, name in NUMBERS.items()} == pytest.approx(
            {key: row[key] for key in NUMBERS}, rel=1e-6
        )


@pytest.mark.slow
def test_theorem_1(summary):
    theorem = summary["theorem_1"]
    assert len(theorem["sets"]) == 36
    assert all(
        len(one[terminal]) == 50 for one in theorem["sets"] for terminal in ("output", "dare")
    )
    assert max(max(one["dare"]) for one in theorem["sets"]) < 0.89
    assert {(case["terminal"], case["preview"]) for case in theorem["unstable"]} == {("output", 1)}
    assert all(case["rho"] < 1e-10 for case in theorem["unstable"])
    assert len(theorem["unstable"]) == 22


@pytest.mark.slow
def test_verdicts(summary):
    verdicts = {}
    for row in summary["claims"]:
        verdicts.setdefault(row["item"], []).append(row["verdict"])
    assert {verdict for found in verdicts.values() for verdict in found} <= ALLOWED
    assert {row["verdict"] for row in summary["table_1"]} == {Verdict.EXPERIMENTAL.value}
    assert verdicts["Fig. 9, output"] == [Verdict.REPRODUCED.value]
    assert (
        verdicts["Theorem 1"]
        == verdicts["Table 1, last row"]
        == verdicts["Fig. 2"]
        == [Verdict.REPRODUCED.value]
    )
    assert (
        verdicts["Fig. 3"]
        == verdicts["Fig. 5"]
        == verdicts["Fig. 4"]
        == [Verdict.SAME_ORDERING.value]
    )
    assert verdicts["Fig. 6"] == [
        Verdict.SAME_ORDERING.value,
        Verdict.NOT_REPRODUCED.value,
        Verdict.NOT_REPRODUCED.value,
    ]
    assert verdicts["line at 37 deg, output"][0] == Verdict.NOT_REPRODUCED.value
    assert summary["finite_preview"]["largest_gain_difference"] < 1e-9
    assert summary["table_1"][4]["te_um"]["ours"] == pytest.approx(
        summary["table_1"][2]["te_um"]["ours"], rel=1e-9
    )


@pytest.mark.slow
def test_figures_and_tables(summary, tmp_path):
    made = experiment.draw(summary, tmp_path)
    assert sorted(made) == sorted(tmp_path.glob("*.png"))
    assert len(made) == 5 and all(path.stat().st_size > 10_000 for path in made)
    printed = StringIO()
    experiment.show(summary, Console(width=100, file=printed))
    text = printed.getvalue()
    for word in ("43.07", "0.341", "shown, not matched", "1.0023", "8/20/2e-13", "[um]"):
        assert word in text


def test_outputs_of_a_run_are_plain(bench):
    row = experiment._row(
        Law("output", 20.0, 0.0),
        bench.run(bench.plan(Law("output", 20.0, 0.0), bench.circle), bench.circle),
    )
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert [m["diverged"] for m in row["machines"]] == [False, False, False, False, True]
    assert not any(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(row))
