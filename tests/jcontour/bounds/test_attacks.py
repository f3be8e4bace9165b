"""Attacks: inside their box, and as large as the sums say."""

import numpy as np
import pytest

from jcontour.bounds.attacks import coefficients, worst_attack
from jcontour.bounds.disturbed_loop import Box
from jcontour.bounds.peak_bounds import peak_bounds

BOX = Box.of([0.3, 1.0], 2.0, inputs=2, measured=1)


def test_coefficients_are_the_answers_to_pulses(random_loop, pushed):
    loop = random_loop(7, 9)
    row = np.asarray(loop.C)[6, 0]
    found = coefficients(loop, row, 6)
    for j in range(6):
        for i in range(3):
            pulse = np.zeros((9, 3))
            pulse[j, i] = 1.0
            assert found[j, i] == pytest.approx(row @ pushed(loop, pulse)[6], rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("sign", [-2.0, 1.0])
def test_the_attack_reaches_the_bound_from_inside_its_box(random_loop, pushed, sign):
    loop = random_loop(8, 25)
    rows = np.asarray(loop.C)
    attack = worst_attack(loop, rows[20, 1], 20, BOX, sign)
    w = np.concatenate([attack.force, attack.noise], axis=1)
    assert np.all(np.abs(w) <= BOX.size) and not w[20:].any()
    reached = rows[20, 1] @ pushed(loop, w)[20]
    bound = peak_bounds(loop, rows, BOX.size).bound[20, 1]
    assert reached == pytest.approx(np.sign(sign) * bound, rel=1e-12)


@pytest.mark.parametrize("sample", [-1, 9])
def test_a_sample_beyond_the_run_is_told(random_loop, sample):
    loop = random_loop(7, 9)
    with pytest.raises(ValueError, match=f"sample: needs one from 0 to 8, received {sample}"):
        coefficients(loop, np.zeros(4), sample)
