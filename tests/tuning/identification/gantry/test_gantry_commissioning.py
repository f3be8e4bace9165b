import numpy as np

from jcontour.plants.gantry.parameters import thesis_gantry
from tuning.identification.gantry.gantry_commissioning import (
    HEADS,
    PEAK,
    RESOLUTION,
    SAMPLE,
    SWEEP,
    commissioned,
    excitation,
)


def test_the_sweep_is_in_the_band_and_fades():
    swept = excitation()[:, 1]
    power = np.abs(np.fft.rfft(swept)) ** 2
    hertz = np.fft.rfftfreq(swept.size, SAMPLE)
    assert power[(hertz > SWEEP[0]) & (hertz < SWEEP[1])].sum() > 0.99 * power.sum()
    assert 0.95 * PEAK < np.abs(swept).max() <= PEAK and swept[0] == swept[-1] == 0


def test_records_are_counts_around_the_held_head():
    for record, head in zip(commissioned(thesis_gantry(), 3), HEADS, strict=True):
        counts = record.readings / RESOLUTION
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
        assert np.abs(record.readings[:, 0] - head).max() < 5e-3
        assert np.all(record.currents[:, 2] == 0) and np.isfinite(record.currents).all()


def test_seeds_differ_in_noise_only():
    first, again, other = (commissioned(thesis_gantry(), seed, (0.1,))[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.readings, again.readings)
    apart = np.std((first.readings - other.readings)[:, 1:])
    assert 3e-7 < apart < 1e-6  # root two of noise and count
