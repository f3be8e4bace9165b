"""The examples run, fit on a page, and print numbers that something else confirms."""

import runpy
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import score

FOLDER = Path(__file__).parents[3] / "experiments" / "examples"
SCRIPTS = sorted(path.stem for path in FOLDER.glob("*.py") if path.stem != "__init__")
LONGEST = 60  # lines of a page


@pytest.fixture
def run(capsys):
    """Name of a script -> (its variables, what it printed)."""

    def of(name):
        variables = runpy.run_path(str(FOLDER / f"{name}.py"))
        return variables, capsys.readouterr().out

    return of


@pytest.mark.parametrize("name", SCRIPTS)
def test_fits_on_a_page_and_is_listed(name):
    assert len((FOLDER / f"{name}.py").read_text().splitlines()) <= LONGEST
    assert f"[`{name}.py`]({name}.py)" in (FOLDER / "README.md").read_text()


def test_every_script_is_tested():
    text = Path(__file__).read_text()
    assert [name for name in SCRIPTS if f'run("{name}")' not in text] == []


def test_own_plant(run):
    """A velocity loop with an integral follows a ramp: the lag is feed over position gain."""
    result, printed = run("own_plant")
    assert result["lags"]["line"] == pytest.approx(0.1 / 40, rel=1e-3)
    assert 0 < result["errors"]["circle"] < 0.02 / 10
    assert "2.50 mm behind" in printed


@pytest.mark.slow
def test_own_controller(run):
    """The tuned weights lie in a valley: no weight moved by 3 % is better and within the limit."""
    result, printed = run("own_controller")
    assert result["tuned"].feasible and "to" in printed
    assert result["worst_after"] < 0.7 * result["worst_before"]
    metrics = eqx.filter_jit(result["problem"].metrics)
    for name in ("gain", "feedforward"):
        for factor in (0.97, 1.03):
            weights = dict(result["tuned"].weights)
            weights[name] = weights[name] * factor
            moved = metrics(weights)
            worse = moved.rms_contour_error.max() > result["worst_after"] * (1 - 1e-3)
            assert worse or moved.rms_increment.max() > 0.5


def test_gradient(run):
    """Each slope is that of central differences."""
    result, printed = run("gradient")
    step = 1e-4
    for k in range(3):
        moved = np.zeros(3)
        moved[k] = step
        ahead, behind = (result["contour_error"](jnp.asarray(sign * moved))[0] for sign in (1, -1))
        assert float(result["slope"][k]) == pytest.approx(float(ahead - behind) / (2 * step), 1e-5)
    assert f"{1e6 * float(result['error']):.3f} um" in printed


def test_family(run):
    """The nominal and the worst machine, each simulated by itself."""
    result, _ = run("family")
    reference = result["runs"][0]
    for k in (result["nominal"], result["worst"]):
        alone = score(simulate(result["members"][k], result["controller"], reference), reference)
        together = float(result["errors"][0, k])
        assert float(alone.rms_contour_error) == pytest.approx(together, rel=1e-9)
    assert result["errors"][0, result["worst"]] > result["errors"][0, result["nominal"]]


def test_weight_sweep(run):
    """The best design, built and simulated by itself."""
    result, printed = run("weight_sweep")
    best, reference = result["best"], result["reference"]
    weights = type(result["designs"])(result["alphas"][best // 3], result["betas"][best % 3], 2e-9)
    rollout = simulate(result["model"], result["build"](weights), reference)
    error = 1e6 * float(score(rollout, reference).rms_contour_error)
    assert error == pytest.approx(float(result["table"].min()), rel=1e-9)
    assert len(printed.splitlines()) == 6


@pytest.mark.slow
def test_constrained_replay(run):
    """The limit holds at every sample where the free run breaks it, and it costs accuracy."""
    result, _ = run("constrained_replay")
    changes = np.abs(np.diff(np.asarray(result["within"].control), axis=0))
    assert changes.max() <= 0.5 * result["largest"] * (1 + 1e-9)
    gap = result["gap"]
    report = gap.run.report
    assert 0 < report.acting_fraction < 1 and report.worst_residual < 1e-8
    assert gap.within.rms_contour_error > gap.without.rms_contour_error


@pytest.mark.slow
def test_observer_stack(run):
    """The estimated load is the one that acts; without it the error is several times as large."""
    result, _ = run("observer_stack")
    np.testing.assert_allclose(result["estimate"], [0.2, -0.1], atol=0.005)
    assert result["errors"]["Kalman filter"] > 2 * result["errors"]["with load"]


def test_gantry_ring(run):
    """The joints bear the torque of the head's acceleration, M_e (x y'' + d x''), and swing on it.

    A step of the acceleration on an undamped joint doubles the angle at most.
    """
    result, _ = run("gantry_ring")
    p, position = result["parameters"], np.asarray(result["reference"].position)
    along, across = (np.diff(position, 2, axis=0) / result["dt"] ** 2).T
    torque = float(p.head_mass) * (position[1:-1, 0] * across + float(p.tool_offset) * along)
    static = np.abs(torque).max() / (2 * float(p.joint_stiffness))
    assert static < result["twist"] < 2 * static
    assert 0 < result["error"] < 1e-3


def test_gcode_part(run):
    """Length and time of a slot by hand: the arcs are passed at sqrt(a r)."""
    result, _ = run("gcode_part")
    line, radius, feed, acceleration = 10e-3, 2e-3, 0.05, 1.0
    assert result["length"] == pytest.approx(2 * line + 2 * np.pi * radius, rel=1e-9)
    slow = np.sqrt(acceleration * radius)
    change = (feed - slow) / acceleration
    way = (feed**2 - slow**2) / (2 * acceleration)
    first = feed / acceleration + change + (line - feed**2 / (2 * acceleration) - way) / feed
    second = 2 * change + (line - 2 * way) / feed
    arcs = 2 * np.pi * radius / slow
    stop = slow / (2 * acceleration)  # the last millimetre takes that much longer
    assert result["duration"] == pytest.approx(first + second + arcs + stop, abs=4e-3)


@pytest.mark.slow
def test_notebook_demo(run, tmp_path, monkeypatch):
    """The tuned weights keep every limit, and follow the part better than the start or baseline."""
    monkeypatch.chdir(tmp_path)
    result, printed = run("notebook_demo")
    (part,) = [one for one in result["tuned"].result.contours if one.training]
    before, after = (part.metrics[name].worst for name in (part.compared, "tuned"))
    assert after.rms_contour_error < before.rms_contour_error and "um" in printed
    assert result["tuned"].result.verdict.heading in result["tuned"]._repr_html_()


@pytest.mark.slow
def test_notebook_my_machine(run, tmp_path, monkeypatch):
    """The family holds gains on both sides of the nominal machine, and none diverges."""
    monkeypatch.chdir(tmp_path)
    result, _ = run("notebook_my_machine")
    plants = result["part"].result.plants
    assert len(plants) >= 3 and not any(one.diverged for one in plants.values())


def test_notebook_my_controller(run):
    """The slope is that of central differences; the figure has the contour's axes."""
    result, _ = run("notebook_my_controller")
    error, weights = result["contour_error"], np.array([4000.0, 20.0])
    for k, step in enumerate((1.0, 1e-2)):
        moved = step * np.eye(2)[k]
        difference = (error(weights + moved) - error(weights - moved)) / (2 * step)
        assert float(result["slope"][k]) == pytest.approx(float(difference), rel=1e-4)
    assert result["figure"].axes[0].get_xlabel() == "X [mm]"
    assert "um" in score(result["rollout"], result["reference"])._repr_html_()
