"""What `jcontour bench lq` times is the same run in every formulation; no time is asserted."""

import jax
import numpy as np

from experiments.benchmarks.speed.lq_cases import paper_case
from experiments.benchmarks.speed.plain_loops import (
    closed_form,
    numpy_loop,
    plain_loop,
    written_out,
)
from jcontour.simulation.evaluation import member

WEIGHTS = (1.0, 5.0, 1e-10)


def test_the_loops_make_the_run_that_is_timed():
    case = paper_case(np.dtype("float64"), 20, 4)
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
