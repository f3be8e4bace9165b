"""The first loop of a machine keeps its margin, and no faster one of the series does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.designs import first_loop as module
from jcontour.app.designs.design import Drift
from jcontour.app.designs.first_loop import BANDWIDTHS, SENSITIVITY
from jcontour.app.files.run_folder import json_text
from jcontour.app.flags import machines as flags
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import from_file
from jcontour.app.jobs.pace import Pace
from jcontour.app.jobs.replays import Scenarios, replay
from jcontour.app.machines.built import built_machine
from jcontour.app.machines.from_file import linear_machine, machine_from
from jcontour.linear.plant import LinearPlant

EXAMPLE = str(Path(__file__).parents[3] / "jcontour/app/machines/example.json")


def frequency_response(A, B, C, w):
    return C @ np.linalg.solve(np.exp(1j * w) * np.eye(len(A)) - A, B)


def peak(design, weights):
    """Peak sensitivity at the plant input, from transfer functions: plant times controller.

    With x^ = [x, d] and u = -(F, I) x^f the observer-based controller from -y to u is written out
    here; the loop is closed by (I + K P)^-1.
    """
    machine, model = design.machine, design.model
    A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
    n, p = B.shape
    controller = design.build(weights)
    reference = module.straight_windows(machine, design.preview)
    F = np.asarray(
        controller.controller.prepare(module.jax.tree.map(lambda leaf: leaf[0], reference)).F
    )[0]
    L = np.asarray(controller.gain)
    A_hat = np.block([[A, B], [np.zeros((p, n)), np.eye(p)]])
    C_hat = np.hstack([C, np.zeros((p, p))])
    B_hat = np.vstack([B, np.zeros((p, p))])
    K = np.hstack([F, np.eye(p)])
    # x^f = x^ + L (y - C x^); u = -K x^f; x^(next) = A x^f + B u
    kept = np.eye(n + p) - L @ C_hat
    moved = A_hat - B_hat @ K
    largest = 0.0
    for delay in range(machine.unknown_delay + 1):
        for gains in ([1.0] * p, [1 + machine.uncertainty.gain, 1 - machine.uncertainty.gain]):
            for w in np.geomspace(1e-3, np.pi, 600):
                z = np.exp(1j * w)
                inside = np.linalg.solve(z * np.eye(n + p) - moved @ kept, moved @ L)
                law = -K @ (kept @ inside + L)  # from y to u
                G = frequency_response(*(np.asarray(m) for m in _plant(machine)), w)
                loop = law @ (G * np.array(gains)) * z**-delay
                S = np.linalg.inv(np.eye(p) - loop)
                largest = max(largest, np.linalg.svd(S, compute_uv=False)[0])
    return largest


def _plant(machine):
    return machine.model.A, machine.model.B, machine.model.C


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["bridgeport", pytest.param(EXAMPLE, marks=pytest.mark.slow)])
def test_it_keeps_the_margin_and_the_next_faster_one_does_not(plant):
    machine = machine_named(plant)
    design = design_for(machine, Simulate(plant=plant)).tunable()
    assert peak(design, design.start) <= SENSITIVITY * (1 + 1e-2)
    series = [module._weights(machine, w, design.start) for w in BANDWIDTHS]
    index = next(
        k for k, one in enumerate(series) if np.isclose(one["drift"], design.start["drift"])
    )
    assert index > 0
    assert peak(design, series[index - 1]) > SENSITIVITY * (1 - 1e-2)


def test_the_gain_of_an_integrator():
    """y(k+1) = y(k) + b u(k): |G(w)| = b / (2 sin(w / 2))."""
    machine = linear_machine(
        LinearPlant(np.eye(2), np.diag([2e-3, 3e-3]), np.eye(2), 1e-3), "integrators"
    )
    for w in (1e-3, 0.3, np.pi):
        assert module._gain(machine, w) == pytest.approx(2e-3 / (2 * np.sin(w / 2)), rel=1e-9)


def integrators(limit, resolution=1e-6):
    machine = linear_machine(
        LinearPlant(np.eye(2), np.diag([2e-3, 3e-3]), np.eye(2), 1e-3), "integrators"
    )
    limits = machine.limits._replace(control=np.full(2, limit))
    return replace(machine, limits=limits, encoder_resolution=resolution)


def test_a_few_counts_do_not_take_the_controls_to_their_limit():
    """e / |G(r)| <= u: for the integrators 20 counts cost 20e-6 / 2e-3 * 2 sin(r / 2)."""
    assert module._regulator(linear_machine(integrators(1.0).model, "none stated")) == 1.0
    assert module._regulator(integrators(1.0)) == 1.0
    limit = 0.5 * 20e-6 / 2e-3
    found = module._regulator(integrators(limit))
    exact = 2 * np.arcsin(0.25)
    assert exact * module.REGULATORS[1] < found <= exact
    assert module._regulator(integrators(1e-9)) == module.REGULATORS[-1]


def test_the_control_that_counts_cost_is_that_of_the_worst_axis():
    """e_i / |G_i(r)|: for integrators e_i / b_i * 2 sin(r / 2), gains 2e-3 and 3e-3."""
    machine, r = integrators(1.0), 0.3
    for errors in ((1e-6, 5e-6), (5e-6, 1e-6), (1e-6, 1.2e-6)):
        wanted = max(errors[0] / 2e-3, errors[1] / 3e-3) * 2 * np.sin(r / 2)
        assert module._reached(machine, np.array(errors), r) == pytest.approx(wanted, rel=1e-9)
    assert module._reached(machine, 1e-6, r) == pytest.approx(1e-6 / 2e-3 * 2 * np.sin(r / 2))


@pytest.mark.slow
def test_a_drive_that_takes_positions_comes_to_its_place(tmp_path):
    """100 mm away it stays a millionth behind; the encoder counts in micrometres."""
    drive = flags.Machine(
        takes="position", gain=(1.0,), time_constant_ms=(4.0, 3.0), delay_ms=(2.0,)
    )
    machine = machine_from(json_text(built_machine(drive).fields).encode())
    program = tmp_path / "far.ngc"
    program.write_text("G21 F3000 G1 X100 Y50\nG4 P.5\nX100.1\n")
    job = from_file(program, Pace(machine, None, None))
    design = design_for(machine, Simulate())
    scenarios = Scenarios.of([job], [False], machine, design.fed, design.preview)
    found = replay(design.build(design.start), scenarios)
    nominal = found.output[0, 0]
    standing = np.flatnonzero(job.arc == job.arc[len(job.arc) - 200])[-100:]
    assert len(standing) == 100
    np.testing.assert_allclose(nominal[standing], np.tile([0.1, 0.05], (100, 1)), atol=1.5e-6)


def test_a_drift_may_change_a_thousand_times():
    drift = Drift()
    start = drift.coordinate(2e-4)
    ends = [float(drift.weight(start + way * drift.reach)) for way in (-1, 1)]
    np.testing.assert_allclose(ends, [2e-7, 0.2])
