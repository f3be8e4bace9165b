"""A ranking of controllers: which are tried, on the same footing, and what becomes of failures."""

from dataclasses import replace

import jax
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.catalogue.own_classes import trust
from jcontour.app.designs import first_loop
from jcontour.app.files.results.search_results import Ranked
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.tuning import Rank
from jcontour.app.reports.tables import console_of
from jcontour.app.runs.tuning import ranking
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.app.runs.tuning.ranking import ranked, ranking_of


@pytest.mark.slow
def test_every_controller_that_reads_the_sensors_is_tried_and_one_that_learns_if_named():
    asked = ranking_of(Rank())
    assert asked.learning == ["repetitive", "run-out", "adaptive-zpetc", "adaptive-robust"]
    assert list(asked.designs) == [
        "contouring-lq",
        "contouring-lq-riccati",
        "contouring-lq-zero",
        "cross-coupled-lq",
        "contouring-lq-kalman",
        "contouring-lq-predictor",
        "contouring-lq-blocks",
        "constrained-lq",
        "preview-lq",
        "linear-cascade",
        "linear-cascade-feedforward",
        "linear-cascade-notch",
        "position-loop",
        "position-loop-notch",
        "zpetc",
        "causal-inverse",
        "optimal-feedforward",
        "sliding-mode",
        "super-twisting",
        "integral-sliding-mode",
        "reference-governor",
        "command-governor",
        "artificial-reference-mpc",
        "dynamic-surface",
        "predictive-cascade",
        "predictive-repetitive",
        "h-infinity",
    ]
    named = ranking_of(Rank(controllers=("linear-cascade", "run-out")))
    assert list(named.designs) == ["linear-cascade", "run-out"]
    assert named.learning == []


@pytest.mark.slow
def test_the_first_loop_of_a_controller_is_searched_once(machine_file, part_file, monkeypatch):
    searched, search = [], first_loop.first_loop
    monkeypatch.setattr(first_loop, "first_loop", lambda *args: searched.append(1) or search(*args))
    flags = Rank(
        parts=(str(part_file),), plant=str(machine_file), preview=4, controllers=("contouring-lq",)
    )
    asked = ranking_of(flags)
    run = asked.run_of("contouring-lq")
    assert len(searched) == 1
    alone = tuning_run(run.flags)
    assert run.start == alone.start and run.limits == alone.limits
    assert len(searched) == 2


@pytest.mark.parametrize(
    ("plant", "name", "learns"),
    [
        ("gantry", "gantry-self-tuning", True),
        ("gantry", "gantry-synchronised", True),
        ("gantry", "gantry-cascade", False),
        ("flexible-axes", "synchronised", True),
    ],
)
def test_controllers_that_learn_are_known(plant, name, learns):
    assert design_for(machine_named(plant), Simulate(controller=name)).learns is learns


@pytest.mark.slow
def test_a_controller_that_cannot_be_tuned_has_a_reason(machine_file, part_file, tmp_path):
    script = tmp_path / "mine.py"
    script.write_text(
        "import equinox as eqx, jax.numpy as jnp\n"
        "from jcontour.controller import Controller\n"
        "class Nothing(Controller):\n"
        "    preview: int = eqx.field(static=True, default=0)\n"
        "    def prepare(self, reference): return reference.position[: reference.steps]\n"
        "    def initial_memory(self, reference): return None\n"
        "    def step(self, memory, plan, y): return memory, 0.0 * plan\n"
    )
    trust(script.read_bytes())  # as a command that names it does
    flags = Rank(
        parts=(str(part_file),),
        plant=str(machine_file),
        preview=4,
        controllers=(f"{script}:Nothing", "contouring-lq"),
        evaluations=1,
    )
    asked = ranking_of(flags)  # one that can be tuned is enough
    first = dict([next(iter(asked.designs.items()))])
    before = jax.jit(lambda x: -x)
    before(1.0)
    rows = ranked(replace(asked, designs=first), tmp_path, console_of(quiet=True))
    assert not before._cache_size()  # nor are programs kept from controller to controller
    (row,) = rows.rows
    assert row.label.endswith("Nothing")
    assert "no free weights" in row.failure and row.held_out is None


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (Rank(controller="contouring-lq"), "controller: a ranking takes several"),
        (Rank(weights=("alpha=1",)), "weights: every controller of a ranking begins at its own"),
        (Rank(evaluations=0), "evaluations: needs at least 1, received 0"),
        (Rank(controllers=("no-such",)), "controller: there is none named 'no-such'"),
        (Rank(parts=("no-such.ngc",)), "no-such"),
        (Rank(max_sensitivity=1.0), "max-sensitivity: no loop keeps 1 or less"),
    ],
)
def test_bad_flags_are_named(flags, says):
    with pytest.raises(ValueError, match=says):
        ranking_of(flags)


def test_rows_without_numbers_come_last():
    rows = [
        Ranked(label="failed", failure="why"),
        Ranked(label="beyond", held_out=1.0),
        Ranked(label="second", held_out=3.0, feasible=True),
        Ranked(label="first", held_out=2.0, feasible=True),
    ]
    order = [row.label for row in sorted(rows, key=ranking._place)]
    assert order == ["first", "second", "beyond", "failed"]
