import numpy as np
import pytest

from jcontour.export.code_text import COLUMNS, literal, plain, table


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
