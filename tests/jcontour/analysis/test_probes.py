import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour.analysis.sensitivity import probe_windows
from jcontour.geometry.contours import circle, ellipse, polygon
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_references


def square(side):
    """Square from the origin [m]."""
    return polygon(side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))


@pytest.fixture
def probed(samples_of):
    """(references, count) -> samples of the probes, contour by contour."""

    def of(references, count):
        windows = jax.device_get(probe_windows(stack_references(references), count))
        kept = np.split(np.arange(len(windows.arc)), len(references))
        every = [jax.tree.map(lambda leaf, rows=rows: leaf[rows], windows) for rows in kept]
        return [samples_of(one, run) for one, run in zip(every, references, strict=True)]

    return of


def test_probes_are_ends_corners_and_all_directions(probed):
    """The third sample of every side is its first behind a corner."""
    run = along(square(1e-3), 1e-4 * np.arange(38), 1e-3, 3, at_rest=False)
    (samples,) = probed([run], 8)
    assert np.unique(samples).size == 8 and {0, 37} <= set(samples)
    corners = [k for k in samples if min((k + 1) % 10, (k - 1) % 10, k % 10) == 0]
    assert corners
    tangents = np.asarray(run.tangent)[samples]
    assert (np.abs(tangents) > 0.99).any(axis=0).all()  # along both axes


def test_probes_of_a_circle_look_everywhere(probed):
    run = along(circle(1e-3), 2e-5 * np.arange(314), 1e-3, 5, at_rest=False)
    (samples,) = probed([run], 8)
    gaps = np.diff(np.append(samples, samples[0] + 314))
    assert gaps.max() < 2.5 * 314 / 8


def test_the_sharpest_bend_is_probed(probed):
    """The ends of the long axis of a slim ellipse."""
    run = along(ellipse(5e-3, 5e-4), 1e-5 * np.arange(2000), 1e-3, 5, at_rest=False)
    (samples,) = probed([run], 1)
    assert np.abs(np.asarray(run.position)[samples, 1]).max() < 1e-5


def test_windows_start_in_the_motion_of_their_sample_and_see_its_future(probed):
    runs = [
        along(square(1e-3), 1e-4 * np.arange(38), 1e-3, 3, at_rest=True),
        along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False),
    ]
    windows = jax.device_get(probe_windows(stack_references(runs), 4))
    assert windows.steps == 1 and windows.preview == 3 and windows.position.shape == (8, 4, 2)
    assert np.asarray(windows.mask).tolist() == [[True, False, False, False]] * 8
    lengths = np.asarray(windows.contour.length)
    for k, samples in enumerate(probed(runs, 4)):
        position, tangent = np.asarray(runs[k].position), np.asarray(runs[k].tangent)
        for row, sample in zip(range(4 * k, 4 * k + 4), samples, strict=True):
            future = slice(sample, sample + 4)
            np.testing.assert_allclose(windows.position[row], position[future])
            np.testing.assert_allclose(windows.tangent[row], tangent[future])
            before = position[sample] - position[sample - 1]
            entered = before if sample else np.asarray(runs[k].start_increment)
            np.testing.assert_allclose(windows.start_increment[row], entered)
            length = lengths[row]
            assert length == pytest.approx(float(runs[k].contour.length))


def test_what_is_not_scored_is_not_probed_and_few_samples_repeat(probed):
    scored = (np.arange(38) == 7) | (np.arange(38) == 20)
    run = along(square(1e-3), 1e-4 * np.arange(38), 1e-3, 3, at_rest=False, scored=scored)
    (samples,) = probed([run], 5)
    assert samples.size == 5 and set(samples) == {7, 20}


def test_bad_input_is_refused():
    bent = along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False)
    with pytest.raises(ValueError, match="count"):
        probe_windows(stack_references([bent]), 0)
    nothing = eqx.tree_at(lambda r: r.mask, bent, np.zeros_like(bent.mask))
    with pytest.raises(ValueError, match="number 1: .*no scored sample"):
        probe_windows(stack_references([bent, nothing]), 2)
