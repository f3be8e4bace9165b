import struct

import numpy as np
import pytest

from jcontour.app.files.response_file import DIGITS, read_response

FREQUENCY = np.linspace(5, 100, 20)
VALUE = 3 / (1 + 0.02j * FREQUENCY)


def written(path, heads, *columns):
    rows = np.column_stack(columns)
    np.savetxt(path, rows, "%.15g", ",", header=",".join(heads), comments="")
    return path


def test_parts_and_sizes_are_the_same_response(tmp_path):
    parts = written(
        tmp_path / "a.csv", ("frequency_hz", "real", "imag"), FREQUENCY, VALUE.real, VALUE.imag
    )
    sizes = written(
        tmp_path / "b.csv",
        ("Freq [Hz]", "dB", "Phase [deg]", "coherence"),
        FREQUENCY[::-1],
        20 * np.log10(np.abs(VALUE[::-1])),
        np.degrees(np.angle(VALUE[::-1])),
        np.full(20, 0.5),
    )
    one, other = read_response(parts), read_response(sizes)
    np.testing.assert_allclose(one.value, VALUE, rtol=1e-12)
    np.testing.assert_allclose(other.value, VALUE, rtol=1e-12)
    assert (one.deviation == 0).all() and other.deviation == pytest.approx(np.sqrt(0.5))


def test_bad_responses_are_refused_in_a_line(tmp_path):
    path = written(tmp_path / "a.csv", ("frequency_hz", "db"), FREQUENCY, FREQUENCY)
    with pytest.raises(ValueError, match="has no phase"):
        read_response(path)
    path = written(tmp_path / "b.csv", ("time", "x"), FREQUENCY, FREQUENCY)
    with pytest.raises(ValueError, match="has no response"):
        read_response(path)
    path = written(
        tmp_path / "c.csv", ("hz", "re", "im"), FREQUENCY * 0 + 5, VALUE.real, VALUE.imag
    )
    with pytest.raises(ValueError, match="different frequencies"):
        read_response(path)
    (tmp_path / "d.xml").write_text("<xml/>")
    with pytest.raises(ValueError, match="no measured plant"):
        read_response(tmp_path / "d.xml")


def in_base_85(numbers):
    """Eight bytes each as two words of five digits, zeros as a point."""
    text = ""
    for (word,) in struct.iter_unpack(">I", struct.pack(f">{len(numbers)}d", *numbers)):
        digits = "".join(DIGITS[word // 85**k % 85] for k in (4, 3, 2, 1, 0))
        text += digits if word else "."
    return "\n".join(text[k : k + 70] for k in range(0, len(text), 70))


def test_a_servo_tuning_in_xml(tmp_path):
    complex_pairs = np.column_stack([VALUE.real, VALUE.imag]).ravel()
    text = ""
    for name, values in (
        ("m_pPlant", complex_pairs),
        ("m_pMeasCoherence", np.column_stack([np.ones(20), np.zeros(20)]).ravel()),
    ):
        arrays = "".join(
            f'<raw name="m_pNumberArray"><![CDATA[\n{in_base_85(one)}\n]]></raw>'
            for one in (values, FREQUENCY)
        )
        head = f'<FrequencyResponseFunction satclassid="6" name="{name}">'
        text += f"{head}{arrays}</FrequencyResponseFunction>"
    (tmp_path / "ast.xml").write_text(text)
    record = read_response(tmp_path / "ast.xml")
    np.testing.assert_array_equal(record.value, VALUE)
    np.testing.assert_array_equal(record.frequency, FREQUENCY)
    (tmp_path / "cut.xml").write_text(text.replace(in_base_85(FREQUENCY)[:9], "", 1))
    with pytest.raises(ValueError, match="cut off"):
        read_response(tmp_path / "cut.xml")
