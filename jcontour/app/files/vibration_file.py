"""Vibration of a tool: accelerations that Klipper records, or the spectra that it makes of them.

`raw_data_*.csv` holds #time,accel_x,accel_y,accel_z with gravity, whose size says the unit.
`resonances_*.csv` holds freq,psd_x,psd_y,psd_z, and `calibration_data_*.csv` shapers beside: its
densities are divided by f + 0.1 Hz (Klipper, klippy/extras/shaper_calibrate.py).
"""

import warnings
from pathlib import Path

import numpy as np

from jcontour.app.files.clock import longest_even_part, resampled
from jcontour.app.files.log_table import KLIPPER, finite, read_table
from tuning.identification.vibration import Vibration, vibration_of

TIMES, LINES = (head.decode().split(",") for head in KLIPPER)
GRAVITY, UNITS = 9.80665, (9806.65, 9.80665, 1.0)  # [m/s^2], and in mm/s^2, m/s^2 and g
NEARLY = 1.5  # gravity may look so many times larger or smaller, by the offset of a sensor
CLIPPED = 2e-4  # part of the samples at one extreme
GAP = 0.05  # [s] of lost samples that lines between the others bridge, at most
LOWEST, BEYOND = 10.0, 1.55  # [Hz] of its lines; the last is at 1.5 of the end of the sweep


def read_vibration(path: Path) -> Vibration:
    """Response of a tool that a sweep shakes.

    Raises:
        ValueError: a number is missing, samples are clipped or uneven, the unit is not known, or no
            sweep is seen.
    """
    table = read_table(path)
    names = LINES if LINES[0] in table else TIMES
    columns = [table.get(name, np.full(1, np.nan)) for name in names]
    for name, values in zip(names, columns, strict=True):
        finite(path, name, values)
    first, values = columns[0], np.stack(columns[1:], axis=1)
    if names == TIMES:
        return _sampled(first, values)
    f = np.linspace(first[0], first[-1], len(first))  # even, but printed to 0.1 Hz
    seen = (f >= LOWEST) & (f <= f[-1] / BEYOND)
    if seen.sum() < 20 or np.abs(f - first).max() > 0.1 or not (values[seen] > 0).all():
        raise ValueError("holds no densities above zero at 20 even frequencies, as Klipper's files")
    divided = any("mzv" in name for name in table)
    return Vibration(f[seen], values[seen] / f[seen, None] ** (1 if divided else 2))


def _sampled(time: np.ndarray, values: np.ndarray) -> Vibration:
    steps = np.diff(time)
    if not (steps > 0).all() or steps.max() > GAP:
        part = longest_even_part(time)
        time, values = time[part.rows], values[part.rows]
        if part.words:
            warnings.warn(part.words, stacklevel=2)
    dt = float((time[-1] - time[0]) / (len(time) - 1))
    mean = float(np.linalg.norm(values.mean(axis=0)))
    unit = next((one for one in UNITS if one / NEARLY < mean < one * NEARLY), None)
    if unit is None:
        said = "keep gravity, 9807 mm/s^2, 9.807 m/s^2 or 1 g, in the record"
        raise ValueError(f"its mean acceleration, {mean:.4g}, does not tell its unit; {said}")
    vibration = vibration_of(resampled(time, dt, values * (GRAVITY / unit)), dt)
    shaken = values[:, vibration.axis]
    count = max(np.sum(shaken == shaken.min()), np.sum(shaken == shaken.max()))
    if count > CLIPPED * len(shaken):
        raise ValueError(f"{count} samples are clipped: shake less, or widen the sensor's range")
    return vibration
