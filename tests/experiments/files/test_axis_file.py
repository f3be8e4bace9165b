import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import experiments.machines
from experiments.files.axis_file import AxisFile, Electrical, axis_fields, axis_from, save_axis
from experiments.files.checks import MachineError
from jcontour.arrays import placed
from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis

EXAMPLE = Path(experiments.machines.__file__).parent / "thesis-axis.json"
FIELDS = json.loads(EXAMPLE.read_text())
TWO = FIELDS | {
    "axes": ["X", "Y"],
    "motor_mass": [39.62, 20.0],
    "cogging_sine": [[4.0, 1.0], [0.0, 2.0]],
    "cogging_cosine": [[1.0, 0.0], [0.0, 0.5]],
}


def same(one: AxisFile, other: AxisFile):
    for a, b in zip(
        jax.tree.leaves(one.parameters), jax.tree.leaves(other.parameters), strict=True
    ):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(one.electrical or (), other.electrical or (), strict=True):
        np.testing.assert_array_equal(a, b)
    assert (one.name, one.dt, one.axes, one.encoder_resolution, one.notes) == (
        other.name,
        other.dt,
        other.axes,
        other.encoder_resolution,
        other.notes,
    )


def test_the_example_is_the_axis_of_the_thesis():
    axis = axis_from(json.loads(EXAMPLE.read_text()))
    for found, printed in zip(
        jax.tree.leaves(axis.parameters), jax.tree.leaves(thesis_axis()), strict=True
    ):
        np.testing.assert_array_equal(found, printed)
    assert (
        axis.dt == 1e-3
        and axis.axes == ("X",)
        and axis.electrical is not None
        and axis.electrical.back_emf == 52.89
    )
    FlexibleAxis(axis.parameters, axis.dt)


@pytest.mark.parametrize("fields", [FIELDS, TWO])
def test_round_trip(fields, tmp_path):
    axis = replace(
        axis_from(fields),
        notes=("only below 0.5 m/s",),
        current_limit=np.full(1 if fields is FIELDS else 2, 6.0),
    )
    again = axis_from(json.loads(save_axis(axis, tmp_path / "axis.json").read_text()))
    same(axis, again)
    np.testing.assert_array_equal(axis.current_limit, again.current_limit)
    assert axis_fields(again) == axis_fields(axis)


def test_several_axes_take_one_number_or_each_its_own():
    axis = axis_from(TWO)
    assert axis.parameters.axes == 2 and axis.axes == ("X", "Y")
    np.testing.assert_array_equal(axis.parameters.motor_mass, [39.62, 20.0])
    np.testing.assert_array_equal(axis.parameters.stiffness, [2908.0, 2908.0])
    np.testing.assert_array_equal(np.asarray(axis.parameters.cogging_sine)[1], [0.0, 2.0])
    assert isinstance(axis.electrical, Electrical) and axis.electrical.resistance.shape == (2,)


def test_no_cogging():
    axis = axis_from(FIELDS | {"cogging_sine": [], "cogging_cosine": []})
    np.testing.assert_array_equal(axis.parameters.cogging(placed(np.array([0.01]))), [0.0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "gantry"}, "kind: needs 'flexible-axis'"),
        ({"motor_mass": -1.0}, "motor_mass: needs a finite number above 0"),
        (
            {"motor_mass": [1.0, 2.0], "axes": ["X"]},
            "motor_mass: needs one number or 1, received 2",
        ),
        ({"tool_mass": 0.0}, "tool_mass: needs a finite number above 0"),
        ({"damping": "soft"}, "damping: needs a number"),
        ({"stiffness": float("nan")}, "stiffness: needs a finite number"),
        ({"friction": 3.0}, "friction: needs an object"),
        ({"friction": {"coulomb": 1.0}}, "friction.stribeck: missing"),
        (
            {"friction": {**FIELDS["friction"], "viscous": -1.0}},
            "friction.viscous: needs a finite number of at least 0",
        ),
        ({"cogging_sine": [1.0]}, "cogging_cosine: needs as many harmonics as cogging_sine, 1"),
        ({"cogging_sine": 4.0}, "cogging_sine: needs lists"),
        (
            {"cogging_sine": [[1.0], [1.0, 2.0]], "axes": ["X", "Y"]},
            "cogging_sine: needs lists of equal length",
        ),
        ({"axes": ["X", "Y", "Z", "W"]}, "axes: needs one to 3"),
        ({"dt": 0}, "dt: needs a finite number above 0"),
        ({"encoder_resolution": 0}, "encoder_resolution: needs a finite number above 0"),
        ({"encoder_resolution": [1e-6] * 2}, "encoder_resolution: needs one number or 1"),
        ({"electrical": {"resistance": 1.0}}, "electrical.inductance: missing"),
        ({"notes": "careful"}, "notes: needs a list"),
        ({"mass": 40.0}, "there is no field 'mass'"),
    ],
)
def test_one_clear_line(change, says):
    with pytest.raises(MachineError) as error:
        axis_from(FIELDS | change)
    assert says in str(error.value) and "\n" not in str(error.value)


def test_every_axis_may_have_an_encoder_of_its_own():
    pair = axis_from(TWO | {"encoder_resolution": [1e-6, 5e-6]})
    np.testing.assert_array_equal(pair.encoder_resolution, [1e-6, 5e-6])
    again = json.loads(json.dumps(axis_fields(pair)))
    assert again["encoder_resolution"] == [1e-6, 5e-6]
    assert axis_from(TWO | {"encoder_resolution": [2e-6, 2e-6]}).encoder_resolution == 2e-6


@pytest.mark.parametrize("missing", ["dt", "motor_mass", "friction", "cogging_cosine"])
def test_what_is_missing_is_named(missing):
    with pytest.raises(MachineError, match=f"^{missing}: missing"):
        axis_from({key: value for key, value in FIELDS.items() if key != missing})


def test_a_list_is_no_axis():
    with pytest.raises(MachineError, match="file: needs an object"):
        axis_from([1, 2])


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=50)
@given(st.sampled_from(sorted(FIELDS)), ANYTHING)
def test_any_value_is_read_or_refused_in_one_line(field, value):
    try:
        axis_from(FIELDS | {field: value})
    except MachineError as error:
        assert "\n" not in str(error)
