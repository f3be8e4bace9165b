"""Structured text is run: its statements are turned into Python one by one."""

import re

import numpy as np
import pytest

from jcontour.export.code_text import COLUMNS, literal, plain, table

from .conftest import code_of, in_python
from .test_streaming_law import measurements, recorded


@pytest.mark.parametrize("value", [0.1, -1e-300, 3.0, 1e22, 5e-324, -0.0])
def test_a_literal_reads_back_to_the_last_bit(value):
    text = literal(value)
    assert float(text) == value and np.signbit(float(text)) == np.signbit(value)
    assert "." in text.partition("e")[0]


def test_a_single_literal_is_the_nearest_single():
    text = literal(np.pi, "single")
    assert text.endswith("f") and np.float32(text[:-1]) == np.float32(np.pi)
    with pytest.raises(ValueError, match="finite numbers, received nan"):
        literal(np.nan)


def test_tables_keep_every_number_and_the_width():
    values = np.random.default_rng(0).normal(size=(3, 40))
    text = table(values)
    assert [float(word) for word in text.split(",")] == values.ravel().tolist()
    assert max(len(line) for line in text.splitlines()) <= COLUMNS


def test_text_of_a_user_ends_no_comment():
    nasty = "mill */ int x; /* (* *) é\nline two ??/ \\"
    line = plain(nasty)
    assert not any(mark in line for mark in ("*/", "/*", "*)", "(*", "\n", "??/"))
    assert line.isascii() and not line.endswith("\\")
    assert plain("**//").count("*/") == 0


NAMES = {"ABS": abs, "MIN": min, "MAX": max}


def as_python(text):
    """Constants, variables and statements of a block."""
    text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)
    names = dict(NAMES)
    for name, value in re.findall(r"(\w+) : L?(?:DINT|REAL) := ([^;]+);", text):
        names[name] = float(value) if "." in value else int(value)
    for name, values in re.findall(r"(\w+) : ARRAY\[[^\]]*\] OF \w+ := \[([^\]]*)\]", text):
        names[name] = [float(word) for word in values.split(",")]
    for name, last in re.findall(r"(\w+) : ARRAY\[0\.\.([^\]]*)\] OF \w+;", text):
        names[name] = [0.0] * (eval(last, names) + 1)
    for words in re.findall(r"([\w, ]+) : \w+;", text):
        names |= dict.fromkeys(words.replace(",", " ").split(), 0)
    lines, depth = [], 1
    for line in text.rpartition("END_VAR")[2].rpartition("END_FUNCTION_BLOCK")[0].splitlines():
        words = line.strip()
        if words in ("END_FOR;", "END_IF;"):
            depth -= 1
            continue
        depth -= words.startswith(("ELSE", "ELSIF"))
        if loop := re.fullmatch(r"FOR (\w) := (.+) TO (.+?)( BY -1)? DO", words):
            name, first, last, back = loop.groups()
            step, end = (-1, f"{last} - 1") if back else (1, f"{last} + 1")
            words = f"for {name} in range({first}, {end}, {step}):"
        elif condition := re.fullmatch(r"(IF|ELSIF) (.+) THEN", words):
            test = re.sub(r"(?<![<>])=", "==", condition[2]).replace("<>", "!=")
            for name in ("AND", "OR", "NOT"):
                test = re.sub(rf"\b{name}\b", name.lower(), test)
            words = f"{'if' if condition[1] == 'IF' else 'elif'} {test}:"
        else:
            words = {"ELSE": "else:", "RETURN;": "return"}.get(words, words)
            words = words.rstrip(";").replace(":=", "=")
        lines.append("    " * depth + words)
        depth += words.endswith(":")
    assert depth == 1
    state = sorted(name for name in names if name.islower())
    head = ["def step():", f"    global {', '.join(state)}"]
    exec("\n".join([*head, *(line for line in lines if line.strip())]), names)
    return names


@pytest.mark.parametrize("name", ["contouring", "riccati", "drives", "cascade"])
def test_the_block_gives_the_controls_of_the_python_code(name):
    reference, actual = recorded(name, 40)
    code, y = code_of(name), measurements(actual)
    block, law = as_python(code.text("law.st.j2")), in_python(code)["Law"]()
    position, tangent = np.asarray(reference.position), np.asarray(reference.tangent)
    y[20] = np.nan
    for k, measured in enumerate(y):
        ahead = slice(k, k + code.law.points)
        wanted = law.step(position[ahead], measured, tangent[ahead], k, hold=k > 30)
        block |= {
            "points": position[ahead].ravel().tolist(),
            "tangents": tangent[ahead].ravel().tolist(),
            "measured": measured.tolist(),
            "tick": k,
            "enable": 1,
            "hold": int(k > 30),
        }
        block["step"]()
        assert np.array_equal(block["control"], wanted)
    assert block["status"] == law.status > 0


def test_the_block_takes_no_word_of_the_language_for_a_name():
    text = code_of("contouring").text("law.st.j2")
    declared = re.findall(r"^    ([\w, ]+) : ", text, flags=re.MULTILINE)
    names = [word.upper() for line in declared for word in line.replace(",", " ").split()]
    assert len(names) == len(set(names))  # upper and lower case are one
    taken = "AT BY D DO DT END IF L LIMIT LOG MAX MIN N OF ON P R S SD SEL SL ST STEP TIME TO TYPE"
    assert not set(names) & set(taken.split())
