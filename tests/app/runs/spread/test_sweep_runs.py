"""What a sweep makes of its flags."""

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.flags.tuning import Sweep, Tune
from jcontour.app.runs.spread.devices import batching_of, count_of
from jcontour.app.runs.spread.sweep_runs import (
    Swept,
    sampled_designs,
    sampled_values,
    swept_of,
)
from jcontour.simulation.devices import Spread


def test_a_grid_has_all_pairs_and_a_random_sample_lies_between():
    varied = {"a": (0.0, 1.0, 100.0), "b": (2.0, 3.0)}
    grid = sampled_designs(varied, 0, 0)
    assert len(set(zip(np.asarray(grid["a"]), np.asarray(grid["b"]), strict=True))) == 6
    sample = sampled_designs({"a": (1.0, 10.0, 100.0), "b": (2.0, 3.0)}, 50, 0)
    drawn = np.asarray(sample["a"])
    assert drawn.size == 50 and 1 <= drawn.min() < 2 and 50 < drawn.max() <= 100
    with pytest.raises(ValueError, match="samples: needs at least 0"):
        sampled_designs(varied, -1, 0)


@pytest.mark.parametrize("low", [0.0, -2.0])
def test_a_random_sample_has_no_end_that_is_not_above_zero(low):
    """It would be that of the values above zero, or of a single one."""
    message = f"received {low:g} for kv: give a lower end above zero"
    with pytest.raises(ValueError, match=message):
        sampled_designs({"kp": (1.0, 2.0), "kv": (low, 5.0)}, 20, 0)
    assert sampled_designs({"kv": (low, 5.0)}, 0, 0)["kv"].tolist() == [low, 5.0]


@pytest.mark.parametrize(
    ("word", "value"),
    [("max_sensitivity", 0.9), ("max_count_noise", 0.0), ("max_peak_control", -1.0)],
)
def test_what_is_no_limit_is_refused(word, value):
    with pytest.raises(ValueError, match=word.replace("_", "-")):
        swept_of(Sweep(parts=("circle",), **{word: value}))


def test_previews_have_one_flag():
    with pytest.raises(ValueError, match="preview: a sweep has --previews"):
        swept_of(Sweep(parts=("circle",), preview=5))


def test_the_design_of_a_preview_is_found_once():
    flags = Sweep(parts=("circle",), plant="gantry", controller="cascade", previews=(1,))
    asked = Swept(flags, machine_named("gantry"), [], {})
    assert asked.design(1) is asked.design(1)


@pytest.mark.parametrize(
    ("plant", "controller", "previews"),
    [
        ("flexible-axis", "cascade", (1,)),
        ("gantry", "cascade", (1,)),
        ("gantry", "contouring-lq", (5, 10, 20)),
    ],
)
def test_previews_that_differ_are_swept(plant, controller, previews):
    flags = Sweep(plant=plant, controller=controller, previews=(5, 10, 20, 10))
    assert swept_of(flags).flags.previews == previews


@pytest.mark.parametrize(
    ("plant", "controller", "start", "ends", "count"),
    [
        ("gantry", "contouring-lq", {"alpha": 1e8, "beta": 1e9}, (1e-2, 1e4), 49),
        (
            "gantry",
            "cascade",
            {"position": 30.0, "integral_time": 0.05},
            (0.1, 10.0),
            25,
        ),  # the velocity gain of X is not that of Y
    ],
)
def test_what_varies_lies_around_the_start(plant, controller, start, ends, count):
    """Weights of a cost over six decades, gains over two."""
    flags = Sweep(plant=plant, controller=controller)
    values = sampled_values(flags, design_for(machine_named(plant), flags))
    assert list(values) == list(start)
    for name, column in values.items():
        assert column.size == count and start[name] in column
        factors = float(column.min()) / start[name], float(column.max()) / start[name]
        assert factors == pytest.approx(ends)


def test_what_varies_can_be_named():
    flags = Sweep(vary=("alpha=1,2", "beta=0,5,20"))
    values = sampled_values(flags, design_for(machine_named("bridgeport"), flags))
    assert sorted(zip(*map(np.ndarray.tolist, map(np.asarray, values.values())), strict=True)) == [
        (1, 0),
        (1, 5),
        (1, 20),
        (2, 0),
        (2, 5),
        (2, 20),
    ]


def test_devices_of_the_flags():
    assert count_of(Sweep()) is None and count_of(Tune()) == 1 and count_of(Tune(devices="4")) == 4
    for devices in ("0", "-1", "two", "1.5", ""):
        with pytest.raises(ValueError, match="devices: needs 'all' or a number"):
            count_of(Tune(devices=devices))
    assert batching_of(Tune()) is None
    assert isinstance(batching_of(Tune(devices="all")), Spread)
    with pytest.raises(ValueError, match="devices: needs 1 to 2"):
        batching_of(Tune(devices="3"))
