import struct

import numpy as np
import pytest

from jcontour.app.files.response_file import DIGITS, read_response, read_step

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


ROWS = [(0.001 * k, float(k > 5), 0.5 * k) for k in range(20)]


def step_log(path, head="time,control,position", rows=ROWS, mark=","):
    lines = [mark.join(f"{x:.9g}" for x in row) for row in rows]
    path.write_text("\n".join([head, *lines] if head else lines) + "\n")
    return path


@pytest.mark.parametrize("mark", [",", ";"])
def test_columns_by_name_or_by_place(tmp_path, mark):
    path = step_log(tmp_path / "a.csv", mark.join(("time", "control", "position")), mark=mark)
    named, plain = read_step(path, "mm"), read_step(step_log(tmp_path / "b.csv", ""), "mm")
    assert named.dt == plain.dt == pytest.approx(1e-3)
    assert np.allclose(named.position, 0.5e-3 * np.arange(20))
    assert np.array_equal(named.control, plain.control)
    swapped = step_log(tmp_path / "c.csv", "position,time,control", [(p, t, u) for t, u, p in ROWS])
    assert np.array_equal(read_step(swapped, "mm").position, named.position)


def test_times_that_cannot_be_seconds_are_in_the_unit_that_suits_a_drive(tmp_path):
    rows = [(1e6 * t, u, p) for t, u, p in ROWS]
    record = read_step(step_log(tmp_path / "a.csv", rows=rows), "mm")
    assert record.unit == "us" and record.dt == pytest.approx(1e-3)


def test_faults_are_told_with_their_place(tmp_path):
    late = [*ROWS[:7], (0.0075, 1.0, 3.5), *ROWS[8:]]
    back = [(-t, u, p) for t, u, p in ROWS]
    path = tmp_path / "a.csv"
    for change, words in (
        ({"rows": late}, "after 0.006 s comes 0.0075 s, the others are 0.001 s apart"),
        ({"rows": back}, "the column time has to grow"),
        ({"head": "time,current,position"}, "has no column 'control'; needs time, control"),
        ({"rows": [*ROWS, (1.0, 2.0)]}, "column position holds no number in row 21 behind"),
        ({"rows": ROWS[:2]}, "needs at least three samples"),
    ):
        with pytest.raises(ValueError, match=words):
            read_step(step_log(path, **change), "mm")
    path.write_text("")
    with pytest.raises(ValueError, match="is empty"):
        read_step(path, "mm")
    with pytest.raises(ValueError, match="cannot be read"):
        read_step(tmp_path / "none.csv", "mm")
