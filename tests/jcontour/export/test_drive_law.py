import numpy as np
import pytest

from jcontour.export.drive_law import drive_plan, replayed


def test_the_law_is_what_its_equations_say(law_and_plan, recorded):
    """One sum for each entry, written out."""
    law, plan = law_and_plan
    y, u = recorded
    n, x = law.states, [0.0] * law.states

    def entry(matrix, i, vector):
        return 0.0 if matrix is None else sum(a * b for a, b in zip(matrix[i], vector, strict=True))

    def kept(controls):
        return [min(max(v, -most), most) for v, most in zip(controls, law.limit, strict=True)]

    for k in range(plan.steps):
        z = [y[k][i] - plan.r[k][i] for i in range(law.measured)]
        if law.correction is not None:
            miss = [z[i] - entry(law.correction.C, i, x) for i in range(law.measured)]
            x = [x[i] + entry(law.correction.L, i, miss) for i in range(n)]
        F, D = (None if one is None else one[plan.used[k]] for one in (plan.F, plan.D))
        free = [plan.f[k][i] - entry(F, i, x) - entry(D, i, z) for i in range(law.inputs)]
        control = kept(free)
        assert control == pytest.approx(list(u[k]), abs=1e-12)
        change = [a - b for a, b in zip(control, kept(plan.f[k]), strict=True)]
        x = [entry(law.A, i, x) + entry(law.B, i, change) + entry(law.E, i, z) for i in range(n)]
        for column, i in enumerate(law.clamped):
            assert law.kept is not None and plan.m is not None
            planned, most = plan.m[k][column], law.kept[i]
            x[i] = min(max(x[i] + planned, -most), most) - min(max(planned, -most), most)


def test_equal_gains_are_stored_once_in_the_order_of_the_path():
    F = np.array([3.0, 1.0, 3.0, 2.0, 1.0])[:, None, None]
    plan = drive_plan(F, np.zeros((5, 1, 1)), np.zeros((5, 1)), np.zeros((5, 1)))
    assert plan.F is not None and plan.F.ravel().tolist() == [3.0, 1.0, 2.0]
    assert plan.used.tolist() == [0, 1, 0, 2, 1]
    assert plan.D is None and plan.steps == 5
    assert plan.numbers == 5 + 3 + 5 + 5


def test_single_precision_rounds_every_number(law_and_plan, recorded):
    law, plan = law_and_plan
    y, u = recorded
    single = replayed(law, plan, y, np.float32)
    assert single.dtype == np.float32
    assert 1e-9 < np.abs(single - u).max() < 1e-4
