"""Standstill on counting encoders, against one run after another."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.app.machines.own_plant import machine_of
from jcontour.app.runs.checks.weights.standstill import (
    BETWEEN,
    SAMPLES,
    SETTLED,
    _held,
    standstill,
)
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plants import bridgeport
from jcontour.simulation.closed_loop import simulate


@pytest.fixture(scope="module")
def machine():
    return replace(bridgeport_machine(), gain=0.0, delay=0)  # one plant


def controller_of(machine):
    design = design_for(machine, Simulate(preview=3))
    return design.build(design.start._replace(drift=1e-2, control_noise=1e-2))


@pytest.mark.slow
def test_it_is_the_worst_of_single_runs(machine):
    controller = controller_of(machine)
    (plant,) = machine.true_family()
    controls, increments = [], []
    for part in BETWEEN:
        place = np.full(2, part * machine.encoder_resolution)
        path = line(place, place + 1.0)
        run = along(path, np.zeros(SAMPLES), machine.model.dt, 3, at_rest=True)
        control = np.asarray(simulate(plant, controller, run).control)[SETTLED:SAMPLES]
        controls.append(np.sqrt(np.mean(np.sum(control**2, axis=1))))
        moved = np.diff(control, axis=0)
        increments.append(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    found = standstill(controller, machine, "outputs")
    assert found.rms_control == pytest.approx(max(controls), rel=1e-9) and max(controls) > 1e-6
    # the metric counts one increment more or less at the ends of its window
    assert found.rms_increment == pytest.approx(max(increments), rel=1e-2)


def test_nothing_is_said_where_nothing_is_counted(machine):
    controller = controller_of(machine)
    assert standstill(controller, machine, "state") is None
    assert standstill(controller, machine_of(bridgeport(), "own"), "outputs") is None


def test_each_axis_is_held_between_counts_of_its_own(machine):
    counts = np.array([1e-6, 5e-6])
    assert _held(machine, 0.3 * counts, 3).position[0] == pytest.approx(0.3 * counts)
    assert _held(machine, 0.3e-6, 3).position[0] == pytest.approx(np.full(2, 0.3e-6))
