"""Which loop is recommended: closed cases with errors and violations that are given."""

import dataclasses

import numpy as np
import pytest

from jcontour.app.designs.design import Design
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.runs.tuning import simple_loops
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.app.runs.tuning.searching import Searched
from jcontour.app.runs.tuning.simple_loops import (
    SimpleLoop,
    best_simple,
    candidates,
    drive_loop,
    simple_words,
    worth_trying,
)
from tests.app import small_runs
from tests.app.small_runs import partly
from tuning.problem import Problem


@dataclasses.dataclass
class Namespaced:
    """A run or a design, as far as the search for its first gain reads it."""

    design: object = None
    start: dict | None = None

    def replaced(self, **attributes):
        return dataclasses.replace(self, **attributes)


def loop(name, error, violation=-0.1):
    run = partly(TuningRun, design=partly(Design, name=name, start={"position": 20.0}))
    return SimpleLoop(run, error, violation)


def search(error, feasible=True, violation=-0.1):
    """End of a search."""
    problem = partly(Problem, objective=lambda outcome: np.array([[error]]))
    tuned = small_runs.tuned(feasible=feasible, violation=violation)
    return Searched(partly(TuningRun, problem=problem), tuned, 1)


def test_the_simplest_that_is_as_good_as_any_within_a_tenth():
    loops = [loop("p", 23e-6), loop("notch", 20.9e-6), loop("pi", 20e-6), loop("far", 1e-6, 0.1)]
    assert best_simple(loops) is loops[1]
    beyond = [loop("p", 1e-6, 0.5), loop("pi", 2e-6, 0.2), loop("lost", np.inf, np.inf)]
    assert best_simple(beyond) is beyond[1]
    assert best_simple(beyond[2:]) is None and best_simple([]) is None
    words = simple_words([*loops[:1], *beyond[1:]])
    assert words == "p 23 um; pi 2 um, 22 % beyond a limit; lost unstable"


@pytest.mark.parametrize(("allowed", "begins"), [(40.0, 32.0), (9.0, 8.0), (0.5, 32.0)])
def test_the_fastest_gain_within_the_limits_begins(monkeypatch, allowed, begins):
    """At 0.5 none of the halved gains keeps the limit: the loop is that of the first one."""

    def evaluated(run):
        return SimpleLoop(run, 1e-6, float(np.log(run.design.start["position"] / allowed)))

    monkeypatch.setattr(simple_loops, "_evaluated", evaluated)
    design = Namespaced(start={"position": 32.0, "viscous": 1.0})
    loop = simple_loops._at_start(Namespaced(design=design))  # pyright: ignore[reportArgumentType]
    assert loop.run.design.start == {"position": begins, "viscous": 1.0}


def test_a_notch_is_tried_where_it_raises_the_gain_and_else_the_loop_without():
    def designs(plain, notched):
        pair = {"position-loop": plain, "position-loop-notch": notched}
        return {
            name: partly(Design, start={"position": np.array([gain])})
            for name, gain in pair.items()
        }

    for gains, kept in (((8.0, 32.0), "position-loop-notch"), ((20.0, 25.0), "position-loop")):
        given = designs(*gains)
        assert worth_trying(given) == [given[kept]]


@pytest.mark.parametrize(
    ("controller", "tuned", "recommended"),
    [
        (search(10e-6), search(10.9e-6), True),  # as good within a tenth
        (search(10e-6), search(11.1e-6), False),
        (search(1e-6, feasible=False, violation=0.2), search(50e-6), True),
        (search(1e-6, False, 0.2), search(50e-6, False, 0.3), False),
        (search(1e-6, False, 0.4), search(50e-6, False, 0.3), True),
        (None, search(50e-6), True),
        (search(10e-6), None, False),
    ],
)
def test_the_simple_loop_is_recommended_where_it_is_as_good(controller, tuned, recommended):
    asked = []

    def tune(run):
        asked.append(run)
        return tuned

    first, *others = candidates(loop("p", 14e-6), controller, tune)
    assert first is (tuned if recommended else controller) and len(asked) == 1
    both = recommended and controller is not None and controller.tuned.feasible
    assert others == ([controller] if both else [])


def test_a_simple_loop_that_is_far_off_is_not_tuned():
    controller = search(10e-6)
    found = candidates(loop("p", 16e-6), controller, lambda run: pytest.fail())
    assert len(found) == 1 and found[0] is controller


@pytest.mark.parametrize(("start", "name"), [({"alpha": 1.0}, "p"), ({"position": 5.0}, "own")])
def test_the_gains_of_a_drive_are_its_own_loop_s_or_those_of_the_best_simple_one(start, name):
    """A controller that a drive has is named itself, with its tuned gains."""
    searched = search(10e-6)
    run = partly(
        TuningRun,
        problem=searched.run.problem,
        design=partly(Design, name="own", start=start),
        machine=partly(LinearMachine, control_unit="V"),
    )
    end = Searched(run, searched.tuned._replace(weights=start), 1)
    simple = loop("p", 14e-6)
    drive = drive_loop(end, [simple])
    assert drive is not None and drive.controller == name
    assert drive.tuned_error == pytest.approx(10e-6)
    gain, error = {"p": (20.0, 14e-6), "own": (5.0, 10e-6)}[name]
    assert drive.weights == {"position": gain}
    assert drive.error == pytest.approx(error)
    assert (drive_loop(end, []) is None) is (name == "p")
