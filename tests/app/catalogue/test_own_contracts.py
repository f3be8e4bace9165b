"""What a plant or controller of the user's may return, and how the rest is told."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.own_contracts import ContractError, check_controller, check_plant
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import simulate
from tests.small_loops import OnPositions


class Carriages(Plant):
    """Two masses of 1 kg; the state begins as `make` says."""

    make: Callable = eqx.field(static=True, default=lambda position, speed: (position, speed))
    seen: Callable = eqx.field(static=True, default=lambda state: state[0])
    dt: float = eqx.field(static=True, default=1e-3)

    def initial_state(self, position, increment):
        return self.make(position, increment / self.dt)

    def step(self, state, control):
        position, speed = state[0], state[1].astype(float)
        return position + self.dt * speed, speed + self.dt * control

    def output(self, state):
        return self.seen(state)

    def measure(self, state):
        return state[0]


class Told(OnPositions):
    """A controller whose memory and step are given."""

    begin: Callable = eqx.field(static=True)
    then: Callable = eqx.field(static=True)

    def initial_memory(self, reference):
        return self.begin()

    def step(self, memory, plan, measurement):
        return self.then(memory, plan - measurement)


@pytest.fixture(scope="module")
def reference():
    path = line(np.zeros(2), np.full(2, 1e-3))
    return along(path, np.linspace(0.0, float(path.length), 4), 1e-3, 0, at_rest=False)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"seen": lambda state: jnp.ones(3)}, r"output needs shape \(2,\), received \(3,\); a"),
        ({"seen": lambda state: state}, r"output needs shape .*received \(\(2,\), \(2,\)\)"),
        ({"make": lambda p, v: (p, jnp.zeros(2, int))}, r"^state\[1\] changes from int64 to fl"),
        ({"make": lambda p, v: (p, v[:1])}, r"^state\[1\] changes from shape \(1,\) to \(2,\) "),
        ({"make": lambda p, v: [p, v]}, r"^state changes from \[.*\] to \(\(2,\), \(2,\)\) in s"),
    ],
)
def test_what_a_plant_may_not_return_is_told(changed, says):
    with pytest.raises(ContractError, match=says):
        check_plant(Carriages(**changed), 2)


def test_a_plant_that_keeps_its_state_passes():
    for axes in (1, 2, 3):
        check_plant(Carriages(), axes)


@pytest.mark.parametrize(
    ("begin", "then", "says"),
    [
        (
            lambda: None,
            lambda m, e: (m, jnp.ones(3)),
            r"step: the control needs shape \(2,\), received \(",
        ),
        (
            lambda: None,
            lambda m, e: (m, e[0]),
            r"step: the control needs shape \(2,\), received \(\)",
        ),
        (
            lambda: None,
            lambda m, e: (m, None),
            r"step: the control needs shape \(2,\), received None",
        ),
        (lambda: None, lambda m, e: (e, m), "received the two swapped"),
        (lambda: 0.0, lambda m, e: (e, m), "received the two swapped"),
        (lambda: None, lambda m, e: e, r"step returns \(memory, control\), received \(2,\)"),
        (
            lambda: np.zeros(2),
            lambda m, e: (jnp.zeros(3), e),
            r"^memory changes from shape \(2,\) to \(3",
        ),
        (
            lambda: {"sum": np.zeros(2, int)},
            lambda m, e: ({"sum": m["sum"].astype(float) + e}, e),
            r"^memory\['sum'\] changes from int64 to float64 in step: initial_memory and step need",
        ),
        (
            lambda: None,
            lambda m, e: ((e, e), e),
            r"^memory changes from None to \(\(2,\), \(2,\)\) in step",
        ),
    ],
)
def test_what_a_controller_may_not_return_is_told(reference, begin, then, says):
    with pytest.raises(ContractError, match=says):
        check_controller(Carriages(), Told(begin, then), reference, 2)


@pytest.mark.parametrize(
    ("begin", "then"),
    [
        (lambda: None, lambda m, e: (m, e)),
        (lambda: np.zeros(2), lambda m, e: [m + e, m]),
        (
            lambda: 0,
            lambda m, e: (1.0 * m + e[0], e),
        ),  # a plain number takes the type of what is added
        (lambda: 0.0, lambda m, e: (m + 1, e)),
    ],
)
def test_what_runs_passes(reference, begin, then):
    controller = Told(begin, then)
    check_controller(Carriages(), controller, reference, 2)
    assert simulate(Carriages(), controller, reference).control.shape == (reference.steps, 2)
