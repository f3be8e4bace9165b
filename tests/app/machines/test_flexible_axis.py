"""Flexible axes as machines: their family, what they measure, and the motions they make."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jcontour.app.machines
from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.jobs.job import TOOLPATHS, Pace
from jcontour.app.machines.flexible_axis import biaxial_axes, biaxial_machine, thesis_machine
from jcontour.app.machines.from_file import load_machine
from jcontour.linear.plant import LinearPlant
from jcontour.motion.point_to_point import thesis_task_a, thesis_task_b
from jcontour.plants.flexible_axis.axis import thesis_axis

THESIS_AXIS = Path(jcontour.app.machines.__file__).parent / "thesis-axis.json"


@pytest.fixture(scope="module")
def machine():
    return thesis_machine()


def test_family_is_off_by_a_fifth_and_late(machine):
    assert machine.family_names[0] == "nominal" and machine.family_names[-1] == "1 sample late"
    smooth, true = machine.smooth_family(), machine.true_family()
    assert len(smooth) == len(true) == len(machine.family_names) == 6
    ratios = [
        (
            float(late.plant.parameters.stiffness[0]) / 2908.0,
            float(late.plant.parameters.motor_mass[0]) / 39.62,
            float(late.plant.parameters.tool_mass[0]) / 0.38,
            int(late.samples),
        )
        for late in (behind_encoders.plant.plant for behind_encoders in smooth)
    ]
    wanted = [
        (1, 1, 1, 0),
        (1.2, 1.2, 1.2, 0),
        (1.2, 0.8, 0.8, 0),
        (0.8, 1.2, 1.2, 0),
        (0.8, 0.8, 0.8, 0),
        (1, 1, 1, 1),
    ]
    np.testing.assert_allclose(ratios, wanted, rtol=1e-12)
    with pytest.raises(ValueError, match="measures its motors"):
        machine.true_family("state")


def test_motors_are_measured_and_tools_are_felt():
    pair = biaxial_machine()
    position = jnp.array([0.01, -0.02])
    for plant, off in (
        (pair.true_family()[0], 1e-12),
        (pair.smooth_family()[0], 0.5e-6),  # it has noise of half a count
        (pair.nominal(), 1e-12),
    ):
        start = plant.initial_state(position, jnp.array([1e-4, 0.0]))
        measured = np.concatenate(
            [np.ravel(leaf) for leaf in jax.tree.leaves(plant.measure(start))]
        )
        np.testing.assert_allclose(measured, [0.01, -0.02, 0.1, 0.0], atol=off)
        np.testing.assert_allclose(plant.output(start), position, atol=1e-12)
    assert isinstance(pair.nominal().plant, LinearPlant)
    with pytest.raises(ValueError, match="measures its motors"):
        pair.nominal("state")


def test_smooth_encoders_have_the_noise_of_counts():
    """Variance is that of rounding, a twelfth of a count squared; speeds are differences."""
    pair = replace(biaxial_machine(), encoder_resolution=4e-6)
    plant, rows, place = pair.smooth_family()[0], 400, jnp.array([0.01, -0.02])
    start = plant.initial_state(place, jnp.zeros(2))
    _, (read, true) = jax.lax.scan(
        lambda state, _: (
            plant.step(state, jnp.zeros(2)),
            (plant.measure(state), plant.plant.plant.measure(state[0][0])),
        ),
        start,
        length=rows,
    )
    noise = np.asarray(read[0] - true[0])
    assert np.abs(noise).max() <= 2e-6
    np.testing.assert_allclose(noise.var(axis=0), (4e-6) ** 2 / 12, rtol=0.2)
    differences = np.diff(np.asarray(read[0]), axis=0) / plant.dt
    np.testing.assert_allclose(read[1][1:], differences, rtol=0, atol=1e-12)


def test_biaxial_axes_differ():
    p, one = jax.device_get((biaxial_axes(), thesis_axis()))
    for ours, thesis in zip(jax.tree.leaves(p), jax.tree.leaves(one), strict=True):
        np.testing.assert_array_equal(ours[0], thesis[0])
    ringing = np.sqrt(p.stiffness * (1 / p.motor_mass + 1 / p.tool_mass)) / (2 * np.pi)
    np.testing.assert_allclose(ringing, [13.99, 15.29], atol=0.01)  # [Hz]


def test_a_file_is_the_built_in_machine(machine, tmp_path):
    machine_read = load_machine(THESIS_AXIS)
    assert machine_read.error == "tracking" and machine_read.axes == ("X",)
    np.testing.assert_array_equal(machine_read.model.A, machine.model.A)
    np.testing.assert_array_equal(
        machine_read.true_family()[2].plant.plant.parameters.stiffness, [1.2 * 2908.0]
    )
    fields = json.loads(THESIS_AXIS.read_text())
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({**fields, "current_limit": 3.0, "name": "mine"}))
    mine = machine_named(str(path))
    assert mine.name == "mine" and float(mine.limits.control[0]) == 3.0
    path.write_text(json.dumps({**fields, "motor_mass": -1.0}))
    with pytest.raises(ValueError, match="mine.json: motor_mass"):
        machine_named(str(path))


def test_machine_says_what_it_is(machine):
    facts = machine.description()
    assert "39.62 + 0.38 kg" in facts["Machine"] and "1 um" in facts["Measured"]
    assert machine.usual.controller == "cascade"


@pytest.mark.parametrize(("name", "task"), [("task-a", thesis_task_a), ("task-b", thesis_task_b)])
def test_motions_are_the_tasks_of_the_thesis(machine, name, task):
    wanted = task()
    motion = job_named(name, Pace(machine, None, None))
    reference = motion.reference(1e-3, 1)
    assert reference.steps == motion.samples == wanted.steps
    np.testing.assert_allclose(reference.position, wanted.position, rtol=0, atol=1e-15)


def test_another_pace(machine):
    motion = job_named("task-a", Pace(machine, 0.05, 2.0))
    speed = np.diff(np.asarray(motion.reference(1e-3, 0).arc)) / 1e-3
    assert speed.max() == pytest.approx(0.05) and np.diff(speed).max() / 1e-3 == pytest.approx(2.0)
    curve = np.asarray(job_named("s-curve", Pace(machine, None, None)).reference(1e-3, 0).arc)
    assert np.abs(np.diff(curve, 3)).max() / 1e-9 <= 100.0 * (1 + 1e-5) and curve[-1] == 0.05


@pytest.mark.parametrize(
    ("name", "make", "pace", "says"),
    [
        ("task-b", thesis_machine, (0.1, None), "leave them out"),
        ("task-a", biaxial_machine, (None, None), "single axis, flexible-axes has 2"),
        ("circle", thesis_machine, (None, None), "circle needs 2 axes, flexible-axis has 1"),
        (
            str(TOOLPATHS / "cam.ngc"),
            thesis_machine,
            (None, None),
            "needs a machine of two or three axes",
        ),
    ],
)
def test_runs_that_do_not_suit(name, make, pace, says):
    with pytest.raises(ValueError, match=says):
        job_named(name, Pace(make(), *pace))


def test_random_members_lie_within_the_intervals_with_parts_of_a_sample(machine):
    family = machine.random_family(200, 5)
    late, axis = family.plant, family.plant.plant  # behind encoders that count
    thesis = machine.parameters
    for name, share in (("stiffness", 0.2), ("motor_mass", 0.2)):
        ratio = np.asarray(getattr(axis.parameters, name)) / np.asarray(getattr(thesis, name))
        assert 1 - share <= ratio.min() < ratio.max() <= 1 + share and np.ptp(ratio) > 1.8 * share
    masses = [
        np.asarray(getattr(axis.parameters, name)) / np.asarray(getattr(thesis, name))
        for name in ("motor_mass", "tool_mass")
    ]
    np.testing.assert_allclose(*masses, rtol=1e-12)
    samples = np.asarray(late.samples)
    assert 0 <= samples.min() < samples.max() <= 1 and np.any((samples > 0.2) & (samples < 0.8))
    again = machine.random_family(200, 5)
    np.testing.assert_array_equal(again.plant.samples, samples)
    with pytest.raises(ValueError, match="measures its motors"):
        machine.random_family(2, 0, "state")


def test_motors_of_different_encoders_are_those_of_two_machines_of_equal_ones():
    position, still = jnp.array([0.0100123, -0.0200123]), jnp.zeros(2)
    counts = np.array([1e-6, 5e-6])

    def seen(resolution):
        pair = replace(biaxial_machine(), encoder_resolution=resolution)
        plants = [pair.true_family()[0], pair.smooth_family()[0]]
        starts = [plant.initial_state(position, still) for plant in plants]
        pairs = zip(plants, starts, strict=True)
        return np.array([np.asarray(plant.measure(start)[0]) for plant, start in pairs])

    mixed = seen(counts)
    for axis, count in enumerate(counts):
        np.testing.assert_array_equal(mixed[:, axis], seen(count)[:, axis])
    np.testing.assert_allclose(mixed[0], [0.010012, -0.02001])
    pair = replace(biaxial_machine(), encoder_resolution=counts)
    assert "encoders of 1, 5 um" in pair.description()["Measured"]
