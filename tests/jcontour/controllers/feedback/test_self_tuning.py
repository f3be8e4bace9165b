"""The self-tuning servo against reference numbers and against its polynomial."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.self_tuning import SelfTuning, placed_gains
from jcontour.geometry.contours import line
from jcontour.motion.references import from_samples
from jcontour.plant import Plant
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate

DATA = Path(__file__).parents[3] / "data" / "adaptive" / "companions.json"
COMPANIONS = json.loads(DATA.read_text())


class DiskArm(Plant):
    """y(k) = 2 y(k-1) - y(k-2) + b (u(k-1) + u(k-2)); b grows by a half at sample 150."""

    dt: float = 1.0

    def initial_state(self, position, increment):
        nothing = jnp.zeros_like(position)
        return position, position, nothing, jnp.zeros((), int)

    def step(self, state, control):
        y, before, last, k = state
        b = jnp.where(k + 1 >= 150, 0.03, 0.02)
        free = 2 * y - before + b * (control + last)
        return jnp.where(k == 0, 0.0, 1.0) * free, y, control, k + 1

    def output(self, state):
        return state[0]

    def measure(self, state):
        return state[0]


def square_wave(steps):
    wave = np.sign(np.sin(2 * np.pi * np.arange(steps) / 60 + 1e-9))[:, None]
    contour = line([-1.0], [1.0])
    return from_samples(wave, np.ones_like(wave), 1.0, 0, contour, in_motion=False)


def run(controller):
    start = (jnp.zeros(1), jnp.zeros(1), jnp.zeros(1), jnp.zeros((), int))
    return simulate(DiskArm(), controller, square_wave(300), start)


def test_estimates_are_those_of_the_reference():
    found = run(SelfTuning(0.02, 0.25, Sensors((0,)), gain=0.01))
    after = np.append(np.asarray(found.memory.gain)[1:, 0], found.final_memory.gain)
    worst = np.max(np.abs(after[250:300] / 0.03 - 1))
    np.testing.assert_allclose(
        [after[149], after[299], worst], COMPANIONS["self_tuning_gain"], rtol=1e-8
    )


@pytest.mark.parametrize("pair", [(0.9, 0.8), (0.95, 0.5), (0.85 + 0.1j, 0.85 - 0.1j)])
def test_poles_are_placed(pair):
    """On the loop itself: the response dies as the slowest pole says."""
    kp, kr = placed_gains(*pair)
    poles = np.roots([1.0, (kp + kr) / 2 - 2, 1 + kp / 2, -kr / 2])
    for pole in pair:
        assert np.min(np.abs(poles - pole)) < 1e-9
    # y(k+1) = 2 y - y1 + (w + w1)/2 with w = -kp y - kr (y - y1): states y, y1, w1
    A = np.array([[2 - (kp + kr) / 2, -1 + kr / 2, 0.5], [1.0, 0.0, 0.0], [-(kp + kr), kr, 0.0]])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A)), np.sort_complex(poles))


@pytest.mark.parametrize("pair", [(0.9, 0.9), (0.9 + 0.1j, 0.9), (0.9 + 0.1j, 0.8 - 0.1j)])
def test_poles_that_cannot_be_placed(pair):
    with pytest.raises(ValueError, match="poles: need"):
        placed_gains(*pair)


def test_bad_input():
    with pytest.raises(ValueError, match="forgetting: needs to be above zero and at most one"):
        SelfTuning(0.02, 0.25, Sensors((0,)), 0.01, forgetting=1.5)
    with pytest.raises(ValueError, match="gain: needs to be finite and at least zero"):
        SelfTuning(0.02, 0.25, Sensors((0,)), -0.01)
