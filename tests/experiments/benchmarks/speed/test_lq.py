"""What `jcontour bench lq` times is the same run in every formulation; no time is asserted."""

import jax
import numpy as np
import pytest

from experiments.benchmarks.speed import lq
from experiments.benchmarks.speed.plain_loops import (
    closed_form,
    numpy_loop,
    plain_loop,
    written_out,
)
from jcontour.kernels.dispatch import multiplications
from jcontour.simulation.evaluation import member

WEIGHTS = (1.0, 5.0, 1e-10)


@pytest.mark.slow
def test_the_loops_make_the_run_that_is_timed():
    case = lq.paper_case(np.dtype("float64"), 20, 4)
    reference, plant = (
        jax.tree.map(np.asarray, part) for part in (member(case.references, 0), case.plant)
    )
    start = np.asarray(
        case.plant.initial_state(reference.position[0], reference.start_increment)
    ).reshape(-1, 1)
    run = plant.A, plant.B, plant.C, reference.tangent, reference.position, WEIGHTS, 20, 4, start
    wanted = jax.jit(case.metrics)(np.array(WEIGHTS))
    for loop in (numpy_loop, plain_loop(written_out.py_func, closed_form.py_func)):
        np.testing.assert_allclose(
            loop(*run), (wanted.rms_tracking_error, wanted.rms_projected_error), rtol=1e-8
        )


def test_the_work_is_counted_from_the_plant():
    case = lq.paper_case(np.dtype("float32"), 20, 4)
    assert case.dtype == np.float32 and case.weights(3, 2).shape == (3, 5)
    assert lq.work(case) == 2 * 20 * 4 * multiplications(case.plant.pattern)


@pytest.mark.parametrize("states", lq.SIZES)
def test_machines_of_other_sizes_come_to_rest(states):
    plant = lq.machine(states)
    assert plant.states == sum(states) and plant.axes == plant.inputs == len(states)
    poles = np.sort(np.abs(np.linalg.eigvals(plant.A)))[::-1]
    assert poles[: len(states)] == pytest.approx(1.0)  # a drive's position stays where it is
    assert poles[len(states)] < 0.99
