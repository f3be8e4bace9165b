"""Peak bounds: against forward propagation, every corner of the box, and the reference numbers."""

from itertools import product

import jax
import numpy as np
import pytest

from jcontour.bounds.disturbed_loop import Box, disturbed_loop
from jcontour.bounds.peak_bounds import coefficients, peak_bounds, state_tubes, worst_attack
from jcontour.plants.actuation import Disturbed
from jcontour.simulation.closed_loop import simulate

SIZE = np.array([0.3, 1.0, 2.0])


def forward_bounds(loop, rows, size):
    """The sums by propagation of every disturbance forward."""
    M, E = np.asarray(loop.M), np.asarray(loop.E)
    actual, effects = np.zeros(rows.shape[:2]), np.zeros((E.shape[1], 0))
    for k in range(len(M)):
        actual[k] = np.abs(rows[k] @ effects).sum(axis=1)
        effects = np.concatenate([M[k] @ effects, E[k] * size], axis=1)
    return actual


def test_bounds_are_those_of_forward_propagation(random_loop):
    loop = random_loop(1, 40)
    rows = np.asarray(loop.C)
    actual = peak_bounds(loop, rows, SIZE)
    assert actual.bound == pytest.approx(forward_bounds(loop, rows, SIZE), rel=1e-12)
    assert not actual.remainder.any()


def test_the_bound_is_the_largest_of_all_corners(random_loop, pushed):
    loop = random_loop(2, 4, states=2)
    rows = np.asarray(loop.C)
    corners = np.array(list(product((-1.0, 1.0), repeat=9))).reshape(-1, 3, 3)
    last = [pushed(loop, np.concatenate([w * SIZE, np.zeros((1, 3))]))[3] for w in corners]
    largest = np.abs(np.array(last) @ rows[3].T).max(axis=0)
    assert peak_bounds(loop, rows, SIZE).bound[3] == pytest.approx(largest, rel=1e-13)


def test_a_direct_effect_adds_its_own_share(random_loop):
    loop = random_loop(3, 12)
    rows = np.asarray(loop.C)
    direct = np.random.default_rng(0).standard_normal((12, 2, 3))
    actual = peak_bounds(loop, rows, SIZE, direct).bound - peak_bounds(loop, rows, SIZE).bound
    assert actual == pytest.approx(np.abs(direct) @ SIZE, rel=1e-10)


@pytest.mark.parametrize("block", [1, 3, 7, 20])
def test_blocks_bound_from_above_and_say_by_how_much(random_loop, block):
    loop = random_loop(4, 40)
    rows = np.asarray(loop.C)
    exact = forward_bounds(loop, rows, SIZE)
    actual = peak_bounds(loop, rows, SIZE, block=block)
    assert np.all(actual.bound >= exact * (1 - 1e-13))
    assert np.all(actual.bound - actual.remainder <= exact * (1 + 1e-13))
    assert actual.remainder[: 2 * block].max() == 0.0


def test_states_at_the_begin_of_blocks_stay_in_their_tube(random_loop, pushed):
    loop = random_loop(5, 30)
    tubes = state_tubes(loop, SIZE, 6)
    random = np.random.default_rng(1)
    for _ in range(200):
        w = SIZE * np.sign(random.standard_normal((30, 3)))
        assert np.all(np.abs(pushed(loop, w)[::6]) <= tubes * (1 + 1e-12))


def test_bad_input_is_told(random_loop):
    loop = random_loop(6, 5)
    with pytest.raises(ValueError, match="block: needs at least one sample, received 0"):
        peak_bounds(loop, np.asarray(loop.C), SIZE, block=0)
    with pytest.raises(ValueError, match="rows, size: the loop needs shapes"):
        peak_bounds(loop, np.asarray(loop.C), SIZE[:2])


def normal_rows(circle, loop):
    """Rows of the normal error, and that error without disturbance."""
    tangent = np.asarray(circle.reference.tangent[: circle.reference.steps])
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    wanted = np.asarray(circle.reference.position[: circle.reference.steps])
    off = np.asarray(loop.output) - wanted
    return np.einsum("tm,tmn->tn", normal, loop.C), np.sum(normal * off, axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("index", range(3))
def test_the_reference_circle(reference_circle, index):
    row = reference_circle.rows[index]
    controller, box = reference_circle.of(row)
    loop = disturbed_loop(reference_circle.plant, controller, reference_circle.reference)
    rows, nominal = normal_rows(reference_circle, loop)
    bound = peak_bounds(loop, rows[:, None], box.size).bound[:, 0]
    total = np.abs(nominal) + bound
    assert bound[504:].max() == pytest.approx(row["disturbance_bound_m"], rel=1e-8)
    assert np.abs(nominal)[504:].max() == pytest.approx(row["nominal_m"], rel=1e-8)
    assert total[504:].max() == pytest.approx(row["certified_m"], rel=1e-8)
    for sample, value in row["bound_at"]:
        assert bound[sample] == pytest.approx(value, rel=1e-8)
    for sample, value in row["nominal_at"]:
        assert nominal[sample] == pytest.approx(value, abs=1e-8 * row["nominal_m"])
    worst = 504 + int(np.argmax(total[504:]))
    attack = worst_attack(loop, rows[worst], worst, box, nominal[worst])
    run = simulate(attack.on(reference_circle.plant), controller, reference_circle.reference)
    _, reached = normal_rows(reference_circle, loop._replace(output=run.output))
    assert abs(reached[worst]) == pytest.approx(total[worst], rel=1e-9)


def noises(random, laps, steps):
    """Signs of four kinds (laps, T, d): even, bang-bang, telegraph, slow square waves."""
    even = random.uniform(-1, 1, (laps, steps, 4))
    flips = random.random((laps, steps, 4)) < random.uniform(0.01, 0.5, (laps, 1, 1))
    telegraph = np.where(np.cumsum(flips, axis=1) % 2 == 0, 1.0, -1.0)
    kinds = [even, np.sign(even), telegraph, np.sign(np.sin(0.3 * np.cumsum(np.abs(even), 1)))]
    return np.choose((np.arange(laps) % 4)[:, None, None], kinds)


@pytest.mark.slow
def test_no_lap_of_a_thousand_exceeds_the_bound(reference_circle):
    row, laps = reference_circle.rows[0], 1000
    controller, box = reference_circle.of(row)
    plant, reference = reference_circle.plant, reference_circle.reference
    loop = disturbed_loop(plant, controller, reference)
    rows, nominal = normal_rows(reference_circle, loop)
    total = np.abs(nominal) + peak_bounds(loop, rows[:, None], box.size).bound[:, 0]
    random = np.random.default_rng(11)
    worst = worst_attack(loop, rows[664], 664, box, nominal[664])
    adverse = np.concatenate([worst.force, worst.noise], axis=1)

    @jax.jit
    @jax.vmap
    def outputs(w):
        disturbed = Disturbed(plant, force=w[:, :2], noise=w[:, 2:])
        return simulate(disturbed, controller, reference).output

    w = noises(random, laps, reference.steps) * box.size
    flipped = random.random((laps // 10, *adverse.shape)) < 0.01
    w[: laps // 10] = np.where(flipped, -adverse, adverse)
    _, error = normal_rows(reference_circle, loop._replace(output=outputs(w)))
    assert 0.95 < np.max(np.abs(error[:, 1:]) / total[1:]) <= 1 + 1e-9


BOX = Box.of([0.3, 1.0], 2.0, inputs=2, measured=1)


def test_coefficients_are_the_answers_to_pulses(random_loop, pushed):
    loop = random_loop(7, 9)
    row = np.asarray(loop.C)[6, 0]
    actual = coefficients(loop, row, 6)
    for j in range(6):
        for i in range(3):
            pulse = np.zeros((9, 3))
            pulse[j, i] = 1.0
            assert actual[j, i] == pytest.approx(row @ pushed(loop, pulse)[6], rel=1e-12, abs=1e-15)


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
