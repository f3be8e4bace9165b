from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.files.run_folder import json_text
from jcontour.app.flags.machines import Machine
from jcontour.app.machines.built import built_machine
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.linear import LinearMachine

MILL = Machine(gain=(2.0,), time_constant_ms=(20.0, 10.0), delay_ms=(1.5,), max_control=(100.0,))


def loaded(flags):
    return machine_from(json_text(built_machine(flags).fields).encode())


def test_a_speed_drive_is_its_transfer_function():
    """At 3 Hz, where a held control is still a smooth one."""
    machine = loaded(MILL)
    A, B, C = (np.asarray(one) for one in (machine.model.A, machine.model.B, machine.model.C))
    s = 2j * np.pi * 3
    z = np.exp(s * 1e-3)
    for axis, constant in enumerate((0.02, 0.01)):
        response = C[axis] @ np.linalg.solve(z * np.eye(len(A)) - A, B[:, axis])
        held = np.exp(-0.5e-3 * s)  # half a sample, of the hold
        wanted = 2e-3 * np.exp(-1.5e-3 * s) / (s * (constant * s + 1)) * held
        assert response == pytest.approx(wanted, rel=1e-3)
    assert machine.limits.control is not None and machine.limits.control.tolist() == [100.0, 100.0]
    assert machine.resolution == pytest.approx(1e-6)


def test_a_data_sheet_is_newtons_law():
    flags = Machine(takes="force", gain=(35.15,), mass_kg=(95.1089,), viscous=(203.5034,))
    model = jax.device_get(loaded(flags).model)
    e = np.exp(-203.5034 / 95.1089 * 1e-3)
    assert model.A[1, 1] == pytest.approx(e, rel=1e-12)
    assert model.B[1, 0] == pytest.approx(35.15 / 203.5034 * (1 - e), rel=1e-12)


def test_three_axes_in_metres():
    flags = Machine(axes=("X", "Y", "Z"), takes="position", gain=(1.0,), time_constant_ms=(5.0,))
    machine = loaded(replace(flags, length_unit="m"))
    assert machine.axes == ("X", "Y", "Z") and machine.model.axes == 3
    assert np.asarray(machine.model.A)[2, 2] == pytest.approx(np.exp(-0.2))


def test_a_drive_that_takes_a_position_gets_there():
    """A millimetre asked is a millimetre gone on every machine of the family, in the end."""
    drive = Machine(takes="position", gain=(1.0,), time_constant_ms=(5.0,))
    machine = loaded(drive)
    assert isinstance(machine, LinearMachine)
    assert machine.family_names == ["nominal", "1 sample late"]
    for plant in machine.exact_family():
        state = plant.initial_state(jnp.zeros(2), jnp.zeros(2))
        for _ in range(100):  # twenty time constants
            state = plant.step(state, jnp.ones(2))
        assert np.asarray(plant.output(state)) == pytest.approx(1e-3, rel=1e-6)
    for given in (drive, MILL, Machine(takes="force", gain=(1.0,), mass_kg=(1.0,))):
        wanted = {"position": 0.0, "speed": 0.1, "force": 0.1}[given.takes]
        assert built_machine(given).fields["uncertainty"] == {"gain": wanted, "delay": 1}
        asked = built_machine(replace(given, gain_uncertainty=0.03)).fields
        assert asked["uncertainty"]["gain"] == 0.03


def test_a_resonance_is_not_taken_for_exact_unless_that_is_asked_for():
    soft = replace(MILL, resonance_hz=(80.0, 0.0))
    built = built_machine(soft)
    assert "resonance at 80 Hz (+- 5 %, damping 0.015 to 0.03" in built.words[0]
    response = loaded(soft).response_uncertainty
    assert response is not None
    off, none = response.at(np.array([2 * np.pi * 80.0 * 1e-3]))[0]
    assert off > 0.9 and none == 0  # with half the damping the peak is twice as high
    exact = replace(soft, resonance_uncertainty=0.0)
    assert loaded(exact).response_uncertainty is None
    assert "80 Hz, damping 0.03" in built_machine(exact).words[0]


def test_limits_are_of_all_axes_or_of_each():
    flags = replace(
        MILL, max_control=(300.0, 12.0), max_speed=(200.0,), max_acceleration=(2e3, 5e2)
    )
    limits = loaded(flags).limits
    assert limits.control is not None and limits.control.tolist() == [300.0, 12.0]
    assert limits.speed == pytest.approx(np.array([0.2, 0.2]))
    assert limits.acceleration == pytest.approx(np.array([2.0, 0.5]))
    assert built_machine(flags).fields["limits"]["speed"] == 200.0
    assert loaded(replace(MILL, max_control=())).limits.control is None


def test_every_axis_may_have_an_encoder_of_its_own():
    assert loaded(replace(MILL, encoder_um=(1.0, 5.0))).resolution == pytest.approx(
        np.array([1e-6, 5e-6])
    )


def test_bad_flags_are_told():
    for change, words in (
        ({"axes": ("X",)}, "axes: needs two or three different names, received X"),
        ({"axes": ("X", "X")}, "axes: needs two or three different names"),
        ({"gain": ()}, "gain: missing; a drive that takes a speed needs it"),
        ({"gain": (1.0, 2.0, 3.0)}, "gain: needs one number or 2, received 3"),
        ({"gain": (0.0,)}, "gain: needs to be above zero"),
        ({"gain": (-5.0,)}, "gain: needs to be at least zero, received -5$"),
        ({"max_control": (1.0, 2.0, 3.0)}, "^max-control: needs one number or 2, received 3$"),
        ({"max_speed": (1.0, -2.0)}, "^max-speed: needs to be above zero, received -2$"),
        ({"max_acceleration": (0.0,)}, "^max-acceleration: needs to be above zero, received 0$"),
        ({"encoder_um": (1.0, 2.0, 3.0)}, "^encoder-um: needs one number or 2, received 3$"),
        ({"encoder_um": (1.0, 0.0)}, "^encoder-um: needs to be above zero, received 0$"),
        ({"encoder_um": ()}, "^encoder-um: needs one number or one for each axis"),
        ({"resonance_uncertainty": 1.0}, "resonance-uncertainty: needs a fraction below 1"),
        ({"takes": "force"}, "mass-kg: missing"),
        ({"delay_ms": (150.0,)}, "delay-ms: 150 samples of 1 ms, known delays are of at most 50"),
        ({"mass_kg": (5.0,)}, "mass-kg: says nothing of a drive that takes a speed"),
        ({"viscous": (5.0,)}, "viscous: says nothing of a drive that takes a speed"),
        ({"takes": "force", "mass_kg": (5.0,)}, "time-constant-ms: says nothing of a drive that"),
        ({"period_ms": 0.0}, "period-ms: needs to be above zero"),
        ({"resonance_hz": (600.0,)}, "resonance of X at 599.7 Hz needs more than two samples"),
        ({"steps": ("a.csv", "b.csv")}, "gain: the step responses say it; leave it out"),
    ):
        with pytest.raises(ValueError, match=words):
            built_machine(replace(MILL, **change))
