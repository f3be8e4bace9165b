"""Inverse feedforward of flexible axes and gantries: transfer functions, motions, bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.polynomial import polypow
from scipy.signal import cont2discrete, lfilter

from jcontour.app.catalogue.choices import design_for
from jcontour.app.catalogue.entries import MACHINES
from jcontour.app.designs.first_loop import sensitivity_peaks, straight_windows
from jcontour.app.designs.inverse_feedforward import LINKS, of_axes, of_drives
from jcontour.app.designs.simple_loops import axes_of
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.flexible_axis import biaxial_machine, thesis_machine
from jcontour.app.machines.gantry import friction_gantry_machine, gantry_machine
from jcontour.motion.references import from_samples
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import stack_plants

NAMES = ("zpetc", "optimal-feedforward")
MAKES = (thesis_machine, biaxial_machine, gantry_machine)
DT = 1e-3


def steps(transfer):
    """Step response from its polynomials."""
    return lfilter(transfer.numerator, transfer.denominator, np.ones(200))


def sampled(top, below):
    """Step response of a transfer function in s under zero-order hold."""
    numerator, denominator, _ = cont2discrete((top, below), DT)
    return lfilter(numerator[0], denominator, np.ones(200))


@pytest.mark.slow
def test_axes_are_inverted_from_current_to_tool():
    """Against (3.1), (3.2) as one transfer function in s."""
    machine = biaxial_machine()
    p = machine.parameters
    for axis, found in enumerate(of_axes(machine, 0).transfers):
        M, m, k, c, force, b = (
            float(np.broadcast_to(one, 2)[axis])
            for one in (
                p.motor_mass,
                p.tool_mass,
                p.stiffness,
                p.damping,
                p.force_constant,
                p.friction.viscous,
            )
        )
        motor, tool = [M, c + b, k], [m, c, k]
        below = np.polysub(np.polymul(motor, tool), np.polymul([c, k], [c, k]))
        wanted = sampled([force * c, force * k], below)
        np.testing.assert_allclose(steps(found), wanted, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_drives_are_inverted_as_masses_with_viscous_friction():
    """(5.13), (5.14) with the head at the centre, both drives alike."""
    machine = gantry_machine()
    p = machine.parameters
    head, first, second = of_drives(machine).transfers
    x = [float(p.head_mass), float(p.head_viscous), 0.0]
    y = [float(p.total_mass), 2 * float(p.drive_viscous), 0.0]
    np.testing.assert_allclose(steps(head), sampled([float(p.head_constant)], x), rtol=1e-8)
    for drive in (first, second):
        np.testing.assert_allclose(
            steps(drive), sampled([2 * float(p.drive_constant)], y), rtol=1e-8
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", [NAMES[0], pytest.param(NAMES[1], marks=pytest.mark.slow)])
@pytest.mark.parametrize("make", MAKES)
def test_the_nominal_machine_follows_the_model(make, name):
    """Without dry friction y = M_0 B(lambda) B(1 / lambda) / B(1)^2 r, B of what is not cancelled.

    Of the zeros outside the unit circle the optimum leaves an error of 1e-7 of the reference.
    """
    machine = make()
    design = design_for(machine, Simulate(controller=name))
    start = dict(design.start)
    if "coulomb" in start:
        start["coulomb"] = 0 * np.asarray(start["coulomb"])
    controller = design.build(start)
    inverted = of_drives(machine) if make is gantry_machine else of_axes(machine, 0)
    there = 1e-3 * (1 - np.cos(np.pi * np.arange(201) / 200))
    path = np.concatenate([np.zeros(80), there, np.full(120 + design.preview, there[-1])])
    samples = np.stack([path, 0.5 * path], axis=1)[:, : len(machine.axes)]
    if make is gantry_machine:  # the model is that of the motors, not of the tool
        controller, samples = controller.controller, samples @ controller.kinematics.T
    axes = samples.shape[1]
    ahead = np.tile(np.eye(axes)[0], (len(samples), 1))
    reference = from_samples(samples, ahead, DT, design.preview, in_motion=False, tolerance=1.0)
    start_state = inverted.nominal.initial_state(*[np.zeros(len(inverted.transfers))] * 2)
    run = jax.jit(simulate)(inverted.nominal, controller, reference, start_state)
    model = polypow([start["smoothing"], 1 - 2 * start["smoothing"], start["smoothing"]], LINKS)
    for axis in range(axes):
        left = inverted.transfers[axis].zeros_z
        kept = left[(np.real(left) < -0.3) & ((np.abs(left) < 1) | (name == "zpetc"))]
        kernel = model
        for zero in np.real(kept):
            both = np.convolve([1, -zero], [-zero, 1]) / (1 - zero) ** 2
            kernel = np.convolve(kernel, both)
        wanted = np.convolve(samples[:, axis], kernel)[kernel.size // 2 :][: reference.steps]
        wanted[-40:] = samples[reference.steps - 40 : reference.steps, axis]  # the end is beyond
        allowed = 1e-12 if name == "zpetc" else 1e-9
        np.testing.assert_allclose(run.output[:, axis], wanted, atol=allowed)


@pytest.mark.slow
def test_alias_and_preview():
    machine = thesis_machine()
    found = design_for(machine, Simulate(controller="optimal-feedforward", preview=6))
    assert found.name == "flexible-optimal-feedforward"
    assert found.preview == LINKS + 6
    late = design_for(machine, Simulate(controller="zpetc", model_delay=1)).preview
    assert late == design_for(machine, Simulate(controller="zpetc")).preview + 1
    assert "coulomb" not in design_for(gantry_machine(), Simulate(controller="zpetc")).start
    assert "coulomb" in design_for(friction_gantry_machine(), Simulate(controller="zpetc")).start


@pytest.mark.slow
def test_bad_input():
    with pytest.raises(ValueError, match="may be 0 to 1 samples late beyond"):
        design_for(thesis_machine(), Simulate(controller="zpetc", model_delay=2))
    with pytest.raises(ValueError, match="gantry may be 0 to 0 samples late.*received 1"):
        design_for(gantry_machine(), Simulate(controller="zpetc", model_delay=1))
    with pytest.raises(ValueError, match="needs at least the plant's delay|look"):
        design_for(thesis_machine(), Simulate(controller="optimal-feedforward", preview=-1))


@pytest.fixture(scope="module", params=["bridgeport", "xy-table"])
def machine(request):
    return MACHINES[request.param]()


def design(machine, name, **flags):
    return design_for(machine, Simulate(controller=name, **flags))


@pytest.mark.slow
def test_the_first_cascade_keeps_the_margin(machine):
    found = design(machine, "cascade")
    family = stack_plants(machine.smooth_family())
    gains = {name: jnp.asarray(value)[None] for name, value in found.start.items()}
    peaks = sensitivity_peaks(found.build, gains, family, straight_windows(machine, 1))
    assert 1.2 < float(np.max(peaks)) <= 2.0


@pytest.mark.slow
def test_motion_feedforward_is_the_inverse_of_slow_motion(machine):
    """The control that holds a speed, by a long run under a constant control."""
    found = design(machine, "cascade-feedforward")
    state = machine.model.initial_state(jnp.zeros(2), jnp.zeros(2))
    outputs = []
    for _ in range(3000):
        state = machine.model.step(state, jnp.ones(2))
        outputs.append(np.asarray(machine.model.output(state)))
    speed = (outputs[-1] - outputs[-2]) / machine.model.dt
    np.testing.assert_allclose(found.start["viscous"], 1 / speed, rtol=1e-4)
    # y(t) = speed (t - lag): the lag is inertia over viscous friction
    lag = 3000 * machine.model.dt - outputs[-1] / speed
    np.testing.assert_allclose(found.start["inertia"] / found.start["viscous"], lag, rtol=2e-2)


@pytest.mark.slow
def test_alias_preview_and_delay():
    bridgeport = MACHINES["bridgeport"]()
    assert design(bridgeport, "cascade").name == "linear-cascade"
    assert design(bridgeport, "optimal-feedforward", preview=6).preview == 6
    late, early = (design(bridgeport, "zpetc", model_delay=d).preview for d in (2, 0))
    assert late == early + 2
    with pytest.raises(ValueError, match="may be 0 to 2 samples late"):
        design(bridgeport, "zpetc", model_delay=3)
    with pytest.raises(ValueError, match="needs at least the plant's delay of 2 samples"):
        design(bridgeport, "optimal-feedforward", preview=1)


@pytest.mark.slow
def test_free_numbers_of_feedforward_are_tuned_with_those_of_the_feedback():
    found = design(MACHINES["bridgeport"](), "optimal-feedforward")
    names = {"position", "velocity", "integral_time", "smoothing", "weight"}
    assert set(found.free()) == names
    found.check_start()
    assert found.freed(["smoothing"]).free() == ["smoothing"]


def test_coupled_axes_are_refused(coupled_plant):
    with pytest.raises(ValueError, match="needs axes with one control each"):
        axes_of(coupled_plant(0, 4, 2))
