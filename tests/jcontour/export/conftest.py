"""A law with every term, and one with as few as there can be."""

import numpy as np
import pytest

from jcontour.export.drive_law import Correction, DriveLaw, drive_plan, replayed


def random_law(seed, n, q, p, full, sets=2, kept=()):
    """A stable law and a plan of 40 samples, of two gain sets or one for each.

    Some entries of the memory are kept within 0.3.
    """
    random = np.random.default_rng(seed)

    def matrix(*shape):
        return random.normal(size=shape)

    A = 0.2 * matrix(n, n)
    correction = Correction(0.1 * matrix(n, q), matrix(q, n)) if full else None
    law = DriveLaw(
        dt=1e-3,
        names=tuple(f"state {k}" for k in range(n)),
        measured=q,
        inputs=p,
        correction=correction,
        A=A if n else None,
        B=0.1 * matrix(n, p) if full else None,
        E=matrix(n, q) if n else None,
        limit=np.array([0.5] + [np.inf] * (p - 1)) if full else np.full(p, np.inf),
        kept=np.where(np.isin(np.arange(n), kept), 0.3, np.inf) if kept else None,
    )
    F, D = matrix(sets, p, n), matrix(sets, p, q) if full or not n else np.zeros((sets, p, q))
    rest = matrix(40, p), matrix(40, q)
    m = 0.3 * matrix(40, len(kept)) if kept else None
    used = np.array([0, 1, 0, 0] * 10) if sets == 2 else np.arange(40)
    return law, drive_plan(F[used], D[used], *rest, m)


LAWS = {
    "every term": (0, 3, 2, 2, True),
    "no memory": (1, 0, 2, 1, False),
    "few": (2, 2, 1, 1, False),
    "kept": (4, 4, 2, 2, False, 2, (1, 3)),
    "gains of every sample": (3, 2, 2, 1, True, 40),
}


@pytest.fixture(params=LAWS)
def law_and_plan(request):
    return random_law(*LAWS[request.param])


@pytest.fixture
def recorded(law_and_plan):
    """Measurements of a run and its controls."""
    law, plan = law_and_plan
    y = np.random.default_rng(9).normal(size=(plan.steps, law.measured))
    return y, replayed(law, plan, y)
