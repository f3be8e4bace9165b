"""The EMPS drive, simulated and identified again."""

import numpy as np
import pytest
from jaxtyping import Float

from jcontour.app.machines.identified import axis_result
from jcontour.plants import emps
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord

DT, ROWS = emps.SAMPLE_PERIOD, 24_000


def emps_record(
    reference: Float[np.ndarray, " T"], seed: int, noise: float = 0.0
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Voltage [V] and counted position [m] while the drive follows a reference at 1 kHz.

    Between samples the voltage and the direction of sliding are held, and the rest is exact. An
    axis that comes to rest sticks until the force is larger than Coulomb friction.

    Args:
        reference: q_r [m].
        seed: of the noise.
        noise: standard deviation of a position before it is counted [m]; counts alone make some.
    """
    dt, random = emps.SAMPLE_PERIOD, np.random.default_rng(seed)
    p = np.exp(-emps.VISCOUS / emps.MASS * dt)
    lag = emps.MASS / emps.VISCOUS * (1 - p)
    rows = len(reference)
    voltage, counted = np.zeros(rows), np.zeros(rows)
    errors = noise * random.standard_normal(rows)
    x = float(reference[0])
    v, before = 0.0, x
    for k in range(rows):
        counted[k] = emps.RESOLUTION * np.round((x + errors[k]) / emps.RESOLUTION)
        speed, before = (counted[k] - before) / dt, counted[k]
        asked = emps.SPEED_GAIN * (emps.POSITION_GAIN * (reference[k] - counted[k]) - speed)
        voltage[k] = np.clip(asked, -emps.LARGEST_VOLTAGE, emps.LARGEST_VOLTAGE)
        force = emps.DRIVE_GAIN * voltage[k] - emps.OFFSET
        if v == 0.0 and abs(force) <= emps.COULOMB:
            continue
        way = np.sign(v) or np.sign(force)
        steady = (force - emps.COULOMB * way) / emps.VISCOUS
        after = steady + (v - steady) * p
        if way * after < 0:
            v = 0.0
            continue
        x += (v - steady) * lag + steady * dt
        v = after
    return voltage, counted


def program():
    """Moves to and fro with smooth ends, as those of the public record: 0 to 0.24 m in 24 s."""
    time = DT * np.arange(ROWS)
    knots = np.random.default_rng(0).uniform(0.0, 0.24, 25)
    part = np.minimum(time % 1.0 / 0.9, 1.0)
    smooth = part**3 * (10 - 15 * part + 6 * part**2)
    whole = time.astype(int)
    return knots[whole] + (knots[np.minimum(whole + 1, 24)] - knots[whole]) * smooth


def physical(one):
    """M, F_v, F_c and the offset of an identified axis, by the gain of its drive."""
    viscous = emps.DRIVE_GAIN / one.gain
    mass = viscous * one.time_constants[0]
    return mass, viscous, emps.DRIVE_GAIN * one.friction, -emps.DRIVE_GAIN * one.offset


def test_the_record_obeys_the_balance_of_forces():
    """Work of the drive = kinetic energy + heat, over a stretch that ends in motion."""
    voltage, counted = emps_record(program(), 0, noise=0.0)
    speed = np.gradient(counted, DT)
    end = 5_450
    power = (emps.DRIVE_GAIN * voltage - emps.OFFSET) * speed
    heat = emps.VISCOUS * speed**2 + emps.COULOMB * np.abs(speed)
    work, lost = (DT * part[:end].sum() for part in (power, heat))
    kinetic = 0.5 * emps.MASS * speed[end] ** 2
    assert work == pytest.approx(lost + kinetic, rel=0.02)
    assert np.abs(voltage).max() < emps.LARGEST_VOLTAGE


@pytest.mark.slow
def test_all_four_numbers_within_one_percent():
    u, y = emps_record(program(), 1)
    machine_read = identify_machine(MachineRecord(DT, ("X",), u[:, None], y[:, None]), 1, 1)
    one = axis_result(machine_read.axes[0])
    wanted = (emps.MASS, emps.VISCOUS, emps.COULOMB, emps.OFFSET)
    assert physical(one) == pytest.approx(wanted, rel=0.01)
