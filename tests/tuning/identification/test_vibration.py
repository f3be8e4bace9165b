"""Resonances of simulated tools that are shaken as by Klipper."""

import numpy as np
import pytest

from tests.tuning.identification.shaken_tool import shaken
from tuning.identification.vibration import Vibration, resonances, vibration_of

RATE = 1600.0
MODE = [(52.0, 0.05, 1.0)]


def found(modes, **settings):
    return resonances(vibration_of(shaken(modes, jitter=0, **settings)[1], 1 / RATE))


@pytest.mark.parametrize(
    "modes",
    [
        *([(hertz, zeta, 1.0)] for hertz, zeta in ((12, 0.05), (28, 0.02), (52, 0.05), (90, 0.1))),
        [(40.0, 0.04, 0.7), (70.0, 0.05, 0.3)],
        [(48.0, 0.03, 0.6), (56.0, 0.03, 0.4)],
    ],
)
def test_modes_come_back(modes):
    for one, (hertz, zeta, _) in zip(found(modes), modes, strict=True):
        assert one.frequency[0] == pytest.approx(hertz, rel=2e-3)
        assert one.damping[0] == pytest.approx(zeta, rel=0.03)
        assert one.shares == pytest.approx((1 / 1.01, 0.01 / 1.01, 0), abs=1e-3)


def test_intervals_hold_as_often_as_they_say():
    fits = [found(MODE, noise=2.0, seed=seed)[0] for seed in range(20)]
    for values, true in (
        (np.array([one.frequency for one in fits]), 52.0),
        (np.array([one.damping for one in fits]), 0.05),
    ):
        scatter, half = 1.96 * np.std(values[:, 0]), np.mean(values[:, 2] - values[:, 1]) / 2
        assert 0.5 * scatter < half < 2.5 * scatter
        assert np.abs(np.mean(values[:, 0]) / true - 1) < 5e-3


@pytest.mark.parametrize(
    ("modes", "settings", "words"),
    [
        ([(170.0, 0.03, 1.0)], {}, "no peak of 4 dB to 13.* Hz"),  # above the sweep
        ([(50.0, 0.6, 1.0)], {}, "no peak"),
        (MODE, {"per_hz": 0.0}, "nothing sweeps"),
        (MODE, {"highest": 12.0, "rest": 8.0}, "nothing sweeps"),
        (MODE, {"highest": 10.0}, "and 9.5 s of them"),
        (MODE, {"rate": 390.0}, "a sweep needs 400 samples a second"),
    ],
)
def test_records_without_an_answer_are_refused(modes, settings, words):
    with pytest.raises(ValueError, match=words):
        resonances(
            vibration_of(shaken(modes, jitter=0, **settings)[1], 1 / settings.get("rate", RATE))
        )


def test_a_peak_of_many_modes_is_refused():
    f = np.arange(8.0, 130.0, 0.5)
    power = sum(1 / ((1 - (f / one) ** 2) ** 2 + (0.06 * f / one) ** 2) for one in (50, 57, 65))
    with pytest.raises(ValueError, match="the peak at .* Hz is of no one or two resonances"):
        resonances(Vibration(f, np.stack([power, power / 9, power / 9], axis=1)))
