import numpy as np
import pytest

from tuning.identification.flexible_axis.cogging import harmonics, spectrum

PITCH = 0.06


def scattered(travel=0.4, noise=0.05, seed=0, amplitudes=(5.0, 0.0, 0.8)):
    """Samples at random places of a force with the first and third harmonic of 60 mm."""
    random = np.random.default_rng(seed)
    x = random.uniform(0.1, 0.1 + travel, 20_000)
    force = sum(a * np.sin(2 * np.pi * j / PITCH * x + j) for j, a in enumerate(amplitudes, 1))
    return x, force + 1.5 + noise * random.normal(size=x.size)


def test_amplitudes_of_the_lines():
    found = spectrum(*scattered())
    assert found.travel == pytest.approx(0.4, rel=1e-3)
    for j, amplitude in ((1, 5.0), (3, 0.8)):
        assert np.interp(j / PITCH, found.wavenumber, found.amplitude) == pytest.approx(
            amplitude, rel=0.03
        )


def test_finds_pitch_and_harmonics():
    found = harmonics(spectrum(*scattered()))
    assert found.pole_pitch == pytest.approx(PITCH, rel=2e-3) and found.highest == 3


def test_a_given_pitch_is_kept():
    """Its fifth multiple is the strongest line."""
    found = harmonics(spectrum(*scattered(travel=1.0)), pole_pitch=5 * PITCH / 3)
    assert found.pole_pitch == 5 * PITCH / 3 and found.highest == 5


def test_without_cogging():
    found = harmonics(spectrum(*scattered(amplitudes=(0.0,))))
    assert found.highest == 0 and found.pole_pitch == pytest.approx(0.4, rel=1e-3)


def test_a_travel_that_is_too_short():
    with pytest.raises(ValueError, match="travel 0.13 m, 2.2 pole pitches of 0.06.* needs 2.5"):
        harmonics(spectrum(*scattered(travel=0.13)), PITCH)
