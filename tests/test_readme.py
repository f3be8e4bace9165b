"""The examples of the README and of the library guide run and say what they promise."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def python_blocks(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)


def run_blocks(page):
    names = {}
    for block in python_blocks(page):
        exec(compile(block, page, "exec"), names)  # each goes on from those before


def test_the_own_controller_of_the_readme_runs(capsys):
    run_blocks("README.md")
    error, slope = re.fullmatch(
        r"([\d.]+) um; .* by (-?[\d.]+) um", capsys.readouterr().out.strip()
    ).groups()
    assert 10 < float(error) < 30  # a velocity lag of 0.05 m/s, half of it fed forward
    assert -2 < float(slope) < 0  # more feedforward lowers it


def test_the_examples_of_the_library_guide_run(capsys):
    run_blocks("jcontour/README.md")
    *printed, traced = capsys.readouterr().out.splitlines()
    numbers = [float(line.split()[-2]) for line in printed]
    errors, deformations = numbers[:3], numbers[3:]
    assert errors == sorted(errors, reverse=True)  # more contour weight, less contour error
    assert deformations[:2] == [0.566, 0.542]  # the reference's runs, mm
    assert len(deformations) == 4 and deformations[3] < 0.6 * deformations[0]
    found = re.fullmatch(r"([\d.]+) s, ([\d.]+) um, worst residual ([\de.-]+)", traced)
    time, rms, residual = map(float, found.groups())
    assert 1.6 < time < 1.7 and 20 < rms < 40  # the reference's run: 1.645 s, 28.4 um at 1 ms
    assert residual <= 1e-8


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_bytes()) <= 9000
