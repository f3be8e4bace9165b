import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jcontour.app.machines
from jcontour.app.files.checks import MachineError
from jcontour.app.machines.from_file import load_machine, machine_from
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.app.machines.machine import Machine
from jcontour.linear.plant import steady_motion

EXAMPLE = Path(jcontour.app.machines.__file__).parent / "example.json"
FIELDS = json.loads(EXAMPLE.read_text())


def made(**change):
    """The example with other fields."""
    return machine_from(json.dumps(FIELDS | change).encode(), "example")


def measured(*hertz, **other):
    """Lines of some axes at which the model is right."""
    zeros = [[0.0] * len(one) for one in hertz]
    names = ("real", "imaginary", "half_width")
    return {"hertz": list(hertz)} | dict.fromkeys(names, zeros) | other


def test_what_was_measured_is_behind_each_control():
    lines = {**measured([5.0], [5.0, 50.0]), "real": [[0.1], [0.0, 0.2]]}
    first, second = made(uncertainty={"measured": lines}).measured
    assert first.error.tolist() == [0.1] and second.error.tolist() == [0.0, 0.2]
    assert second.frequency == pytest.approx(2 * np.pi * FIELDS["dt"] * np.array([5.0, 50.0]))
    assert made().measured == ()


def test_responses_of_a_softer_coupling_stand_beside_what_was_measured():
    machine = made(uncertainty={"other_amplitudes": measured([7.0, 9.0], [])})
    first, second = machine.response_uncertainty.other_amplitudes
    assert first.frequency == pytest.approx(2 * np.pi * FIELDS["dt"] * np.array([7.0, 9.0]))
    assert machine.measured == () and not second.frequency.size


def test_example_in_metres():
    machine = load_machine(EXAMPLE)
    assert (
        machine.name == "example-mill"
        and machine.axes == ("X", "Y")
        and machine.control_unit == "mm/s"
    )
    np.testing.assert_array_equal(np.asarray(machine.model.C)[:, :4], 1e-3 * np.array(FIELDS["C"]))
    assert machine.model.states == 4 + 2  # one sample of known delay on two inputs
    np.testing.assert_allclose(machine.limits.speed, [0.2, 0.2])
    np.testing.assert_allclose(machine.limits.acceleration, [3.0, 2.5])
    assert machine.encoder_resolution == pytest.approx(1e-6)


def test_friction_at_rest_needs_friction_and_a_speed():
    more = {"stribeck_friction": [0.2, 0.0], "stribeck_speed": 5.0}
    fields = {"length_unit": "mm", "friction": 0.5, **more}
    machine = made(**fields)
    assert machine.stribeck[0].tolist() == [0.2, 0.0] and machine.stribeck[1] == 5e-3
    assert machine.largest_friction == pytest.approx(0.7)
    for missing in ("stribeck_speed", "friction"):
        with pytest.raises(MachineError, match="stribeck_friction: needs"):
            made(**fields | {missing: None})


def test_encoders_count_alike_or_each_by_its_own():
    mixed, alike = (made(encoder_resolution=counts) for counts in ([0.001, 0.005], [0.005, 0.005]))
    assert mixed.resolution == pytest.approx(np.array([1e-6, 5e-6]))
    assert mixed.description()["Measured"].endswith("encoder 1, 5 um")
    assert alike.resolution == 0.005 * 1e-3  # one number
    assert alike.description()["Measured"].endswith("encoder 5 um")


def test_a_byte_order_mark_is_read_over_and_a_field_that_stands_twice_is_refused():
    text = EXAMPLE.read_text()
    assert machine_from(text.encode("utf-8-sig")).model.dt == FIELDS["dt"]
    for twice in (f'{text.rstrip()[:-1]}, "dt": 0.004}}', text.replace("{", '{"dt": 1, ', 1)):
        with pytest.raises(MachineError, match="'dt' stands twice"):
            machine_from(twice.encode())


@pytest.mark.parametrize("unit", [1e-10, 1e6])
def test_a_machine_is_controllable_whatever_the_unit_of_its_control(unit):
    """A late axis counts its control in steps of the position: an amount of any size."""
    B = (np.array(FIELDS["B"]) * unit).tolist()
    limits = FIELDS["limits"] | {"control": 1 / unit, "increment": 1 / unit}
    maps = steady_motion(made(B=B, limits=limits, known_delay=3).model)
    usual = steady_motion(made(known_delay=3).model)
    states = len(FIELDS["A"])
    np.testing.assert_allclose(maps.Sv[:states], usual.Sv[:states], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(maps.Sv[states:] * unit, usual.Sv[states:], rtol=1e-9)


def test_noise_of_encoders_is_one_or_each_and_may_be_none():
    for stated, wanted in ((0.0002, 2e-7), ([0.0002, 0.0], [2e-7, 0.0]), (0.0, 0.0)):
        machine = made(encoder_noise=stated)
        assert machine.encoder_noise == pytest.approx(np.array(wanted))
        assert machine.noisy_count == pytest.approx(np.sqrt(1e-12 + 12 * np.square(wanted)))


def test_a_note_is_repeated_where_the_machine_is_told():
    noted, plain = made(note="Y is a copy"), made()
    assert noted.description()["Note"] == "Y is a copy"
    assert noted.remarks == [f"{noted.name}: Y is a copy"]
    assert plain.remarks == [] and "Note" not in plain.description()


@pytest.mark.parametrize(
    ("friction", "told"),
    [(None, "not known"), (0.25, "0.25 "), ([0.5, 0.25], "0.5 0.25 "), (0.0, None)],
)
def test_friction_is_told_and_nothing_is_told_without(friction, told):
    machine = made(friction=friction)
    assert machine.friction == (None if friction is None else pytest.approx(friction))
    words = machine.description().get("Friction")
    assert words is None if told is None else words.startswith(told)
    assert "Friction" not in made().description()


@pytest.mark.parametrize("stated", [{}, {"uncertainty": None}])
def test_a_file_that_states_no_uncertainty_has_the_usual_and_says_so(stated):
    silent = {key: value for key, value in FIELDS.items() if key != "uncertainty"} | stated
    machine = machine_from(json.dumps(silent).encode(), "silent")
    assert machine.family_names == ["nominal", "gains 1.1, 0.9", "gains 0.9, 1.1", "1 sample late"]
    (line,) = machine.remarks
    assert '"uncertainty": {' in line
    alone = machine_from(json.dumps({**silent, "uncertainty": {}}).encode(), "alone")
    assert alone.family_names == ["nominal"] and alone.remarks == []


def test_family_has_nominal_first():
    members = bridgeport_machine().members
    assert [name for name, _, _ in members] == [
        "nominal",
        "gains 1.1, 0.9",
        "gains 0.9, 1.1",
        "1 sample late",
        "2 samples late",
    ]
    assert [delay for _, _, delay in members] == [0, 0, 0, 1, 2]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"A": [[1.0, 0.0]]}, "A: needs to be square"),
        ({"A": [[float("nan")] * 4] * 4}, "A: needs to be a finite number"),
        ({"B": [[1.0, 0.0]]}, "B: needs shape (4, p)"),
        ({"C": [[1.0, 0.0]]}, "C: needs shape (m, 4)"),
        ({"C": [[1.0, 0.0, 0.0, 0.0]]}, "C: needs two or three outputs"),
        ({"dt": 0}, "dt: needs to be greater than 0"),
        ({"dt": "fast"}, "dt: needs to be a valid number"),
        ({"dt": True}, "dt: needs to be a valid number"),
        ({"A": "text"}, "A: needs to be a valid list"),
        ({"A": [[1.0, 0.0], [0.0]]}, "A: needs a matrix"),
        ({"colour": "red"}, "there is no field 'colour'"),
        ({"limits": {"snap": 1.0}}, "limits: there is no field 'snap'"),
        ({"limits": {"speed": [1.0, 2.0, 3.0]}}, "limits.speed: needs one number or 2"),
        ({"limits": {"control": -1.0}}, "limits.control: needs to be greater than 0"),
        (
            {"limits": {"control": 1e30}},
            "limits.control: needs to be less than or equal to 1000000000000",
        ),
        (
            {"encoder_resolution": [0.001, 0.005, 0.001]},
            "encoder_resolution: needs one number or 2, received 3",
        ),
        ({"encoder_resolution": [0.001, 0.0]}, "encoder_resolution: needs to be greater than 0"),
        ({"note": ""}, "note: needs to have at least 1 character"),
        ({"encoder_noise": -1e-4}, "encoder_noise: needs to be greater than or equal to 0"),
        ({"encoder_noise": [0.0]}, "encoder_noise: needs one number or 2, received 1"),
        ({"length_unit": "furlong"}, "length_unit: needs to be 'm', 'mm' or 'um'"),
        ({"known_delay": 1.5}, "known_delay: needs to be a valid integer"),
        ({"friction": -0.1}, "friction: needs to be greater than or equal to 0"),
        ({"uncertainty": {"gain": 1.0}}, "uncertainty.gain: needs to be less than 1"),
        ({"uncertainty": {"response": {"hertz": [1]}}}, "uncertainty.response.relative: missing"),
        (
            {"uncertainty": {"response": {"hertz": [9, 3], "relative": [[0, 0]] * 2}}},
            "response.hertz: needs rising frequencies above 0",
        ),
        (
            {"uncertainty": {"response": {"hertz": [1e9], "relative": [[0]] * 2}}},
            "response.hertz: needs rising frequencies above 0",
        ),
        ({"uncertainty": {"measured": measured([3.0])}}, "measured: needs 2 lists"),
        ({"uncertainty": {"measured": measured([3.0], [1e9])}}, "up to half the sample rate"),
        ({"uncertainty": {"measured": measured([], [1.0], real=[[], []])}}, "one number per freq"),
        (
            {"uncertainty": {"response": {"hertz": [1, 3], "relative": [[0, 1]]}}},
            "response.relative: needs 2 rows of 2 numbers",
        ),
        (
            {"uncertainty": {"response": {"hertz": [1], "relative": [[-1], [0]]}}},
            "response.relative: needs 2 rows of 1 numbers of at least 0",
        ),
        ({"axes": ["X", "X"]}, "axes: needs 2 different names"),
        ({"B": [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0001], [0.0, 0.18]]}, "out of reach of the inputs"),
        ({"C": [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]}, "does not show in the outputs"),
    ],
)
def test_one_clear_line(change, says):
    with pytest.raises(MachineError) as error:
        made(**change)
    assert says in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("missing", ["A", "B", "C", "dt"])
def test_missing_field(missing):
    fields = {key: value for key, value in FIELDS.items() if key != missing}
    with pytest.raises(MachineError, match=f"^{missing}: missing"):
        machine_from(json.dumps(fields).encode())


def test_missing_file(tmp_path):
    with pytest.raises(MachineError, match="cannot be read"):
        load_machine(tmp_path / "none.json")


def valid_or_ours(content):
    try:
        assert isinstance(machine_from(content), Machine)
    except MachineError as error:
        assert "\n" not in str(error)


@given(st.binary(max_size=300))
def test_random_bytes(content):
    valid_or_ours(content)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=5,
)


@settings(max_examples=50)
@given(st.sampled_from(sorted(FIELDS)), JSON)
def test_replaced_fields(name, value):
    valid_or_ours(json.dumps({**FIELDS, name: value}).encode())


@settings(max_examples=30)
@given(st.data())
def test_mutated_bytes(data):
    content = bytearray(EXAMPLE.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    valid_or_ours(bytes(content))
