"""Nominal runs against one least-squares problem over the whole run."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.linear.plant import LinearPlant
from jcontour.motion import references
from jcontour.mpc.bounded.nominal_runs import nominal_run

DT = 0.01


@pytest.fixture(scope="module")
def slide():
    """1 kg with viscous friction of 3 N s/m; a force moves it within the sample too."""
    return LinearPlant([[1, DT], [0, 1 - 3 * DT]], [[DT**2 / 2], [DT]], [[1, 0]], DT)


def reference_of(samples, increment=0.0):
    path = contours.polyline([[-1.0], [1.0]])
    tangent = np.ones((len(samples), 1))
    found = references.from_samples(samples[:, None], tangent, DT, 1, contour=path, in_motion=False)
    assert increment == 0.0
    return found


def test_it_is_the_optimum_of_the_whole_run(slide):
    """80 samples, and 200 more at the end's value: nothing more comes of those beyond them."""
    generator = np.random.default_rng(0)
    samples = 1e-3 * np.cumsum(generator.normal(size=80))
    samples -= samples[0]
    length, size = 2e-4, 1.5
    run = nominal_run(slide, reference_of(samples), length, size)
    held = np.append(samples, np.full(200, samples[-1]))
    S, A, B = len(held), np.asarray(slide.A), np.asarray(slide.B)[:, 0]
    outputs, column = np.zeros((S, S)), B
    impulse = []
    for _ in range(S):
        impulse.append(column[0])
        column = A @ column
    for k in range(1, S):
        outputs[k, :k] = impulse[:k][::-1]
    changes = np.eye(S) - np.eye(S, k=-1)
    rows = np.concatenate([outputs / length, changes / size])
    best = np.linalg.lstsq(rows, np.concatenate([held / length, np.zeros(S)]), rcond=None)[0]
    np.testing.assert_allclose(run.control[:, 0], best[:80], atol=1e-6 * np.abs(best).max())


def test_it_is_a_motion_of_the_model(slide):
    run = nominal_run(slide, reference_of(1e-3 * np.sin(np.arange(50) / 7)), 1e-5, 1.0)
    after = run.state[:-1] @ np.asarray(slide.A).T + run.control @ np.asarray(slide.B).T
    np.testing.assert_allclose(run.state[1:], after, atol=1e-15)
    assert run.state.shape == (51, 2) and run.control.shape == (50, 1)


def test_a_ramp_needs_no_change_of_the_control(slide):
    path = contours.polyline([[0.0], [1.0]])
    arc = 1e-3 * np.arange(60)
    reference = references.along(path, arc, DT, preview=5, at_rest=False)
    run = nominal_run(slide, reference, 1e-5, 1.0)
    inside = slice(0, 30)  # beyond, it prepares for the end of what it knows
    error = run.state[:-1, 0] - np.asarray(reference.position)[:, 0]
    assert np.abs(error[inside]).max() < 1e-9
    assert run.control[:10, 0] == pytest.approx(np.full(10, 3 * 0.1 / (1 + 1.5 * DT)), rel=1e-6)


def test_sizes_below_zero_are_refused(slide):
    with pytest.raises(ValueError, match="length, size: need to be above zero"):
        nominal_run(slide, reference_of(np.zeros(5)), 0.0, 1.0)
    with pytest.raises(ValueError, match="length, size: need to be above zero"):
        nominal_run(slide, reference_of(np.zeros(5)), 1.0, [-1.0])
