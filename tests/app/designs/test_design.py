"""Every controller of the list, as it describes itself."""

import warnings

import pytest

from jcontour.app.catalogue.choices import UnreadFlagWarning, design_for
from jcontour.app.catalogue.entries import CONTROLLERS, MACHINES
from jcontour.app.flags.loops import Simulate
from tests.plants import first_machine

FIXED = {  # chosen, not tuned
    "repetitive": {"period"},
    "adaptive-robust": {"load"},
    "predictive-repetitive": {"rho", "period"},
    "run-out": {"frequency"},
}
# an inverse looks as far as its model, of 16 samples, or the preview beyond: 7, or its delays
PREVIEWS = {"gantry-zpetc": 18, "gantry-optimal-feedforward": 23, "gantry-offset-free-lq": 7}


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_weights_begin_where_the_tuner_may_go_and_have_units(name):
    machine = MACHINES[first_machine(name)]()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnreadFlagWarning)
        design = design_for(machine, Simulate(controller=name, preview=7))
    design.check_start()
    assert list(design.units()) == list(design.space) == list(design.start)
    if name in FIXED:
        assert set(design.start) - set(design.free()) == FIXED[name]
    assert len(design.weight_lines(design.start)) >= len(design.start)
    assert design.preview == design.build(design.start).preview
    assert design.preview == PREVIEWS.get(name, design.preview)


@pytest.mark.parametrize(
    ("name", "machine", "needs"),
    [
        ("cascade-leso", "bridgeport", "a flexible axis; bridgeport takes contouring-lq"),
        ("contouring-lq-state", "flexible-axis", "a machine given by A, B, C; flexible-axis takes"),
        ("gantry-cascade", "bridgeport", "a gantry; bridgeport takes contouring-lq"),
        ("cascade-notch", "gantry", "a flexible axis; gantry takes gantry-offset-free-lq"),
        ("gantry-friction-cascade", "gantry", "a gantry with dry friction; gantry takes"),
        ("gantry-self-tuning", "gantry-friction", "a gantry without dry friction"),
        ("task-frame", "flexible-axis", "two flexible axes or more, for a contour; flexible-axis"),
    ],
)
def test_other_machines_are_refused(name, machine, needs):
    with pytest.raises(ValueError, match=f"{name} needs {needs}"):
        design_for(MACHINES[machine](), Simulate(controller=name))
