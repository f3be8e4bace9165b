import jax
import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal
from jcontour.controllers.lq.scheduled_lq import BlockwiseLQ
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import simulate

WEIGHTS = LQWeights(0.7, 3.0, 0.2)


def arc(steps, preview, plant):
    return along(circle(1e-2), 2e-4 * np.arange(steps), plant.dt, preview, at_rest=False)


def least_squares_controls(model, reference, x):
    """All controls of a run at once, by the stacked cost over the whole of the reference."""
    A, B, C = (np.asarray(M) for M in (model.A, model.B, model.C))
    y_d, r = np.asarray(reference.position), np.asarray(reference.tangent)
    alpha, beta, rho = (float(w) for w in (WEIGHTS.alpha, WEIGHTS.beta, WEIGHTS.rho))
    count, p = len(y_d) - 1, B.shape[1]
    free, forced, rows, wanted = x, np.zeros((len(A), count * p)), [], []
    for j in range(1, count + 1):
        free, forced = A @ free, A @ forced
        forced[:, (j - 1) * p : j * p] += B
        across = np.sqrt(beta) * (np.eye(2) - np.outer(r[j], r[j]))
        for root in (np.sqrt(alpha) * np.eye(2), across):
            rows.append(root @ C @ forced)
            wanted.append(root @ (y_d[j] - C @ free))
    rows.append(np.sqrt(rho) * np.eye(count * p))
    wanted.append(np.zeros(count * p))
    found = np.linalg.lstsq(np.vstack(rows), np.concatenate(wanted), rcond=None)[0]
    return found.reshape(count, p)


def test_a_run_of_one_block_is_the_optimum_of_the_whole_path(two_axes):
    reference = arc(6, 8, two_axes)
    found = simulate(two_axes, BlockwiseLQ(two_axes, WEIGHTS, 8), reference)
    wanted = least_squares_controls(two_axes, reference, np.asarray(found.state)[0])
    np.testing.assert_allclose(found.control, wanted[:6], rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_a_terminal_of_ones_own_reaches_every_block(two_axes):
    """The last step of every block sees N_p samples, as a receding horizon does."""
    reference = arc(7, 3, two_axes)
    plans = [
        law(two_axes, WEIGHTS, 3, RiccatiTerminal()).prepare(reference)
        for law in (BlockwiseLQ, ContouringLQ)
    ]
    for found, wanted in zip(*map(jax.tree.leaves, plans), strict=True):
        np.testing.assert_allclose(found[::3], wanted[::3], rtol=1e-10, atol=1e-12)
        assert np.abs(found[1] - wanted[1]).max() > 1e-3 * np.abs(wanted[1]).max()


def test_a_stage_profile_is_refused(two_axes):
    with pytest.raises(ValueError, match="stage: .*no stage profile"):
        BlockwiseLQ(two_axes, LQWeights(0.7, 3.0, 0.2, [1.0, 1.0]), 2)
