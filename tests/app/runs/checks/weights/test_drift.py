"""An offset of the tool dies out as the poles say that it belongs to."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.runs.checks.weights.drift import offset_lasts
from jcontour.controller import Controller
from jcontour.geometry.contours import circle
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along

ROWS = 200


class SlowIntegral(Controller):
    """u = K (r - y) + w, w grows by k_i (r - y): pole of about 1 - k_i / K beside a zero there."""

    gain: jax.Array
    integral: float
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return jnp.zeros(2)

    def step(self, memory, plan, measurement):
        error = plan - measurement
        return memory + self.integral * error, self.gain * error + memory


@pytest.fixture(scope="module")
def path():
    return along(circle(1e-3), 1e-5 * np.arange(ROWS + 1), 1e-3, 0, at_rest=False)


@pytest.fixture(scope="module")
def plant():
    return LinearPlant(np.eye(2), np.eye(2), np.eye(2), 1e-3)


@pytest.mark.parametrize("gain", [1e-2, 1e-3, 1e-7])
def test_a_gain_takes_the_tool_back_by_its_pole(plant, proportional, path, gain):
    """Of two axes the slower: y(k+1) = (1 - K) y(k), a third is left after -1 / ln(1 - K)."""
    found = offset_lasts(plant, proportional(jnp.array([0.5, gain])), path)
    assert found == pytest.approx(-1 / np.log1p(-gain), rel=1e-6)


def test_a_slow_integral_is_no_drift(plant, path):
    """The poles are the roots of (z - 1)^2 + K (z - 1) + k_i: one lasts 50,000 samples."""
    gain, integral = 0.5, 1e-5
    slow = np.roots([1.0, gain - 2.0, 1.0 - gain + integral]).max()
    assert -1 / np.log(slow) > 4e4
    # what is left of the offset is the residue of that mode, (z - 1) / ((z - p) (z - q))
    share = (slow - 1) / (2 * slow - 2 + gain)
    wanted = -path.steps / np.log(abs(share) * slow**path.steps)
    found = offset_lasts(plant, SlowIntegral(jnp.full(2, gain), integral), path)
    assert found == pytest.approx(wanted, rel=1e-3) and found < 20


def test_without_feedback_nothing_dies_out(plant, proportional, path):
    assert offset_lasts(plant, proportional(jnp.array([0.5, 0.0])), path) == np.inf
