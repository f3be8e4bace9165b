"""The README's library example runs and says what it promises."""

import re
from pathlib import Path


def test_the_library_example_runs(capsys):
    text = (Path(__file__).parents[1] / "README.md").read_text()
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    exec(compile(code[1], "README.md", "exec"), {})
    errors = [float(line.split()[-2]) for line in capsys.readouterr().out.splitlines()]
    assert len(errors) == 3
    assert errors == sorted(errors, reverse=True)  # more contour weight, less contour error, at these weights
