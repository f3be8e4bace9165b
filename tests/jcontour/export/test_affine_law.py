import numpy as np
import pytest

from jcontour.export.affine_law import AffineLaw
from jcontour.export.drive_law import DriveLaw, replayed


@pytest.fixture
def affine(law_and_plan):
    law, plan = law_and_plan
    random = np.random.default_rng(4)
    n, p, q = law.states, law.inputs, law.measured
    F = np.zeros((40, p, n)) if plan.F is None else plan.F[plan.used]
    D = np.zeros((40, p, q)) if plan.D is None else plan.D[plan.used]
    start, w = random.normal(size=n), random.normal(size=(40, n))
    return AffineLaw(law, start, F, D, plan.f, w)


def test_a_drive_gives_the_same_controls_about_any_planned_run(affine):
    """A change of coordinates changes no control: on the plan, off it, and at the limits."""
    random = np.random.default_rng(5)
    planned, other = random.normal(size=(2, 40, affine.law.measured))
    plan = affine.plan_along(planned)
    for y in (planned, other):
        exact = affine.run(y)[1]
        assert np.abs(replayed(affine.law, plan, y) - exact).max() < 1e-12 * np.abs(exact).max()


def test_the_memory_obeys_its_own_equations(affine):
    """The next memory and the control, by the sums of the module's head."""
    law, y = affine.law, np.random.default_rng(6).normal(size=(40, affine.law.measured))
    x, u = affine.run(y)
    control = affine.f - (affine.F @ x[:, :, None] + affine.D @ y[:, :, None])[:, :, 0]
    assert u == pytest.approx(np.clip(control, -law.limit, law.limit), abs=1e-12)
    after = affine.w.copy()
    for matrix, signal in ((law.A, x), (law.B, u), (law.E, y)):
        after += 0.0 if matrix is None else signal @ matrix.T
    if law.correction is not None:
        L, C = law.correction.L, law.correction.C
        after[:-1] += (y[1:] - after[:-1] @ C.T) @ L.T
    if law.kept is not None:
        assert (np.abs(after) > law.kept).any()
        after = np.clip(after, -law.kept, law.kept)
    assert x[1:] == pytest.approx(after[:-1], abs=1e-12)


def test_large_terms_that_cancel_keep_their_digits_in_single_precision():
    """f = 1e5 against F x = 1e5, the control is 1: about the planned run nothing cancels."""
    law = DriveLaw(
        dt=1e-3,
        names=("integral",),
        measured=1,
        inputs=1,
        correction=None,
        A=np.eye(1),
        B=None,
        E=None,
        limit=np.full(1, np.inf),
    )
    steps = 20
    D = np.full((steps, 1, 1), 5e5)  # per metre
    y = np.linspace(0.1, 0.3, steps)[:, None]  # [m]
    f = 5e5 * y + 1.0
    none = np.zeros((steps, 1, 1)), np.zeros((steps, 1))
    affine = AffineLaw(law, np.zeros(1), none[0], D, f, none[1])
    moved = y + 1e-6
    exact = affine.run(moved)[1]
    assert exact == pytest.approx(0.5, abs=1e-9)
    about = replayed(law, affine.plan_along(y), moved, np.float32)
    assert np.abs(about - exact).max() < 2.0 * 5e5 * np.spacing(np.float32(0.3))  # of y itself
