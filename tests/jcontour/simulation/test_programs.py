import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.arrays import placed
from jcontour.controller import Wrapper
from jcontour.controllers import ContouringLQ, LQWeights, PreviewLQ, RiccatiTerminal
from jcontour.geometry.contours import circle
from jcontour.linear.plant import AffinePlan
from jcontour.motion.references import along
from jcontour.plants import bridgeport
from jcontour.plants.wrappers.saturation import Saturated
from jcontour.simulation import programs
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.programs import run_program

WEIGHTS = LQWeights(0.25, 15.0, 2e-9)


def program(steps, preview):
    return along(circle(1e-3), 2.5e-5 * np.arange(steps), bridgeport().dt, preview, at_rest=True)


CONTROLLERS = {
    "contouring": lambda: ContouringLQ(bridgeport(), WEIGHTS, 6),
    "with a terminal cost": lambda: ContouringLQ(bridgeport(), WEIGHTS, 5, RiccatiTerminal()),
    "preview": lambda: PreviewLQ(bridgeport(), 1.0, 2e-9, 6),
}


@pytest.mark.parametrize(
    "controller",
    [
        "contouring",
        pytest.param("preview", marks=pytest.mark.slow),
        pytest.param("with a terminal cost", marks=pytest.mark.slow),
    ],
)
def test_equals_one_long_run(controller):
    controller, reference = CONTROLLERS[controller](), program(50, 6)
    signals, rollout = (
        run_program(bridgeport(), controller, reference, 16),
        simulate(bridgeport(), controller, reference),
    )
    for one, other in ((signals.output, rollout.output), (signals.control, rollout.control)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * float(np.max(np.abs(other))))


@pytest.mark.parametrize("gpu", [False, True])
def test_closed_loop_is_the_recursion(monkeypatch, two_axes, gpu):
    monkeypatch.setattr(programs, "on_gpu", lambda: gpu)
    random = np.random.default_rng(3)
    F, f, x = (
        0.1 * random.standard_normal((33, 2, 4)),
        random.standard_normal((33, 2)),
        random.standard_normal(4),
    )
    states, last = jax.device_get(
        jax.jit(programs.closed_loop)(two_axes, AffinePlan(placed(F), placed(f)), x)
    )
    A, B = np.asarray(two_axes.A), np.asarray(two_axes.B)
    for k in range(33):
        np.testing.assert_allclose(states[k], x, rtol=1e-11, atol=1e-12)
        x = A @ x + B @ (f[k] - F[k] @ x)
    np.testing.assert_allclose(last, x, rtol=1e-11, atol=1e-12)


@pytest.mark.slow
def test_the_gradient_crosses_the_seams_of_chunks():
    reference = program(20, 3)

    def value(run):
        def scalar(beta):
            signals = run(
                bridgeport(), ContouringLQ(bridgeport(), LQWeights(0.25, beta, 2e-9), 3), reference
            )
            return 1e6 * jnp.sum(signals.output**2) + jnp.sum(signals.control**2)

        return jax.jit(jax.grad(scalar), compiler_options={"xla_backend_optimization_level": 0})(
            15.0
        )

    np.testing.assert_allclose(value(lambda *run: run_program(*run, 7)), value(simulate), rtol=1e-9)


@pytest.mark.slow
def test_memory_is_that_of_a_chunk():
    def scratch(steps):
        """Bytes besides the samples, which come as arguments, and the signals."""
        reference = program(steps, 6)
        arrays, rest = eqx.partition(reference, eqx.is_array)
        run = jax.jit(
            lambda arrays: run_program(
                bridgeport(), CONTROLLERS["contouring"](), eqx.combine(arrays, rest), 256
            )
        )
        return run.lower(arrays).compile().memory_analysis().temp_size_in_bytes

    signals = (
        8 * 8 * (2**14 - 2**11)
    )  # position and tangent padded to whole chunks, outputs and controls: 2 numbers each
    plan = 8 * (2 * 8 + 2) * (2**14 - 2**11)
    grown = scratch(2**14) - scratch(2**11)
    assert grown <= 1.5 * signals < plan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"chunk": 0}, "chunk: needs at least one step, received 0"),
        (
            {"plant": Saturated(bridgeport(), np.ones(2))},
            "plant: a long program needs a LinearPlant, received Saturated",
        ),
        ({"reference": program(5, 2)}, "preview: the controller looks 6 samples ahead"),
    ],
)
def test_what_does_not_go(any_type, change, message):
    arguments = {
        "plant": bridgeport(),
        "controller": CONTROLLERS["contouring"](),
        "reference": program(5, 6),
        "chunk": 4,
    }
    with pytest.raises(ValueError, match=message):
        run_program(**(arguments | change))


class Counting(Wrapper):
    """The controller inside, with a memory of how often it was asked."""

    controller: ContouringLQ

    def initial_memory(self, reference):
        return jnp.zeros(())

    def step(self, memory, plan, measurement):
        return memory + 1, self.controller.step(None, plan, measurement)[1]


def test_a_controller_with_a_memory_is_refused():
    with pytest.raises(
        ValueError, match="controller: a long program needs gains alone, Counting makes more"
    ):
        run_program(bridgeport(), Counting(CONTROLLERS["contouring"]()), program(5, 6), 4)
