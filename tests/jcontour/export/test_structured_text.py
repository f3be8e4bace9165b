"""The block is run: its statements are turned into Python one by one.

Where matiec is installed it compiles the block too: `iec2c` on the path, and `MATIEC_LIB` naming
the folder of its standard library.
"""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from jcontour.export.drive_law import replayed
from jcontour.export.structured_text import structured_text

# IEC 61131-3: keywords, elementary and generic types, standard functions and blocks, operators and
# action qualifiers
RESERVED = set(
    """
    ABSTRACT ACTION ARRAY AT BY CASE CLASS CONFIGURATION CONSTANT CONTINUE DO ELSE ELSIF EN ENO
    END_ACTION END_CASE END_CLASS END_CONFIGURATION END_FOR END_FUNCTION END_FUNCTION_BLOCK END_IF
    END_INTERFACE END_METHOD END_NAMESPACE END_PROGRAM END_REPEAT END_RESOURCE END_STEP END_STRUCT
    END_TRANSITION END_TYPE END_VAR END_WHILE EXIT EXTENDS FALSE FINAL FOR FROM FUNCTION
    FUNCTION_BLOCK F_EDGE IF IMPLEMENTS INITIAL_STEP INTERFACE INTERNAL INTERVAL METHOD NAMESPACE
    NON_RETAIN NULL OF ON OVERLAP OVERRIDE PRIORITY PRIVATE PROGRAM PROTECTED PUBLIC READ_ONLY
    READ_WRITE REF REF_TO REPEAT RESOURCE RETAIN RETURN R_EDGE SINGLE STEP STRUCT SUPER TASK THEN
    THIS TO TRANSITION TRUE TYPE UNTIL USING VAR VAR_ACCESS VAR_CONFIG VAR_EXTERNAL VAR_GLOBAL
    VAR_INPUT VAR_IN_OUT VAR_OUTPUT VAR_TEMP WHILE WITH
    ANY ANY_BIT ANY_DATE ANY_DERIVED ANY_ELEMENTARY ANY_INT ANY_MAGNITUDE ANY_NUM ANY_REAL
    ANY_STRING BOOL BYTE CHAR DATE DATE_AND_TIME DINT DT DWORD INT LDATE LDT LINT LREAL LTIME LTOD
    LWORD REAL SINT STRING TIME TIME_OF_DAY TOD UDINT UINT ULINT USINT WCHAR WORD WSTRING
    ABS ACOS ADD ASIN ATAN ATAN2 CONCAT COS DELETE DIV EQ EXP EXPT FIND GE GT INSERT LE LEFT LEN
    LIMIT LN LOG LT MAX MID MIN MOD MOVE MUL MUX NE REPLACE RIGHT ROL ROR SEL SHL SHR SIN SQRT SUB
    TAN TRUNC AND NOT OR XOR
    CTD CTU CTUD F_TRIG RS RTC R_TRIG SEMA SR TOF TON TP
    ANDN CAL CALC CALCN D DS JMP JMPC JMPCN L LD LDN N ORN P R RET RETC RETCN S SD SL ST STN XORN
    """.split()
)
USED = {"FUNCTION_BLOCK", "END_FUNCTION_BLOCK", "VAR_INPUT", "VAR_OUTPUT", "VAR", "CONSTANT"}
USED |= {"END_VAR", "ARRAY", "OF", "BOOL", "INT", "LREAL", "REAL", "FOR", "TO", "DO", "END_FOR"}
USED |= {"IF", "THEN", "ELSE", "END_IF", "AND", "TRUE", "FALSE", "LIMIT"}  # of the reserved ones


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
        elif words == "ELSE":
            depth, words = depth - 1, "else:"
        elif condition := re.fullmatch(r"IF (.+) THEN", words):
            words = f"if {condition[1].replace('AND', 'and')}:"
        else:
            assert not words or re.fullmatch(r"\w+(\[\w\])? := [^:]+;", words), words
            words = words.rstrip(";").replace(":=", "=")
        lines.append("    " * depth + words)
        depth += words.endswith(":")
    assert depth == 0
    return "\n".join(lines), constants


def test_the_block_gives_the_controls_of_the_law(law_and_plan, recorded):
    law, plan = law_and_plan
    y, u = recorded
    text = structured_text(law, plan, ["machine *) END_IF; (*"], "double")
    assert "VAR CONSTANT\nEND_VAR" not in text  # no compiler takes a part without variables
    code, names = as_python(text)
    one = np.zeros(1)
    names |= {"memory": np.full(law.states + 1, 9.0), "after": np.zeros(law.states + 1)}
    names |= {"miss": np.zeros(law.measured + 1), "control": np.zeros(law.inputs + 1)}
    names |= {"TRUE": True, "FALSE": False}
    names |= {"departure": np.full(law.measured + 1, 9.0), "change": np.zeros(law.inputs + 1)}
    names["LIMIT"] = lambda least, value, most: min(max(value, least), most)
    program = compile(code, "controller.st", "exec")
    sent = y.copy()
    sent[11, -1] = np.nan
    y[11, -1] = plan.r[11, -1] + y[10, -1] - plan.r[10, -1]  # it departs as before
    u = replayed(law, plan, y)
    for k in range(plan.steps):
        sets = {"feedback": plan.F, "direct": plan.D}
        for name, matrix in sets.items():
            if matrix is not None:
                names[name] = np.concatenate([one, matrix[plan.used[k]].ravel()])
        names["expected"] = np.concatenate([one, plan.r[k]])
        if plan.m is not None:
            names["planned_memory"] = np.concatenate([one, plan.m[k]])
        names |= {"measured": np.concatenate([one, sent[k]]), "restart": k == 0}
        names["planned"] = np.concatenate([one, plan.f[k]])
        exec(program, names)
        assert names["fault"] is (k == 11)
        assert np.abs(names["control"][1:] - u[k]).max() < 1e-12


def test_the_declared_sizes_are_those_of_the_numbers(law_and_plan):
    text = structured_text(*law_and_plan, [], "single")
    for size, values in re.findall(r"ARRAY\[1\.\.(\d+)\] OF REAL := \[([^\]]*)\]", text):
        assert len(values.split(",")) == int(size)
    assert "LREAL" not in text


def test_a_compiler_that_sees_no_case_finds_every_name_declared_once(law_and_plan):
    """All words of the block: keywords, or names that are declared; none of them is both."""
    text = structured_text(*law_and_plan, ["machine *) e : INT; (*"], "double")
    bare = re.sub(r"\(\*.*?\*\)", " ", text, flags=re.DOTALL)
    declared = [
        name.upper() for name in re.findall(r"^\s*(\w+)\s*:(?!=)", bare, flags=re.MULTILINE)
    ]
    declared += [name.upper() for name in re.findall(r"FUNCTION_BLOCK (\w+)", bare)]
    assert len(declared) > 8 and len(set(declared)) == len(declared)
    assert not RESERVED & set(declared)
    assert not {name for name in declared if len(name) == 1} & set("ABCDELMPQT")  # addresses in SCL
    numbers = r"(?<![\w.])\d[\d.]*(?:[eE][+-]?\d+)?"
    words = {word.upper() for word in re.findall(r"[A-Za-z_]\w*", re.sub(numbers, " ", bare))}
    assert words <= set(declared) | USED and USED <= RESERVED


@pytest.mark.skipif(
    shutil.which("iec2c") is None or "MATIEC_LIB" not in os.environ, reason="no matiec here"
)
@pytest.mark.parametrize("precision", ["double", "single"])
def test_an_open_compiler_takes_the_block(law_and_plan, tmp_path, precision):
    law, plan = law_and_plan
    path = tmp_path / "controller.st"
    path.write_text(structured_text(law, plan, ["machine *) END_IF; (*"], precision))
    words = ["iec2c", "-I", os.environ["MATIEC_LIB"], "-T", str(tmp_path), str(path)]
    done = subprocess.run(words, text=True, capture_output=True)
    assert done.returncode == 0 and "DRIVECONTROLLER" in (tmp_path / "POUS.h").read_text(), done
    assert "error" not in done.stderr and "warning" not in done.stderr, done.stderr
