import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal
from jcontour.controllers.lq.preview_lq import PreviewLQ
from jcontour.linear.plant import SteadyMotion
from jcontour.motion.references import from_samples
from jcontour.plants.linear_machines import bridgeport
from jcontour.simulation.closed_loop import prepared

ALPHA, RHO = 3.0, 2e-9


def reference_of(preview, dt):
    angle = 0.025 * np.arange(9 + preview)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], -1)
    return from_samples(1e-3 * np.stack([np.cos(angle), np.sin(angle)], -1), tangent, dt, preview)


def check_gains(ours, theirs, reference):
    found, wanted = (prepared(law, reference) for law in (ours, theirs))
    for name in ("F", "f"):
        gains = np.asarray(getattr(wanted, name))
        np.testing.assert_allclose(
            getattr(found, name), gains, rtol=0, atol=1e-9 * np.abs(gains).max()
        )


@pytest.mark.parametrize("preview", [pytest.param(6, marks=pytest.mark.slow), 1])
def test_finite_preview_is_case_iii(preview):
    """McNab & Tsao: their law with beta = 0 and the Riccati terminal is Tomizuka & Whitney's."""
    plant = bridgeport()
    reference = reference_of(preview, plant.dt)
    theirs = ContouringLQ(plant, LQWeights(ALPHA, 0.0, RHO), preview, RiccatiTerminal())
    check_gains(PreviewLQ(plant, ALPHA, RHO, preview), theirs, reference)


def test_given_maps_serve_a_coupled_plant(coupled_plant):
    plant = coupled_plant(4, 5, 2)
    motion = SteadyMotion(*map(placed, np.random.default_rng(0).standard_normal((2, 5, 2))))
    reference = reference_of(4, plant.dt)
    theirs = ContouringLQ(plant, LQWeights(0.5, 0.0, 0.1), 4, RiccatiTerminal(motion))
    check_gains(PreviewLQ(plant, 0.5, 0.1, 4, motion), theirs, reference)


def test_a_preview_of_nothing_is_refused(two_axes):
    with pytest.raises(ValueError, match="preview: needs a whole number"):
        PreviewLQ(two_axes, 1.0, 1.0, 0)


@pytest.mark.parametrize(("alpha", "rho"), [(-1.0, 2e-9), (1.0, -5.0), (0.0, 1.0)])
def test_bad_weights_are_named(alpha, rho, coupled_plant):
    with pytest.raises(ValueError, match="alpha|rho"):
        PreviewLQ(coupled_plant(4, 5, 2), alpha, rho, 3)
