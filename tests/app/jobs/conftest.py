"""Checks of a run that any test of jobs may need."""

import numpy as np
import pytest

from jcontour.app.jobs.stretches import corner_angles

PREVIEW = 10


def _moves_within(job, machine, speed, acceleration):
    """Speeds and accelerations by differences; at corners, where the velocity jumps, speeds only.

    Limits [m/s], [m/s^2] are None where there are none.
    """
    dt = machine.model.dt
    reference = job.reference(dt, PREVIEW)
    assert reference.steps == job.steps
    assert reference.position.shape == (job.steps + PREVIEW, machine.model.axes)
    position = np.asarray(reference.position)
    assert np.isfinite(position).all()
    assert np.asarray(reference.mask)[: job.samples].any()
    np.testing.assert_allclose(np.linalg.norm(reference.tangent, axis=1), 1.0, rtol=1e-9)
    velocity = np.diff(position[: job.samples], axis=0) / dt
    if speed is not None:
        assert np.abs(velocity).max() <= speed * (1 + 1e-5)  # splines are fitted to 0.1 nm
    passed = _corners_passed(job)
    if acceleration is not None:
        needed = np.abs(np.diff(velocity, axis=0)[~passed]) / dt
        assert needed.max() <= acceleration * 1.02  # a feed law's nodes, and starts within a sample
    return np.linalg.norm(velocity, axis=1)


def _corners_passed(job):
    """Whether a corner lies between the first and the last of every three samples."""
    contour = job.contour
    turned = corner_angles(contour)
    starts = np.asarray(contour.start)
    corners = np.roll(starts, -1)[: turned.size][turned > 1e-6]
    if bool(contour.closed):
        corners = np.concatenate([corners + lap * float(contour.length) for lap in range(4)])
    before = np.searchsorted(corners, job.arc[:-2], side="left")
    after = np.searchsorted(corners, job.arc[2:], side="right")
    return after > before


@pytest.fixture(scope="session")
def moves_within():
    """(job, machine, speed, acceleration) -> path speed (T - 1,) [m/s]; fails beyond a limit."""
    return _moves_within
