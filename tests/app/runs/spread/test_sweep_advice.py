"""What a sweep says of its designs."""

import shlex

import jax.numpy as jnp
import numpy as np

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.catalogue.own_classes import trust
from jcontour.app.cli import _chosen
from jcontour.app.files.results.search_results import BestDesign, SweepResult
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.tuning import Sweep, Tune
from jcontour.app.runs.spread.sweep_advice import edge_lines, next_steps, repeated
from jcontour.app.runs.spread.sweep_runs import Swept

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


def test_what_is_tuned_next_is_the_controller_that_was_swept(tmp_path):
    (tmp_path / "mine.py").write_text(OWN)
    trust(OWN.encode())  # as a command that names it does
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
    [line] = next_steps(asked, SweepResult(points=2, diverged=0, within=2, best=[broken, best]))
    words = line[line.index("jcontour ") :]
    assert _chosen(shlex.split(words)[1:])[0] == Tune(
        parts=("circle",),
        controller=flags.controller,
        weights=("feedforward=2", "gain=15000"),
        max_sensitivity=1.5,
        max_peak_control=5.0,
    )


def test_the_best_point_is_run_again_with_what_did_not_vary(tmp_path):
    (tmp_path / "mine.py").write_text(OWN)
    trust(OWN.encode())  # as a command that names it does
    mine = f"{tmp_path / 'mine.py'}:Proportional"
    given = {"controller": mine, "weights": ("feedforward=2",), "previews": (0,)}
    flags = Sweep(parts=("circle", "square"), **given)
    asked = Swept(flags, machine_named(flags.plant), [], {"gain": jnp.array([0.1, 0.3])})
    best = _best(weights={"gain": 0.1 + 0.2})
    [line] = repeated(asked, SweepResult(points=2, diverged=0, within=2, best=[best]))
    weights = ("gain=0.30000000000000004", "feedforward=2.0")  # all digits
    flags_read = _chosen(shlex.split(line)[1:])[0]
    assert isinstance(flags_read, Simulate) and flags_read == Simulate(
        contour="circle", controller=mine, weights=weights
    )
    assert repeated(asked, SweepResult(points=2, diverged=2, within=0, best=[])) == []


def _best(**other):
    given = {"preview": 0, "weights": {"gain": 1.0}, "worst_um": 1.0, "nominal_um": 1.0}
    return BestDesign(**{**given, "sensitivity": 1.4, "delay_samples": 3, **other})


def test_a_best_point_on_the_edge_of_its_grid_is_told():
    grid = {"alpha": jnp.array([1.0, 2.0, 3.0]), "beta": jnp.array([4.0, 5.0, 4.0])}
    grid["rho"] = np.full(3, 7.0)  # one value has no edge
    worst = np.array([9.0, 5.0, 8.0])
    (line,) = edge_lines({"alpha": 2.0, "beta": 5.0, "rho": 7.0}, grid, worst)
    assert line.startswith("The best beta, 5, lies on the edge of the grid: try larger ones")
    assert edge_lines({"alpha": 2.0, "beta": 4.5, "rho": 7.0}, grid, worst) == []
    (line,) = edge_lines({"alpha": 1.0, "beta": 4.5, "rho": 7.0}, grid, np.array([5.0, 6.0, 9.0]))
    assert "alpha, 1, lies on the edge of the grid: try smaller ones" in line
