"""Trials of a loop, against closed forms and other computations."""

from dataclasses import replace
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.stability import Margins
from jcontour.app.catalogue.choices import design_for
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Job, Pace, at_constant_feed
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.app.machines.machine import Machine, MachineLimits
from jcontour.app.machines.own_plant import machine_of
from jcontour.app.machines.uncertainty import Uncertainty
from jcontour.app.runs.checks import trials
from jcontour.app.runs.checks.trials import (
    BETWEEN,
    SAMPLES,
    SETTLED,
    _held,
    lost_first,
    offset_lasts,
    path_margins,
    standstill,
)
from jcontour.app.runs.tuning.limits import family_peaks
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.plants import bridgeport
from jcontour.plants.actuation import Delayed, Saturated
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import member, stack_references
from jcontour.simulation.metrics import score
from tests.app.small_runs import partly
from tests.small_loops import OnPositions, Proportional

ROWS = 200
PATHS = [
    along(line([x, 0.0], [x + 1e-2, 0.0]), 1e-3 * np.arange(5), 1e-3, 0, at_rest=False)
    for x in (0.0, 0.5)
]
WIDE = Margins(0.9, np.array([[0.05, 20.0], [0.05, 3.0]]), np.array([[-1, -1], [-1, 2]]), 2, 0)
FEW = 6


class SlowIntegral(OnPositions):
    """u = K (r - y) + w, w grows by k_i (r - y): pole of about 1 - k_i / K beside a zero there."""

    gain: jax.Array
    integral: float

    def initial_memory(self, reference):
        return jnp.zeros(2)

    def step(self, memory, plan, measurement):
        error = plan - measurement
        return memory + self.integral * error, self.gain * error + memory


@pytest.fixture(scope="module")
def path():
    return along(circle(1e-3), 1e-5 * np.arange(ROWS + 1), 1e-3, 0, at_rest=False)


@pytest.fixture(scope="module")
def plant():
    return LinearPlant(np.eye(2), np.eye(2), np.eye(2), 1e-3)


@pytest.mark.parametrize("gain", [1e-2, 1e-3, 1e-7])
def test_a_gain_takes_the_tool_back_by_its_pole(plant, path, gain):
    """Of two axes the slower: y(k+1) = (1 - K) y(k), a third is left after -1 / ln(1 - K)."""
    samples = offset_lasts(plant, Proportional(jnp.array([0.5, gain])), path)
    assert samples == pytest.approx(-1 / np.log1p(-gain), rel=1e-6)


def test_a_slow_integral_is_no_drift(plant, path):
    """The poles are the roots of (z - 1)^2 + K (z - 1) + k_i: one lasts 50,000 samples."""
    gain, integral = 0.5, 1e-5
    slow = np.roots([1.0, gain - 2.0, 1.0 - gain + integral]).max()
    assert -1 / np.log(slow) > 4e4
    # what is left of the offset is the residue of that mode, (z - 1) / ((z - p) (z - q))
    share = (slow - 1) / (2 * slow - 2 + gain)
    wanted = -path.steps / np.log(abs(share) * slow**path.steps)
    samples = offset_lasts(plant, SlowIntegral(jnp.full(2, gain), integral), path)
    assert samples == pytest.approx(wanted, rel=1e-3) and samples < 20


def test_without_feedback_nothing_dies_out(plant, path):
    assert offset_lasts(plant, Proportional(jnp.array([0.5, 0.0])), path) == np.inf


@pytest.fixture(scope="module")
def counting_machine():
    return replace(bridgeport_machine(), uncertainty=Uncertainty(0.0, 0))  # one plant


def controller_of(counting_machine):
    design = design_for(counting_machine, Simulate(preview=3))
    return design.build(design.start | dict(drift=1e-2, control_noise=1e-2))


@pytest.mark.slow
def test_it_is_the_worst_of_single_runs(counting_machine):
    controller = controller_of(counting_machine)
    (plant,) = counting_machine.true_family()
    controls, increments = [], []
    for part in BETWEEN:
        place = np.full(2, part * counting_machine.encoder_resolution)
        path = line(place, place + 1.0)
        run = along(path, np.zeros(SAMPLES), counting_machine.model.dt, 3, at_rest=True)
        control = np.asarray(simulate(plant, controller, run).control)[SETTLED:SAMPLES]
        controls.append(np.sqrt(np.mean(np.sum(control**2, axis=1))))
        moved = np.diff(control, axis=0)
        increments.append(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    at_rest = standstill(controller, counting_machine, "outputs")
    assert at_rest.rms_control == pytest.approx(max(controls), rel=1e-9) and max(controls) > 1e-6
    # the metric counts one increment more or less at the ends of its window
    assert at_rest.rms_increment == pytest.approx(max(increments), rel=1e-2)


def test_nothing_is_said_where_nothing_is_counted(counting_machine):
    controller = controller_of(counting_machine)
    assert standstill(controller, counting_machine, "state") is None
    assert standstill(controller, machine_of(bridgeport(), "own"), "outputs") is None


def test_each_axis_is_held_between_counts_of_its_own(counting_machine):
    counts = np.array([1e-6, 5e-6])
    assert _held(counting_machine, 0.3 * counts, 3).position[0] == pytest.approx(0.3 * counts)
    assert _held(counting_machine, 0.3e-6, 3).position[0] == pytest.approx(np.full(2, 0.3e-6))


@pytest.mark.parametrize(
    ("gain", "samples", "wanted"),
    [
        (
            [[0.05, 20.0], [0.5, 20.0]],
            [[-1, -1], [3, -1]],
            ("right", 2, [0.503, 0.0]),
        ),  # halved is nearer than three times
        ([[0.05, 1.5], [0.5, 20.0]], [[-1, 4], [3, -1]], ("right", 1, [0.504, 0.0])),
        ([[0.05, 20.0], [0.05, 20.0]], [[-1, -1], [-1, -1]], ("left", 2, [0.002, 0.0])),
        ([[0.05, 20.0], [0.05, 2.0]], [[-1, -1], [-1, -1]], None),  # its loops are lost all at once
    ],
)
def test_the_smallest_gain_margin_is_named(gain, samples, wanted):
    place = lost_first(
        [WIDE, Margins(0.9, np.array(gain), np.array(samples), 2, 0)], PATHS, ["left", "right"]
    )
    if wanted is None:
        assert place is None
    else:
        assert (place.contour, place.input) == wanted[:2]
        np.testing.assert_allclose(place.position, wanted[2], rtol=0, atol=1e-12)


@pytest.mark.slow
def test_a_path_that_is_run_at_the_limit_all_along_has_no_margins(two_axes):
    """Along the first path nothing moves; along the second the control is always at its limit."""
    arcs = [np.zeros(30), 1e-3 * np.arange(1, 31), 1e-3 * np.arange(30)]
    references = [
        along(line([0.0, 0.0], [1.0, 0.0]), arc, two_axes.dt, 3, at_rest=True) for arc in arcs
    ]
    jobs = tuple(partly(Job, name=name) for name in ("still", "hasty", "other"))
    scenarios = Scenarios(
        jobs, (True, True, False), ("nominal",), stack_references(references), two_axes
    )  # type: ignore[arg-type]
    plant = Delayed(Saturated(two_axes, jnp.full(2, 1e-3)), jnp.asarray(0), 1, 2)
    machine, law = (
        partly(
            Machine,
            nominal=lambda fed: plant,
            smooth_family=lambda fed: [plant],
            response_uncertainty=None,
            measured=(),
        ),
        ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3),
    )
    tried = law, machine, scenarios, "state"
    peaks = family_peaks(*tried)  # type: ignore[arg-type]
    margins = path_margins(*tried, peaks)  # type: ignore[arg-type]
    assert margins.contours_without_margins == ("hasty",) and margins.probes_left_out == 0
    one = scenarios._replace(training=(True, False, False))
    calm = path_margins(law, machine, one, "state", peaks)  # type: ignore[arg-type]
    assert calm.contours_without_margins == () and calm.spectral_radius < 1


@pytest.fixture(scope="module")
def machine():
    return bridgeport_machine()


def scenarios(machine, design):
    pace = Pace(machine, 0.05, None)
    jobs = [
        at_constant_feed("arc", circle(0.5e-3), pace),
        at_constant_feed("line", line([0.0, 0.0], [2e-3, 1e-3]), pace),
        at_constant_feed("other", circle(1e-3), pace),
    ]
    return Scenarios.of(jobs, [True, True, False], machine, design.fed, design.preview)


@pytest.mark.slow
@pytest.mark.parametrize("drift", [1e-6, 3e-2])
def test_it_counts_what_single_runs_show(drift, machine, monkeypatch):
    """The second observer integrates so fast that late plants diverge under the model of none.

    No limit holds the control: a loop that rings within its limits does not diverge.
    """
    machine = replace(machine, limits=MachineLimits())
    monkeypatch.setattr(trials, "MEMBERS", FEW)
    monkeypatch.setattr(trials, "SIDE_BY_SIDE", 3)
    design = design_for(machine, Simulate(preview=10))
    controller = design.build(design.start | dict(drift=drift))
    seen = scenarios(machine, design)
    result = trials.robust_test(controller, machine, seen, design.fed, seed=3)
    family = machine.random_family(FEW, 3)
    errors, lost = np.zeros((2, FEW)), np.zeros((2, FEW), bool)
    for c, job in enumerate(seen.jobs_seen(True)):
        reference = job.reference(machine.model.dt, design.preview)
        for k in range(FEW):
            metrics = score(simulate(member(family, k), controller, reference), reference)
            errors[c, k], lost[c, k] = metrics.rms_contour_error, metrics.diverged
    assert result.members == FEW and result.diverged == lost.any(axis=0).sum()
    kept = np.where(lost, -1.0, errors)
    assert result.error == pytest.approx(kept.max(), rel=1e-6)
    contour, plant = np.unravel_index(np.argmax(kept), kept.shape)
    assert result.contour == ("arc", "line")[contour]
    assert result.plant == machine.drawn(FEW, 3)[plant].name
    assert (result.diverged > 0) is (drift > 1e-3)


def test_members_lie_within_the_stated_intervals(machine):
    family = machine.random_family(400, 1)
    gained = family.plant.plant  # behind counts and encoders
    gains, late = np.asarray(gained.gains), np.asarray(gained.plant.samples)
    assert gains.min() >= 0.9 and gains.max() <= 1.1 and np.ptp(gains) > 0.19
    assert late.min() >= 0 and late.max() <= 2 and np.ptp(late) > 1.9
    assert np.any(late % 1 > 0.1)


def test_the_corners_of_gains_and_delay_are_among_them(machine):
    family = machine.random_family(50, 1).plant.plant  # behind counts and encoders
    gains, late = np.asarray(family.gains), np.asarray(family.plant.samples)
    members = np.round(np.column_stack([gains, late]), 12).tolist()
    for corner in product((0.9, 1.1), (0.9, 1.1), (0.0, 2.0)):
        assert list(corner) in members


def test_a_machine_that_is_known_exactly_has_no_random_members(machine):
    known = replace(machine, uncertainty=Uncertainty(0.0, 0))
    assert known.random_family(10, 0) is None
