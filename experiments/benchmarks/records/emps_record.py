"""A record of the EMPS drive, simulated with its published numbers and cascade."""

import numpy as np
from jaxtyping import Float

from jcontour.plants import emps


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
