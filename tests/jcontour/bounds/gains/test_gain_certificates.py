"""Certificates for all gains of a box: members stay below, a corner comes close."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.bounds.certificates import certificate
from jcontour.bounds.disturbed_loop import Box, UnstableLoop
from jcontour.bounds.gains import gain_certificates
from jcontour.bounds.gains.gain_cells import CellPeaks, GainCell
from jcontour.bounds.gains.gain_certificates import ENOUGH, gain_certificate
from jcontour.motion.references import along
from jcontour.plants.actuation import Gained
from jcontour.plants.delays import Delayed
from jcontour.plants.encoders import Encoders
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import contour_error

BOX = Box.of([0.02, 0.02], [4e-7, 4e-7], inputs=2, measured=2)


class OneLap:
    """One lap of the reference circle, one sample late."""

    def __init__(self, circle):
        lap = circle.numbers["lap_samples"]
        arc = np.arange(lap) * float(circle.path.length) / lap
        self.model, preview = circle.model, circle.numbers["preview"]
        self.reference = along(circle.path, arc, self.model.dt, preview, at_rest=False)
        self.controller = circle.controller(1.165, 9.34, 2e-9)

    def plant(self, gains=(1.0, 1.0)):
        late = Delayed(self.model, jnp.asarray(1), 2, 2)
        return Encoders(Gained(late, jnp.asarray(gains)))

    def of(self, low, high, cells):
        cell = GainCell(np.full(2, low), np.full(2, high))
        return gain_certificate(
            self.plant(), self.controller, self.reference, BOX, cell, cells=cells
        )


@pytest.fixture(scope="module")
def lap(reference_circle):
    return OneLap(reference_circle)


@pytest.mark.slow
def test_gains_of_ten_per_cent_cost_two_per_cent_over_the_members(lap):
    found = lap.of(0.9, 1.1, 16)
    random = np.random.default_rng(3)
    corners = [(a, b) for a in (0.9, 1.0, 1.1) for b in (0.9, 1.0, 1.1)]
    members = []
    for gains in [*corners, *random.uniform(0.9, 1.1, (8, 2)).tolist()]:
        member = certificate(lap.plant(gains), lap.controller, lap.reference, BOX)
        assert np.all(member.control <= found.whole.control)
        members.append(member.largest)
    assert max(members) <= found.whole.largest <= 1.02 * max(members)
    assert found.between <= ENOUGH * found.whole.largest
    plant, at = lap.plant(found.gains), found.whole.worst
    reached = max(
        np.linalg.norm(
            contour_error(
                simulate(attack.on(plant), lap.controller, lap.reference).output, lap.reference
            )[at]
        )
        for attack in found.whole.attacks()
    )
    assert 0.97 * found.whole.largest < reached <= found.whole.largest


@pytest.mark.slow
def test_gains_without_a_width_are_one_member(lap):
    found = lap.of(1.1, 1.1, 16)
    member = certificate(lap.plant((1.1, 1.1)), lap.controller, lap.reference, BOX)
    assert len(found.cells) == 1 and found.between == 0.0
    assert found.whole.largest == pytest.approx(member.largest, rel=1e-9)
    assert found.whole.control == pytest.approx(member.control, rel=1e-9)


@pytest.mark.slow
def test_bad_gains_and_too_few_cells_are_told(lap):
    with pytest.raises(ValueError, match=r"too wide for 1 cells; it takes about \d+"):
        lap.of(0.3, 1.4, 1)
    with pytest.raises(UnstableLoop, match=r"gains \[.*\]: .* spectral radius"):
        lap.of(0.5, 9.0, 1)
    with pytest.raises(ValueError, match="gains: needs 0 < low <= high"):
        lap.of(1.2, 0.9, 1)
    with pytest.raises(ValueError, match="cells: needs at least one, received 0"):
        lap.of(0.9, 1.1, 0)
    with pytest.raises(ValueError, match="gains: needs an interval for each of 2 controls"):
        narrow = GainCell(np.ones(1), np.ones(1))
        gain_certificate(lap.plant(), lap.controller, lap.reference, BOX, narrow)


@pytest.mark.slow
def test_a_bound_that_is_not_a_number_is_told(lap, monkeypatch):
    """In the last cell: a largest one is looked for from the first."""
    cells = iter([1.0, 1.0, np.nan])

    def peaks(loop, *_):
        tool = np.full((len(loop.C), 2), 1e-6 * next(cells))
        return CellPeaks(tool[None], tool, np.zeros(loop.control.shape))

    monkeypatch.setattr(gain_certificates, "cell_peaks", peaks)
    with pytest.raises(ValueError, match=r"gains \[1.0, .* to .*: the bound .* is not a number"):
        lap.of(0.9, 1.1, 2)
