"""Yuan's contouring controllers: verdicts on made-up results, tubes and runs on the gantry."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.papers.verdicts import Verdict
from experiments.papers.yuan_contouring_bounded import experiment as paper
from experiments.papers.yuan_contouring_bounded.claims import claims, errors
from experiments.papers.yuan_contouring_bounded.controllers import controller, random_forces
from experiments.papers.yuan_contouring_bounded.tubes import POINTS, driven, tube
from experiments.papers.yuan_gantry.experiment import SAMPLE
from jcontour.plants.gantry.gantry import Gantry, thesis_gantry
from jcontour.plants.gantry.linear_models import tangent
from tests.reference_data import numbers_of

CASES = numbers_of("guarantees/polygons")
YES, PARTLY, NO = Verdict.REPRODUCED, Verdict.IN_PART, Verdict.NOT_REPRODUCED


def row(name: str, models: str, promised: float, **others) -> paper.LoopRow:
    """A made-up run that reaches nine tenths of its promise."""
    return paper.LoopRow(
        **{
            "name": name,
            "models": models,
            "machine": paper.GANTRY,
            "acting": paper.ATTACKED,
            "states": 6,
            "promised_um": promised,
            "reached_um": 0.9 * promised,
            "promised_axes_um": (30.0, 10.0) if name == paper.CEBC1 else None,
            "reached_axes_um": (20.0, 9.0),
            "promised_twist_urad": 20.0,
            "reached_twist_urad": 10.0,
            "closed": 0.9,
            "motor_share": 1.0,
            "remainder_share": 0.5,
            "current_a": 3.0,
            "unsolved": 0,
            "median_ms": 0.1,
            "samples": 4,
            "diverged": False,
            "contour_error_um": np.zeros(4),
            **others,
        }
    )


def made_up() -> paper.Result:
    return paper.Result(
        sides=(10, 11),
        printed_side_mm=79.9,
        loops=(
            row(paper.CEBC1, paper.FOUR, 40.0),
            row(paper.CEBC2, paper.ONE, 5.0),
            row(paper.CEBC2, paper.FOUR, 4.0),
            row(paper.CEBC2, paper.EVERY, 3.0),
            row(paper.CEBC2, paper.EVERY, 4.0, machine=paper.GUIDES, acting=paper.FRICTION),
            row(paper.CEBC2, paper.EVERY, 10.0, states=9),
        ),
    )


def verdicts(result: paper.Result) -> dict[str, Verdict]:
    return {one.claim: one.verdict for one in claims(result)}


def without(result: paper.Result, place: int, **others) -> dict[str, Verdict]:
    loops = list(result.loops)
    loops[place] = replace(loops[place], **others)
    return verdicts(replace(result, loops=tuple(loops)))


def of(verdicts: dict[str, Verdict], words: str) -> Verdict:
    (one,) = [verdict for claim, verdict in verdicts.items() if words in claim]
    return one


def test_verdicts_follow_the_numbers():
    result = made_up()
    judged = verdicts(result)
    assert of(judged, "bounded tracking errors") is YES
    assert of(judged, "X and Y stay within") is YES
    assert of(judged, "contour error itself") is YES
    assert of(judged, "smaller contour error") is YES
    assert of(judged, "stay feasible") is PARTLY
    assert of(judged, "10 and 10 sides") is NO
    assert of(judged, "more linearisation points") is PARTLY
    assert of(judged, "longer time") is NO
    assert of(judged, "one sample late") is Verdict.EXPERIMENTAL
    assert of(judged, "nonlinear friction") is Verdict.EXPERIMENTAL
    assert of(without(result, 0, reached_um=41.0), "bounded tracking errors") is NO
    assert of(without(result, 0, closed=1.01), "bounded tracking errors") is NO
    assert of(without(result, 0, reached_axes_um=(31.0, 9.0)), "X and Y stay within") is NO
    for fault in ({"closed": 1.01}, {"unsolved": 1}, {"diverged": True}):
        assert of(without(result, 0, **fault), "X and Y stay within") is NO
        for place in (0, 3):
            assert of(without(result, place, **fault), "smaller contour error") is NO
    assert of(without(result, 3, unsolved=1), "contour error itself") is NO
    assert of(without(result, 3, unsolved=1), "stay feasible") is NO
    assert of(without(result, 3, promised_um=41.0), "smaller contour error") is NO
    assert of(without(result, 1, promised_um=3.5), "more linearisation points") is NO
    assert of(without(result, 3, median_ms=1.0), "longer time") is YES


def test_a_quick_run_says_nothing_of_what_it_leaves_out():
    result = made_up()
    quick = replace(result, loops=(result.loops[0], result.loops[3]))
    judged = verdicts(quick)
    assert not any("linearisation" in one or "friction" in one for one in judged)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['R']}-{case['eps']}")
def test_side_numbers_are_the_reference(case):
    inner, outer, vertex, _ = paper.ring_polygons(case["R"], case["eps"])
    assert (inner, outer) == (case["n_in"], case["n_out"])
    assert vertex == pytest.approx(case["l_vert"], rel=1e-12)


def test_polygons_of_algorithm_2():
    inner, outer, _, side = paper.ring_polygons(0.08, 4e-3)
    assert (inner, outer) == (10, 11)
    assert side > 0.08 > 0.084 * np.cos(np.pi / 10)


def test_every_run_has_its_panel():
    titles = [axes.get_title() for axes in errors(made_up()).axes]
    assert titles[0] == "CEBC-1, four places; gantry, worst" and len(titles) == 6
    assert titles[5].endswith("gantry late, worst")


def test_parts_hold_every_state_and_motor_once():
    for design in (paper.EXACT, paper.TRACKED, paper.LATE_TRACKED):
        states = sorted(state for part in design.parts for state in part.states)
        motors = sorted(motor for part in design.parts for motor in part.inputs)
        assert states == list(range(6 + 3 * design.late)) and motors == [0, 1, 2]


def test_random_forces_stay_in_their_box():
    force = random_forces(1000)
    assert force.shape == (1000, 3) and np.abs(force).max() == 0.5
    assert (force[:125] == 0.5).all() and (force[125:250] == -0.5).all()


@pytest.mark.slow
def test_models_switch_half_way_between_the_places_of_linearisation():
    machine = driven(0)
    model, which = machine.switched(tangent, POINTS)
    heads = machine.run.state[: len(which), 0]
    assert np.abs(heads - np.asarray(POINTS)[which]).max() <= 0.025 + 1e-9
    assert len(np.unique(which)) == 4
    exact = machine.exact
    near = np.abs(np.abs(heads) - 0.075) < 1e-4
    assert np.abs(exact.A[near] - model.A[near]).max() < 1e-4 * np.abs(exact.A).max()


@pytest.mark.slow
@pytest.mark.parametrize("design", [paper.EXACT, paper.LATE_TRACKED])
def test_the_tube_covers_the_error_of_its_models_on_the_machine_itself(design):
    """One sample of the gantry from corners of the tube, motors at their worst."""
    closed, rng = tube(design), np.random.default_rng(1)
    run, model, wide = closed.machine.run, closed.model, 6 + 3 * design.late
    k = rng.integers(0, len(run.A), 400)
    e = closed.state * rng.choice([-1.0, 1.0], size=(400, wide))
    du = closed.current * rng.choice([-1.0, 1.0], size=(400, 3))
    share = rng.choice([-1.0, 1.0], size=(400, 3))
    acting = e[:, 6:9] if design.late else du
    step = jax.vmap(Gantry(thesis_gantry(), SAMPLE).step)
    moved = jnp.asarray(run.control[k] + acting + 0.5 * share)
    after = np.asarray(step(jnp.asarray(run.state[k] + e[:, :6]), moved)) - run.state[k + 1]
    for part in design.parts:  # each predicts from its own states and motors
        own, motors = np.ix_(part.states, part.states), np.ix_(part.states, part.inputs)
        states, inputs = list(part.states), list(part.inputs)
        predicted = np.einsum("kij,kj->ki", model.A[k][:, *own], e[:, states])
        predicted += np.einsum("kij,kj->ki", model.B[k][:, *motors], du[:, inputs])
        predicted += np.einsum("kij,kj->ki", model.E[k][:, *motors], share[:, inputs])
        moving = [place for place, state in enumerate(states) if state < 6]
        kept = [states[place] for place in moving]
        assert (np.abs(after[:, kept] - predicted[:, moving]) <= closed.remainder[kept]).all()
    assert closed.closed <= 1


@pytest.mark.slow
def test_the_runs_stay_inside_and_the_attack_reaches_nine_tenths():
    result = paper.run(quick=True)
    for one in result.loops:
        assert one.kept and one.samples == paper.QUICK_STEPS
        assert one.motor_share <= 1 + 1e-9 and one.remainder_share <= 1
    exact, late = (
        result.loop(paper.CEBC2, paper.EVERY),
        result.loop(paper.CEBC2, paper.EVERY, late=True),
    )
    for one in (exact, late):
        assert one.promised_um <= 200.0 and one.reached_um >= 0.9 * one.promised_um


@pytest.mark.slow
def test_friction_is_inside_its_box():
    row = paper.loop_row(paper.RUBBED, paper.GUIDES, paper.FRICTION, 700)
    assert row.kept and row.motor_share <= 1 and row.remainder_share <= 1


@pytest.mark.slow
def test_a_controller_states_what_it_keeps():
    whole, promise = controller(tube(paper.TRACKED))
    assert promise.axes is not None
    assert promise.contour == pytest.approx(sum(promise.axes), rel=1e-12)
    assert len(whole.controllers) == 2
