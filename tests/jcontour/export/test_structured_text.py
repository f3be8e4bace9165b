"""The block is run: its statements are turned into Python one by one."""

import re

import numpy as np

from jcontour.export.structured_text import structured_text


def as_python(text):
    """Statements and constants of a block: FOR, IF and := are all that it has."""
    text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)
    block = text.partition("FUNCTION_BLOCK DriveController")[2].rpartition("END_FUNCTION_BLOCK")[0]
    constants = {
        name: np.array([0.0, *(float(word) for word in values.split(","))])
        for name, values in re.findall(r"(\w+) : ARRAY\[[^\]]*\] OF \w+ := \[([^\]]*)\]", block)
    }
    lines, depth = [], 0
    for line in block.rpartition("END_VAR")[2].splitlines():
        words = line.strip()
        loop = re.fullmatch(r"FOR (\w) := 1 TO (\d+) DO", words)
        if words in ("END_FOR;", "END_IF;"):
            depth -= 1
            continue
        if loop:
            words = f"for {loop[1]} in range(1, {int(loop[2]) + 1}):"
        elif words == "IF restart THEN":
            words = "if restart:"
        else:
            assert not words or re.fullmatch(r"\w+(\[i\])? := [^:]+;", words), words
            words = words.rstrip(";").replace(":=", "=")
        lines.append("    " * depth + words)
        depth += words.endswith(":")
    assert depth == 0
    return "\n".join(lines), constants


def test_the_block_gives_the_controls_of_the_law(law_and_plan, recorded):
    law, plan = law_and_plan
    y, u = recorded
    text = structured_text(law, plan, ["machine *) END_IF; (*"], "double")
    code, names = as_python(text)
    one = np.zeros(1)
    names |= {"x": np.zeros(law.states + 1), "after": np.zeros(law.states + 1)}
    names |= {"miss": np.zeros(law.measured + 1), "control": np.zeros(law.inputs + 1)}
    names["LIMIT"] = lambda least, value, most: min(max(value, least), most)
    program = compile(code, "controller.st", "exec")
    for k in range(plan.steps):
        sets = {"feedback": plan.F, "direct": plan.D}
        for name, matrix in sets.items():
            if matrix is not None:
                names[name] = np.concatenate([one, matrix[plan.used[k]].ravel()])
        if plan.w is not None:
            names["ahead"] = np.concatenate([one, plan.w[k]])
        names |= {"measured": np.concatenate([one, y[k]]), "restart": k == 0}
        names["planned"] = np.concatenate([one, plan.f[k]])
        exec(program, names)
        assert np.abs(names["control"][1:] - u[k]).max() < 1e-12


def test_the_declared_sizes_are_those_of_the_numbers(law_and_plan):
    text = structured_text(*law_and_plan, [], "single")
    for size, values in re.findall(r"ARRAY\[1\.\.(\d+)\] OF REAL := \[([^\]]*)\]", text):
        assert len(values.split(",")) == int(size)
    assert "LREAL" not in text
