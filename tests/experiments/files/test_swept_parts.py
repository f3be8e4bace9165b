import numpy as np
import pytest

from experiments.files.run_folder import RunError
from experiments.files.swept_parts import SweptParts


def part(first, count):
    rows = np.arange(first, first + count, dtype=float)
    return {"rms_control": np.stack([rows, -rows], axis=1), "diverged": rows % 2 == 0}


def test_parts_go_on_where_they_ended(tmp_path):
    folder = tmp_path / "parts"
    for first, count in ((0, 3), (3, 1), (4, 12)):
        parts = SweptParts(folder)
        assert parts.rows == first
        parts.add(part(first, count))
    for found in (parts.whole(), SweptParts(folder).whole()):
        np.testing.assert_array_equal(found["rms_control"], part(0, 16)["rms_control"])
        np.testing.assert_array_equal(found["diverged"], part(0, 16)["diverged"])


def test_lost_and_damaged_parts_are_named(tmp_path):
    parts = SweptParts(tmp_path)
    for first in (0, 2, 4):
        parts.add(part(first, 2))
    (tmp_path / "000000002.npz").rename(tmp_path / "elsewhere")
    with pytest.raises(RunError, match="000000002.npz: is missing"):
        SweptParts(tmp_path)
    (tmp_path / "000000002.npz").write_bytes((tmp_path / "elsewhere").read_bytes()[:100])
    with pytest.raises(RunError, match="000000002.npz: cannot be read"):
        SweptParts(tmp_path)
