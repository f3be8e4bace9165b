import json
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jcontour.app.machines
from jcontour._arrays import placed
from jcontour.app.files.checks import MachineError
from jcontour.app.files.machine_file import SCHEMA, FlexibleAxisFile, LinearMachineFile, documents
from jcontour.app.files.schema import read
from jcontour.app.machines.flexible_axis import flexible_machine
from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis


@pytest.mark.parametrize("path", documents(), ids=lambda path: path.name)
def test_the_documents_are_those_of_the_schemas(path):
    again = "run python -m jcontour.app.files.machine_file"
    assert path.read_text() == documents()[path], again


def test_an_editor_knows_every_field():
    known = json.loads(SCHEMA.read_text())["$defs"]["LinearMachineFile"]
    assert set(known["properties"]) == set(LinearMachineFile.model_fields)
    assert known["required"] == ["A", "B", "C", "dt"]


EXAMPLE = Path(jcontour.app.machines.__file__).parent / "thesis-axis.json"
FIELDS = json.loads(EXAMPLE.read_text())
TWO = FIELDS | {
    "axes": ["X", "Y"],
    "motor_mass": [39.62, 20.0],
    "cogging_sine": [[4.0, 1.0], [0.0, 2.0]],
    "cogging_cosine": [[1.0, 0.0], [0.0, 0.5]],
}


def test_the_example_is_the_axis_of_the_thesis():
    axis = read(FlexibleAxisFile, FIELDS)
    for computed, printed in zip(
        jax.tree.leaves(axis.parameters), jax.tree.leaves(thesis_axis()), strict=True
    ):
        np.testing.assert_array_equal(computed, printed)
    assert axis.dt == 1e-3 and axis.count == 1
    FlexibleAxis(axis.parameters, axis.dt)


def test_several_axes_take_one_number_or_each_its_own():
    axis = read(FlexibleAxisFile, TWO)
    assert axis.parameters.axes == axis.count == 2
    np.testing.assert_array_equal(axis.parameters.motor_mass, [39.62, 20.0])
    np.testing.assert_array_equal(axis.parameters.stiffness, [2908.0, 2908.0])
    np.testing.assert_array_equal(np.asarray(axis.parameters.cogging_sine)[1], [0.0, 2.0])


def test_no_cogging():
    axis = read(FlexibleAxisFile, FIELDS | {"cogging_sine": [], "cogging_cosine": []})
    np.testing.assert_array_equal(axis.parameters.cogging(placed(np.array([0.01]))), [0.0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "gantry"}, "kind: needs to be 'flexible-axis'"),
        ({"motor_mass": -1.0}, "motor_mass: needs to be greater than 0"),
        (
            {"motor_mass": [1.0, 2.0], "axes": ["X"]},
            "motor_mass: needs one number or 1, received 2",
        ),
        ({"tool_mass": 0.0}, "tool_mass: needs to be greater than 0"),
        ({"damping": "soft"}, "damping: needs to be a valid number"),
        ({"stiffness": float("nan")}, "stiffness: needs to be a finite number"),
        ({"friction": 3.0}, "friction: needs an object"),
        ({"friction": {"coulomb": 1.0}}, "friction.stribeck: missing"),
        (
            {"friction": {**FIELDS["friction"], "viscous": -1.0}},
            "friction.viscous: needs to be greater than or equal to 0",
        ),
        ({"cogging_sine": [1.0]}, "cogging_cosine: needs as many harmonics as cogging_sine, 1"),
        ({"cogging_sine": 4.0}, "cogging_sine: needs to be a valid list"),
        (
            {"cogging_sine": [[1.0], [1.0, 2.0]], "axes": ["X", "Y"]},
            "of equal length",
        ),
        ({"axes": ["X", "Y", "Z", "W"]}, "axes: needs one to 3"),
        ({"dt": 0}, "dt: needs to be greater than 0"),
        ({"encoder_resolution": 0}, "encoder_resolution: needs to be greater than 0"),
        ({"encoder_resolution": [1e-6] * 2}, "encoder_resolution: needs one number or 1"),
        ({"notes": "careful"}, "notes: needs to be a valid list"),
        ({"mass": 40.0}, "there is no field 'mass'"),
    ],
)
def test_one_clear_line(change, says):
    with pytest.raises(MachineError) as error:
        read(FlexibleAxisFile, FIELDS | change)
    assert says in str(error.value) and "\n" not in str(error.value)


def test_every_axis_may_have_an_encoder_of_its_own():
    for counts, wanted in (([1e-6, 5e-6], [1e-6, 5e-6]), ([2e-6, 2e-6], 2e-6)):
        pair = flexible_machine(read(FlexibleAxisFile, TWO | {"encoder_resolution": counts}))
        np.testing.assert_array_equal(pair.resolution, wanted)


@pytest.mark.parametrize("missing", ["dt", "motor_mass", "friction", "cogging_cosine"])
def test_what_is_missing_is_named(missing):
    with pytest.raises(MachineError, match=f"^{missing}: missing"):
        read(FlexibleAxisFile, {key: value for key, value in FIELDS.items() if key != missing})


def test_a_list_is_no_axis():
    with pytest.raises(MachineError, match="needs an object"):
        read(FlexibleAxisFile, [1, 2])


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=50)
@given(st.sampled_from(sorted(FIELDS)), ANYTHING)
def test_any_value_is_read_or_refused_in_one_line(field, value):
    try:
        read(FlexibleAxisFile, FIELDS | {field: value})
    except MachineError as error:
        assert "\n" not in str(error)
