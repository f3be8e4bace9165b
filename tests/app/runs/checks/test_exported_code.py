"""What the compilers of this computer say of exported code."""

import shutil

import pytest

from jcontour.app.runs.checks.exported_code import compiled_checks

LAW = "int law(void);\nint law(void)\n{\n    return 0;\n}\n"
PROGRAM = '#include <stdio.h>\nint main(void)\n{\n    puts("%s");\n    return 0;\n}\n'
SAID = (
    "9 samples, largest difference 2.5e-13, 81.5 ns a sample, 90 ns in the slowest of a thousand, "
    "400 ns at most, 320 bytes of memory"
)

pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="no C compiler here")


def test_what_a_program_says_is_read(tmp_path):
    (tmp_path / "law.c").write_text(LAW)
    (tmp_path / "check.c").write_text(PROGRAM % SAID)
    limit_checks = compiled_checks(tmp_path)[0]
    assert (limit_checks.difference, limit_checks.nanoseconds) == (2.5e-13, 81.5)
    assert (limit_checks.slow, limit_checks.slowest, limit_checks.memory_bytes) == (
        90.0,
        400.0,
        320,
    )
    assert limit_checks.code_bytes > 0 or not shutil.which("size")
    assert limit_checks.compiler.startswith("gcc -std=c99 ")


@pytest.mark.parametrize("text", ["int main(void) { int unused; return 0; }\n", PROGRAM % "moon"])
def test_a_warning_or_a_strange_answer_is_a_fault(tmp_path, text):
    (tmp_path / "law.c").write_text(LAW)
    (tmp_path / "check.c").write_text(text)
    with pytest.raises(RuntimeError, match=r"export: (gcc failed|the program of gcc said)"):
        compiled_checks(tmp_path)
