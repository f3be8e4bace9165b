"""Controllers for any machine: built on every kind, gradients of every weight."""

import warnings
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.catalogue.entries import CONTROLLERS, design_class
from jcontour.app.designs.any_machine import ANY
from jcontour.app.flags.loops import Simulate
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import simulate

NAMES = [name for name in CONTROLLERS if getattr(design_class(name), "needs", None) == ANY]
STEP = 1e-6  # of a logarithm: a larger one meets the kinks of limits and layers
STEPS = {  # of laws without kinks, whose solutions have fewer digits
    "h-infinity": 1e-4,
    "causal-inverse": 1e-3,
    "flexible-causal-inverse": 1e-3,
}
KINDS = ("xy-table", "flexible-axis", "gantry")
SUITED = {  # others, each on a machine that suits it
    "contouring-lq-zero": "xy-table",
    "cross-coupled-lq": "xy-table",
    "causal-inverse": "xy-table",
    "flexible-causal-inverse": "flexible-axis",
    "master-slave": "gantry",
}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), [*product(NAMES, KINDS), *SUITED.items()])
def test_every_weight_has_the_slope_that_differences_say(name, kind):
    """On the smooth nominal machine, from its start; the nominal loop follows its path."""
    machine = machine_named(kind)
    design = design_for(machine, Simulate(controller=name))
    assert name in SUITED or design.settings().get("terminal") is None  # they end no horizon
    plant, alone = machine.smooth_family()[0], len(machine.axes) == 1
    contour = line([0.0], [1e-2]) if alone else circle(5e-3)
    arc = 2e-5 * np.arange(200)
    path = along(contour, arc, machine.model.dt, design.preview, at_rest=False)

    @jax.jit
    def error(change):
        weights = {key: value * jnp.exp(change[key]) for key, value in design.start.items()}
        run = simulate(plant, design.build(weights), path)
        return 1e3 * jnp.sqrt(jnp.mean((run.output - path.position[: path.steps]) ** 2))

    none = {key: jnp.zeros(()) for key in design.start}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert float(error(none)) < 2.0  # half of the path: dry friction holds slow loops
    slopes = jax.jit(jax.grad(error))(none)
    size = STEPS.get(name, STEP)
    for key in design.free():
        ahead, behind = (float(error({**none, key: jnp.asarray(s * size)})) for s in (1, -1))
        wanted = (ahead - behind) / (2 * size)
        least = 5e-7 if name == "super-twisting" else 1e-7  # rounding, near its root
        assert float(slopes[key]) == pytest.approx(wanted, rel=1e-5, abs=least), key
