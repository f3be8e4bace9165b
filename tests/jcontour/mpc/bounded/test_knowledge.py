"""What is known of a state: the bound of a filter against the peak of its whole loop."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.linear.plant import LinearPlant
from jcontour.mpc.bounded.knowledge import state_bounded_by_filter, state_known
from jcontour.sets.disturbed_model import DisturbedModel
from jcontour.sets.least_peaks import least_peak

DT = 1e-2
COUNT = 1e-6


@pytest.fixture(scope="module")
def slide():
    """A mass of 1 kg, its force in N."""
    return LinearPlant([[1, DT], [0, 1]], [[DT**2 / 2], [DT]], [[1.0, 0.0]], dt=DT)


@pytest.fixture(scope="module")
def gain(slide):
    A, C = np.asarray(slide.A), np.asarray(slide.C)
    B = np.asarray(slide.B)
    P = solve_discrete_are(A.T, C.T, B @ B.T, [[COUNT**2]])
    return P @ C.T / (C @ P @ C.T + COUNT**2)


def test_a_measured_state_misses_nothing_but_what_a_force_adds_to_a_speed(slide):
    known = state_known(slide, 3.0)
    np.testing.assert_allclose(known.E, 3.0 * np.asarray(slide.B))
    assert known.tool == 0 and known.speed == pytest.approx(3.0 * DT / 2)


def test_the_filter_gives_a_bound_that_is_kept_and_not_the_least(slide, gain):
    """The peak of the whole loop, filter and responses, from its impulses: l1 norm of each."""
    known = state_bounded_by_filter(slide, gain, 1.0, COUNT)
    model = DisturbedModel.of(slide.A, slide.B, known.E)
    small = model.state_signals(["tool"], slide.C)
    found = least_peak(model, small, model.control_signals(4.0), 10)
    promised = found.tolerance + known.tool[0]
    largest = known.E[0, 0] / gain[0, 0]
    response = found.response.state[:, 0, 0]  # tool, for an innovation of that size
    A, B, C = (np.asarray(matrix) for matrix in (slide.A, slide.B, slide.C))
    peak = 0.0
    for force, error in ((1.0, 0.0), (0.0, COUNT)):
        e, innovations, left = B[:, 0] * force, [], []
        for sample in range(400):
            noise = error if sample == 0 else 0.0
            innovations.append((C @ e)[0] + noise)
            after = e - gain[:, 0] * innovations[-1]
            left.append((C @ after)[0])
            e = A @ after
        tool = np.convolve(innovations, response)[:400] / largest + left
        peak += np.abs(tool).sum()
    assert 0.3 * promised < peak < 0.8 * promised


def test_numbers_that_are_no_proof_are_refused(slide, gain):
    with pytest.raises(ValueError, match="encoder: needs an error of at least zero"):
        state_bounded_by_filter(slide, gain, 1.0, -COUNT)
    with pytest.raises(ValueError, match="load: needs one number"):
        state_bounded_by_filter(slide, gain, -1.0, COUNT)
    with pytest.raises(ValueError, match=r"gain: needs finite numbers of shape \(2, 1\)"):
        state_bounded_by_filter(slide, gain[:, 0], 1.0, COUNT)
    with pytest.raises(ValueError, match="gain: .* received NaN"):
        state_bounded_by_filter(slide, gain * np.nan, 1.0, COUNT)
    with pytest.raises(ValueError, match="gain: the filter is not stable"):
        state_bounded_by_filter(slide, 0 * gain, 1.0, COUNT)


def test_every_encoder_errs_by_its_own(slide, gain):
    """Two slides that are not coupled, each as if it were alone."""
    A, B, C = (np.kron(np.eye(2), np.asarray(one)) for one in (slide.A, slide.B, slide.C))
    pair = LinearPlant(A, B, C, DT)
    both = state_bounded_by_filter(pair, np.kron(np.eye(2), gain), 1.0, np.array([COUNT, 5e-6]))
    for axis, count in enumerate((COUNT, 5e-6)):
        alone = state_bounded_by_filter(slide, gain, 1.0, count)
        part = slice(2 * axis, 2 * axis + 2)
        np.testing.assert_allclose(both.E[part, axis], alone.E[:, 0], rtol=1e-9)
        assert both.tool[axis] == pytest.approx(alone.tool.item(), rel=1e-9)
        assert both.speed[axis] == pytest.approx(alone.speed.item(), rel=1e-9)
    with pytest.raises(ValueError, match="encoder: needs an error of at least zero"):
        state_bounded_by_filter(pair, np.kron(np.eye(2), gain), 1.0, np.array([COUNT, -COUNT]))
