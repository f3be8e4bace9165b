"""Simple loops: which suit a machine, their first gains, and feedforward through a notch."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.designs.simple_loops import resonance, simple_names
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.uncertainty import unsure_resonances
from jcontour.linear.continuous_axes import (
    force_axis,
    position_axis,
    sampled_machine,
    speed_axis,
    with_resonance,
)
from jcontour.linear.transformations import with_input_gains

DT, HERTZ, DAMPING = 1e-3, 22.0, 0.04


def machine(axis, response=None):
    plant, delay = sampled_machine([axis, axis], DT)
    uncertainty = {"gain": 0.1, "delay": 1} | ({} if response is None else {"response": response})
    matrices = {name: np.asarray(getattr(plant, name)).tolist() for name in "ABC"}
    fields = {**matrices, "dt": DT, "known_delay": delay, "uncertainty": uncertainty}
    found = machine_from(json.dumps(fields).encode())
    assert isinstance(found, LinearMachine)
    return found


def soft(axis):
    return with_resonance(axis, 2 * np.pi * HERTZ, DAMPING)


@pytest.fixture(scope="module")
def router():
    doubt = unsure_resonances((HERTZ, HERTZ), DAMPING, 0.05, DT)
    return machine(soft(speed_axis(0.02, 0.03, 1.5e-3)), doubt)


def first(machine, name):
    return design_for(machine, Simulate(controller=name)).start


@pytest.fixture(scope="module")
def loops(router):
    """First gains of the router's position loop, without a notch and with one."""
    return [first(router, name) for name in ("position-loop", "position-loop-notch")]


def test_loops_suit_what_the_drive_takes(router):
    p, pi = "position-loop", "linear-cascade-feedforward"
    assert simple_names(machine(speed_axis(0.02, 0.03, 0.0))) == [p, pi]
    assert simple_names(machine(position_axis(1.0, 0.02, 0.0))) == [p]
    assert simple_names(machine(force_axis(50.0, 90.0, 0.0, 0.0))) == [pi]
    assert simple_names(router) == [p, f"{p}-notch", pi, "linear-cascade-notch"]
    backwards = with_input_gains(machine(position_axis(1.0, 0.02, 0.0)).model, [1.0, -1.0])
    assert simple_names(replace(router, model=backwards)) == []  # gains are not negative


def test_a_notch_stands_at_the_resonance_and_allows_three_times_the_gain(router, loops):
    """Against W T of the loop by its own response, in numbers that nothing of the product made."""
    assert resonance(router.model) == pytest.approx(2 * np.pi * HERTZ, rel=1e-6)
    plain, fast = loops
    assert fast["notch"] == pytest.approx(2 * np.pi * HERTZ, rel=1e-6)
    assert fast["position"][0] > 3 * plain["position"][0]
    s = 2j * np.pi * np.geomspace(0.5, 400.0, 4000)
    w = 2 * np.pi * HERTZ
    R = w**2 / (s**2 + 2 * DAMPING * w * s + w**2)
    W = np.interp(np.log(np.abs(s)), np.log(2 * np.pi * router_hertz(router)), relative(router))
    N = (s**2 + 2 * 0.2 * 0.2 * w * s + w**2) / (s**2 + 2 * 0.2 * w * s + w**2)
    for gains, filter in ((plain, 1.0), (fast, N)):
        for late in (1, 2):  # half of it is the hold
            hold = np.exp(-s * (1.5e-3 + (late - 0.5) * DT))
            L = 1.1 * gains["position"][0] / s / (0.03 * s + 1) * R * filter * hold
            assert 0.2 < np.max(W * np.abs(L / (1 + L))) < 0.55


def router_hertz(machine):
    return machine.response_uncertainty.frequency / (2 * np.pi * DT)


def relative(machine):
    return machine.response_uncertainty.relative[:, 0]


def test_feedforward_makes_up_for_the_lag_of_the_notch(loops):
    """(1 + T s) (1 + tau s) to the second order, tau = 2 zeta (1 - depth) / w."""
    plain, fast = loops
    tau = 2 * 0.2 * 0.8 / (2 * np.pi * HERTZ)
    np.testing.assert_allclose(fast["viscous"], plain["viscous"], rtol=1e-12)
    np.testing.assert_allclose(
        fast["inertia"], plain["inertia"] + tau * plain["viscous"], rtol=1e-12
    )


def test_a_drive_that_takes_a_position_is_given_the_level():
    start = first(machine(position_axis(2.0, 0.02, 1e-3)), "position-loop")
    np.testing.assert_allclose(start["level"], 0.5, rtol=1e-6)
    # 1 / P = (1 + (T + delay + half a sample) s) / 2, the half sample is that of the hold
    np.testing.assert_allclose(start["viscous"], 0.5 * (0.02 + 1e-3 + 0.5e-3), rtol=1e-2)
