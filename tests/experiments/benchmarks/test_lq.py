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
    machine, path = (plant.A, plant.B, plant.C), (reference.tangent, reference.position)
    run = machine, path, WEIGHTS, 20, 4, start
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


RUN = lq.Rate("float64", "kernels", 256, 21_500.0, 1.5, 3_000_000, 7_000.0, 5_400.0, 2.5, 6_000_000)
RESULT = lq.LQBench({"NumPy loop": 10.0}, [RUN, lq.Rate("2 + 2", "XLA", 16, 640.0, 0.25, 1000)])


@pytest.mark.parametrize(
    "row",
    [
        "float64 kernels 256 21,500 7,000 5,400 2150",
        "float64 kernels 256 1.5 2.5 3e+06 6e+06",
        "2 + 2 XLA 16 640 - - 64",
        "2 + 2 XLA 16 0.25 - 1000 -",
        "NumPy loop 10 runs/s, float64, tracking and projected error only",
    ],
)
def test_rows_have_the_units_of_their_headings(row):
    page = io.StringIO()
    show(Console(file=page, width=160), lq.tables(RESULT))
    assert row.split() in [line.split() for line in page.getvalue().splitlines()]


def test_rates_that_are_measured_have_a_name():
    assert lq.rates(RESULT) == {
        "float64, batch 256, forward": 21_500.0,
        "float64, batch 256, value and gradient": 7_000.0,
        "float64, batch 256, with a profile": 5_400.0,
        "2 + 2, batch 16, forward": 640.0,
    }
