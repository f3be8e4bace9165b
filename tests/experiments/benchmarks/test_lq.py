"""What `jcontour bench lq` times is the same run in every formulation; no time is asserted."""

import io

import jax
import numpy as np
import pytest
from rich.console import Console

from experiments.benchmarks import lq
from experiments.benchmarks.plain_loops import (
    closed_form,
    numpy_loop,
    plain_loop,
    written_out,
)
from experiments.tables import show
from jcontour.simulation.evaluation import member

WEIGHTS = (1.0, 5.0, 1e-10)


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


@pytest.mark.parametrize("states", lq.SIZES)
def test_machines_of_other_sizes_come_to_rest(states):
    plant = lq.machine(states)
    assert plant.states == sum(states) and plant.axes == plant.inputs == len(states)
    poles = np.sort(np.abs(np.linalg.eigvals(plant.A)))[::-1]
    assert poles[: len(states)] == pytest.approx(1.0)  # a drive's position stays where it is
    assert poles[len(states)] < 0.99


RUN = lq.RunRates(
    type="float64",
    batch=256,
    forward=21_500.0,
    gradient=7_000.0,
    gradient_ratio=3.0,
    profile_ratio=4.0,
    times_numpy=90.0,
    compiling=1.5,
    compiling_gradient=2.5,
    memory=3_000_000,
    memory_gradient=6_000_000,
    by="kernels",
)
RESULT = lq.LQBench(
    loops={"NumPy loop": 12.0},
    runs=[RUN],
    sizes=[lq.SizeRate("2 + 2", 2, 16, "XLA", 640.0, 0.25)],
    previews=[lq.PreviewTime(25, "by blocks", 5000, 1, 17.0, 1.25)],
)


@pytest.mark.parametrize(
    "row",
    [
        "float64 kernels 256 21,500 7,000 3 4 90",
        "float64 kernels 256 1.5 2.5 3 6",  # memory in MB
        "2 + 2 XLA 2 16 640 0.25",
        "by blocks 25 5,000 1 17 1.25",
        "NumPy loop 12 runs/s, float64, tracking and projected error only",
    ],
)
def test_rows_have_the_units_of_their_headings(row):
    page = io.StringIO()
    show(Console(file=page, width=160), lq.tables(RESULT))
    assert row.split() in [line.split() for line in page.getvalue().splitlines()]
