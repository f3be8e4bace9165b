"""The reproduction of McNab & Tsao: the paper's numbers, ours, and the verdicts."""

import json
from collections import defaultdict
from dataclasses import astuple

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.papers.mcnab_tsao import experiment
from experiments.papers.mcnab_tsao import experiment as paper
from experiments.papers.mcnab_tsao.claims import claims, table_1
from experiments.papers.verdicts import Verdict
from jcontour.analysis.stability import frozen_spectral_radii
from jcontour.app.files.results.stored import to_json
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.plants.actuation import Delayed
from jcontour.simulation.closed_loop import prepared
from tests.reference_data import numbers_of

NUMBERS = {"te": "te_um", "ce": "ce_um", "pce": "projected_um"}
YES, PARTLY, NO = Verdict.REPRODUCED, Verdict.SAME_ORDERING, Verdict.NOT_REPRODUCED


@pytest.fixture(scope="module")
def setup():
    return paper.Setup()


@pytest.fixture(scope="module")
def result():
    return experiment.run(quick=True)


def test_family_of_the_reference_numbers():
    family = numbers_of("mcnab/tuning")["robust"]["family"]
    wanted = [(m["gx"], m["gy"], m["delay"]) for m in family]
    assert [pytest.approx(astuple(member)[1:]) for member in paper.FAMILY] == wanted


@pytest.mark.parametrize(
    "case, te, ce",
    [
        (paper.Case("output", 8.0, 0.0), 1.872, 1.266),
        (paper.Case("output", 1.2, 20.0), 16.184, 0.341),
        (paper.Case("dare", 3.0, 0.0), 3.378, 2.903),
        (paper.Case("dare", 0.25, 15.0), 11.154, 0.602),
    ],
)
def test_cases_of_table_1_in_steady_state(setup, case, te, ce):
    (nominal, *_), _ = setup.run(setup.plan(case, setup.circle), setup.circle)
    assert (nominal.te_um, nominal.ce_um) == pytest.approx((te, ce), abs=6e-4)


def test_u_shape_falls_then_rises_then_loses_stability(setup):
    wanted = numbers_of("mcnab/tuning")["robust"]["u_shape"]
    runs = {}
    for alpha in [*wanted["alpha"], 20.0]:
        plan = setup.plan(paper.Case("output", alpha, 0.0), setup.circle)
        runs[alpha] = setup.run(plan, setup.circle)[0][-1]  # the latest
    for alpha, te, ce in zip(wanted["alpha"], wanted["te_um"], wanted["ce_um"], strict=True):
        assert (runs[alpha].te_um, runs[alpha].ce_um) == pytest.approx((te, ce), abs=0.00501)
    assert [alpha for alpha, run in runs.items() if not run.stable] == [8.0, 20.0]
    assert runs[8.0].spectral_radius == pytest.approx(1.0023, abs=5e-5)
    assert runs[20.0].spectral_radius == pytest.approx(1.07, abs=5e-4)
    assert [alpha for alpha, run in runs.items() if run.diverged] == [20.0]


@pytest.mark.parametrize(
    "row",
    numbers_of("mcnab/line_spectral_radii"),
    ids=lambda row: f"{row['terminal']}-{row['alpha']:g}-{row['rho']:.0e}",
)
def test_one_recursion_gives_the_radii_of_all_horizons(setup, row):
    weights = LQWeights(row["alpha"], row["beta"], row["rho"])
    radii = paper.radii_on_lines(setup.model, weights, np.deg2rad(row["theta_deg"]), 50)
    radius = radii[np.array(row["Np"]) - 1, ("output", "dare").index(row["terminal"])]
    np.testing.assert_allclose(radius, row["radius"], rtol=1e-6)


@pytest.mark.parametrize(
    "terminal, horizon",
    [("output", 1), ("dare", 4)],
)
def test_any_horizon_is_contouring_lq(setup, terminal, horizon):
    weights, end = LQWeights(0.25, 15.0, paper.RHO), setup.terminals[terminal]
    plain = prepared(ContouringLQ(setup.model, weights, horizon, end), setup.circle)
    shared = paper.any_horizon(setup.model, weights, jnp.asarray(horizon), end, setup.circle)
    for part in ("F", "f"):
        difference = np.max(np.abs(np.subtract(getattr(shared, part), getattr(plain, part))))
        assert difference < 1e-11 * np.max(np.abs(getattr(plain, part)))


@pytest.mark.parametrize("member, machine", list(enumerate(paper.FAMILY))[2:])
def test_frozen_radius_is_that_of_the_library(setup, member, machine):
    case = paper.Case("output", 1.2, 5.0)
    plant = setup.perturbed[member]
    if machine.delay:
        plant = Delayed(plant, jnp.asarray(machine.delay), machine.delay, 2)
    controller = ContouringLQ(
        setup.model, LQWeights(case.alpha, case.beta, paper.RHO), case.preview
    )
    library = frozen_spectral_radii(plant, controller, setup.circle)[502:753:5].max()
    F = np.asarray(setup.plan(case, setup.circle).F)[502:753:5]
    assert setup.frozen_radius(F)[member] == pytest.approx(library, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("table, count", [("circle_grid", 60), ("circle_np_scan", 120)])
def test_every_run_on_the_circle(result, table, count):
    rows = numbers_of(f"mcnab/{table}")
    assert len(rows) == count
    for row in rows:
        ours = result.on_family(row["terminal"], row["alpha"], row["beta"], row["Np"])[0]
        numbers = {key: getattr(ours, name) for key, name in NUMBERS.items()}
        assert numbers == pytest.approx({key: row[key] for key in NUMBERS}, rel=1e-6)


@pytest.mark.slow
def test_theorem_1(result):
    assert result.radii.shape == (36, 2, 50)
    assert result.radii[:, 1].max() < 0.89
    sets, terminals, horizons = np.nonzero(result.radii >= 1)
    assert len(sets) == 22 and not terminals.any() and not horizons.any()  # output terminal, one
    assert all(paper.THEOREM_WEIGHTS[one][2] < 1e-10 for one in sets)


@pytest.mark.slow
def test_verdicts(result):
    verdicts = defaultdict(list)
    for row in claims(result):
        verdicts[row.item].append(row.verdict)
    for item in ("Fig. 9, output", "Theorem 1", "Table 1, last row", "Fig. 2"):
        assert verdicts[item] == [YES]
    for item in ("Fig. 3", "Fig. 4", "Fig. 5"):
        assert verdicts[item] == [PARTLY]
    assert verdicts["Fig. 6"] == [PARTLY, NO, NO]
    assert verdicts["line at 37 deg, output"][0] == NO
    assert result.largest_gain_difference < 1e-9
    finite, case_iii = table_1(result)[4], table_1(result)[2]
    assert finite.ours.te_um == pytest.approx(case_iii.ours.te_um, rel=1e-9)


def test_a_diverged_machine_has_no_numbers(setup):
    case = paper.Case("output", 20.0, 0.0)
    machines, _ = setup.run(setup.plan(case, setup.circle), setup.circle)
    assert [machine.diverged for machine in machines] == [False, False, False, False, True]
    assert machines[-1].te_um == np.inf and not machines[-1].stable
    stored = to_json(machines)
    assert json.loads(json.dumps(stored, allow_nan=False)) == stored
    assert stored[-1]["te_um"] is None
