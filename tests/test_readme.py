"""The README's library examples run and say what they promise."""

import re
from pathlib import Path


def test_the_library_examples_run(capsys):
    text = (Path(__file__).parents[1] / "README.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 3
    names = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)  # each goes on from those before
    *printed, traced = capsys.readouterr().out.splitlines()
    numbers = [float(line.split()[-2]) for line in printed]
    errors, deformations = numbers[:3], numbers[3:]
    assert errors == sorted(
        errors, reverse=True
    )  # more contour weight, less contour error, at these weights
    assert deformations[:2] == [0.566, 0.542]  # the reference's runs, mm
    assert len(deformations) == 4 and deformations[3] < 0.6 * deformations[0]
    time, rms, residual = re.fullmatch(
        r"([\d.]+) s, ([\d.]+) um, worst residual ([\de.-]+)", traced
    ).groups()
    assert (
        1.6 < float(time) < 1.7 and 20 < float(rms) < 40 and float(residual) <= 1e-8
    )  # the reference's run: 1.645 s, 28.4 um at 1 ms
