"""Numbers of a made-up result, in the units of the headings."""

import io

import pytest
from rich.console import Console

from experiments.benchmarks.speed import lq as results
from experiments.tables import show

RUN = results.RunRates(
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
RESULT = results.LQBench(
    loops={"NumPy loop": 12.0},
    runs=[RUN],
    sizes=[results.SizeRate("2 + 2", 2, 16, "XLA", 640.0, 0.25, 1e-12)],
    previews=[results.PreviewTime(25, "by blocks", 5000, 1, 17.0, 1.25)],
    devices=[results.DeviceRate(2, 512, 43_000.0, 2.0)],
)


def lines():
    page = io.StringIO()
    show(Console(file=page, width=160), results.tables(RESULT))
    return [line.split() for line in page.getvalue().splitlines()]


@pytest.mark.parametrize(
    "row",
    [
        "float64 kernels 256 21,500 7,000 3 4 90",
        "float64 kernels 256 1.5 2.5 3 6",  # memory in MB
        "2 + 2 XLA 2 16 640 0.25 1e-12",
        "by blocks 25 5,000 1 17 1.25",
        "2 512 43,000 2",
        "NumPy loop 12 runs/s, float64, tracking and projected error only",
    ],
)
def test_rows(row):
    assert row.split() in lines()
