import shutil

import pytest

from jcontour.app.runs.checks.compiled_code import compiled_checks

PROGRAM = '#include <stdio.h>\nint main(void)\n{\n    puts("%s");\n    return 0;\n}\n'

pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="no C compiler here")


def test_what_a_program_says_is_read(tmp_path):
    (tmp_path / "a.c").write_text(PROGRAM % "9 samples, largest difference 2.5e-13, 81.5 ns a step")
    found = compiled_checks(tmp_path)[0]
    assert (found.difference, found.nanoseconds) == (2.5e-13, 81.5)
    assert found.compiler.startswith("gcc -std=c99 ")


@pytest.mark.parametrize("text", ["int main(void) { int unused; return 0; }\n", PROGRAM % "moon"])
def test_a_warning_or_a_strange_answer_is_a_fault(tmp_path, text):
    (tmp_path / "a.c").write_text(text)
    with pytest.raises(RuntimeError, match=r"export: (gcc failed|the program of gcc said)"):
        compiled_checks(tmp_path)
