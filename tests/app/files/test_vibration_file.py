"""Files of Klipper's accelerometer, and what is wrong with them."""

import numpy as np
import pytest
from scipy.signal import welch

from jcontour.app.files.log_table import of_accelerometer
from jcontour.app.files.vibration_file import read_vibration
from tests.tuning.identification.shaken_tool import shaken
from tuning.identification.vibration import resonances

TIME, SEEN = shaken([(52.0, 0.05, 1.0)])
RAW, PSD = "#time,accel_x,accel_y,accel_z", "freq,psd_x,psd_y,psd_z,psd_xyz"


def written(folder, header, columns):
    path = folder / "file.csv"
    np.savetxt(path, columns, "%.6f", ",", header=header, comments="")
    return path


def raw(folder, values=1e3 * SEEN, time=TIME):
    return written(folder, RAW, np.column_stack([time, values]))


@pytest.mark.parametrize("unit", [1e-3, 1.0, 9.80665])
def test_gravity_tells_the_unit(tmp_path, unit):
    path = raw(tmp_path, SEEN / unit)
    assert of_accelerometer(path)
    vibration = read_vibration(path)
    assert vibration.axis == 0
    # what follows the command below the resonance: |0.06 f|^2 4^2 / pi^2 / 2, over 2 Hz a second
    whole = 66 * np.mean(vibration.power[6:14, 0])  # of a record of about 70 s
    assert whole == pytest.approx(0.06**2 * 8 / np.pi**2 / 2, rel=0.2)
    assert resonances(vibration)[0].frequency[0] == pytest.approx(52, rel=2e-3)


@pytest.mark.parametrize(("header", "power"), [(PSD, 0), (f"{PSD},zv(52.0),mzv(52.0)", 1)])
def test_spectra_of_klipper(tmp_path, header, power):
    f, density = welch(1e3 * SEEN, 1600, ("kaiser", 6.0), 1024, axis=0)
    density /= (f[:, None] + 0.1) ** power
    rest = np.ones((len(f), header.count(",") - 3))
    (found,) = resonances(
        read_vibration(written(tmp_path, header, np.c_[f.round(1), density, rest]))
    )
    assert found.frequency[0] == pytest.approx(52, rel=2e-3)
    assert found.damping[0] == pytest.approx(0.05, rel=0.05)


def test_lost_samples_are_bridged_and_gaps_said(tmp_path):
    kept = np.random.default_rng(0).uniform(size=len(TIME)) > 0.01
    vibration = read_vibration(raw(tmp_path, 1e3 * SEEN[kept], TIME[kept]))
    assert resonances(vibration)[0].damping[0] == pytest.approx(0.05, rel=0.03)
    early = np.abs(TIME - TIME[0] - 5) > 0.2
    with pytest.warns(UserWarning, match="1 gaps .* used is the longest part"):
        read_vibration(raw(tmp_path, 1e3 * SEEN[early], TIME[early]))


def test_faults_are_told(tmp_path):
    missing, clipped, torn = 1e3 * SEEN, np.clip(1e3 * SEEN, -15e3, 15e3), TIME.copy()
    missing[400, 1] = np.nan
    torn += np.arange(len(TIME)) // 2000  # a gap of 1 s each 1.25 s
    for values, time, words in (
        (missing, TIME, "accel_y holds no number in row 401"),
        (clipped, TIME, "samples are clipped"),
        (1e3 * (SEEN - SEEN.mean(axis=0)), TIME, "does not tell its unit"),
        (1e3 * SEEN, torn, "not evenly spaced"),
    ):
        with pytest.raises(ValueError, match=words):
            read_vibration(raw(tmp_path, values, time))
    f = np.arange(0, 200, 1.6)
    with pytest.raises(ValueError, match="no densities above zero at 20 even"):
        read_vibration(written(tmp_path, PSD, np.c_[f**2, f, f, f, f]))
    assert not of_accelerometer(written(tmp_path, "time,x_command,x_position", np.c_[f, f, f]))
