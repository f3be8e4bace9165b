import subprocess
import sys

import jax
import numpy as np
import pytest

from jcontour.geometry.contours import circle, ellipse
from jcontour.kernels import dispatch
from jcontour.linear.plant import Pattern
from jcontour.plants import bridgeport


@pytest.mark.slow
def test_nothing_of_pallas_is_loaded_before_it_is_needed():
    look = (
        "import sys, jcontour.simulation.evaluation, jcontour.controllers; "
        "sys.exit('jax.experimental.pallas' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", look], check=False).returncode == 0


def test_a_cpu_keeps_the_sweep_in_xla():
    plant = bridgeport()
    assert dispatch.on_gpu() == (jax.default_backend() == "gpu")
    assert dispatch.suits_lanes(plant.pattern, plant) == dispatch.on_gpu()


@pytest.mark.parametrize(
    ("types", "wanted"),
    [((float, float), True), ((float, np.float32), False), ((np.float16,), False)],
)
def test_one_type_for_all_numbers(monkeypatch, types, wanted):
    monkeypatch.setattr(dispatch, "on_gpu", lambda: True)
    assert (
        dispatch.suits_lanes(bridgeport().pattern, *(np.zeros(2, one) for one in types)) == wanted
    )


@pytest.mark.parametrize(
    ("states", "coupled", "dtype", "wanted"),
    [
        (8, True, float, True),
        (9, False, float, True),
        (10, False, float, False),
        (13, False, np.float32, True),
        (12, True, np.float32, False),
    ],
)
def test_a_plant_that_would_unroll_too_far_is_left_to_xla(
    monkeypatch, states, coupled, dtype, wanted
):
    monkeypatch.setattr(dispatch, "on_gpu", lambda: True)
    A = np.ones((states, states)) if coupled else np.eye(states)
    assert (
        dispatch.suits_lanes(
            Pattern.of(A, np.ones((states, 3)), np.ones((3, states))), np.zeros(1, dtype)
        )
        == wanted
    )


def axes_of(states: int, axes: int) -> Pattern:
    """Decoupled axes with so many states each."""
    one = np.eye(axes)
    blocks = np.kron(one, np.ones((states, states)))
    return Pattern.of(blocks, np.kron(one, np.ones((states, 1))), np.kron(one, np.ones(states)))


@pytest.mark.parametrize(
    ("pattern", "preview", "wanted"),
    [
        (axes_of(4, 3), 10, True),
        (axes_of(8, 2), 10, True),
        (axes_of(4, 2), 10, False),  # the sweep's kernels take it
        (axes_of(4, 3), 11, False),
        (axes_of(9, 2), 10, False),
        (Pattern.of(np.eye(12), np.ones((12, 3)), np.ones((3, 12))), 10, False),  # coupled
    ],
)
def test_large_machines_of_decoupled_axes_have_kernels_of_their_own(
    monkeypatch, pattern, preview, wanted
):
    assert not dispatch.suits_rank_one(pattern, preview, np.zeros(1)) or dispatch.on_gpu()
    monkeypatch.setattr(dispatch, "on_gpu", lambda: True)
    assert dispatch.suits_rank_one(pattern, preview, np.zeros(1)) == wanted
    assert not dispatch.suits_rank_one(pattern, preview, np.zeros(1), np.zeros(1, np.float32))


def test_the_closed_loop_of_larger_machines_has_a_kernel_too(monkeypatch):
    monkeypatch.setattr(dispatch, "on_gpu", lambda: True)
    assert dispatch.suits_loop(axes_of(8, 2), np.zeros(1))
    assert not dispatch.suits_loop(axes_of(16, 1), np.zeros(1))
    assert not dispatch.suits_loop(axes_of(4, 2), np.zeros(1, np.float16))


def test_metrics_on_lines_and_arcs_have_a_kernel(monkeypatch):
    assert dispatch.suits_metrics(circle(1e-2), np.zeros(1)) == dispatch.on_gpu()
    monkeypatch.setattr(dispatch, "on_gpu", lambda: True)
    assert dispatch.suits_metrics(circle(1e-2), np.zeros(1))
    assert not dispatch.suits_metrics(circle(1e-2), np.zeros(1), np.zeros(1, np.float32))
    assert not dispatch.suits_metrics(ellipse(2e-2, 1e-2), np.zeros(1))


def test_multiplications_are_counted_over_what_is_not_zero():
    dense = Pattern.of(np.ones((3, 3)), np.ones((3, 1)), np.ones((1, 3)))
    assert dispatch.multiplications(dense) == 3 * 3 + 6 + 9 * 3 + 9 * 3 // 2
    assert (
        dispatch.multiplications(Pattern.of(np.eye(3), np.ones((3, 1)), np.ones((1, 3))))
        == 3 * 3 + 6 + 3 * 3 + 3 * 3 // 2
    )


def test_spans_are_for_long_windows_whose_profile_is_known_to_be_uniform():
    shortest = dispatch.SHORTEST_WINDOW["gpu" if dispatch.on_gpu() else "cpu"]
    assert dispatch.suits_spans(np.ones(shortest)) and dispatch.suits_spans(np.full(shortest, 0.3))
    assert not dispatch.suits_spans(np.ones(shortest - 1)) and not dispatch.suits_spans(np.ones(0))
    assert not dispatch.suits_spans(np.linspace(1, 2, shortest)) and not dispatch.suits_spans(
        np.ones(shortest), lanes=True
    )
    traced = []
    jax.eval_shape(lambda stage: traced.append(dispatch.suits_spans(stage)), np.ones(shortest))
    assert traced == [False]


@pytest.mark.parametrize("steps", [1, 500, 10**6])
def test_blocks_fit_their_windows_and_are_not_many(steps):
    for window in (*range(1, 50), 1000, 4096):
        length = dispatch.block_length(window, steps)
        assert 1 <= length <= window and window // length <= max(1, length)
