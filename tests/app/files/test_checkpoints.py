"""Results of a sweep so far."""

import numpy as np
import pytest

from jcontour.app.files.checkpoints import SweepChunks
from jcontour.app.files.run_folder import RunError


def chunk(first, count):
    rows = np.arange(first, first + count, dtype=float)
    return {"rms_control": np.stack([rows, -rows], axis=1), "diverged": rows % 2 == 0}


def test_chunks_go_on_where_they_ended(tmp_path):
    folder = tmp_path / "chunks"
    for first, count in ((0, 3), (3, 1), (4, 12)):
        chunks = SweepChunks(folder)
        assert chunks.rows == first
        chunks.add(chunk(first, count))
    for rows in (chunks.whole(), SweepChunks(folder).whole()):
        np.testing.assert_array_equal(rows["rms_control"], chunk(0, 16)["rms_control"])
        np.testing.assert_array_equal(rows["diverged"], chunk(0, 16)["diverged"])


def test_lost_and_damaged_chunks_are_named(tmp_path):
    chunks = SweepChunks(tmp_path)
    for first in (0, 2, 4):
        chunks.add(chunk(first, 2))
    (tmp_path / "000000002.npz").rename(tmp_path / "elsewhere")
    with pytest.raises(RunError, match="000000002.npz: is missing"):
        SweepChunks(tmp_path)
    (tmp_path / "000000002.npz").write_bytes((tmp_path / "elsewhere").read_bytes()[:100])
    with pytest.raises(RunError, match="000000002.npz: cannot be read"):
        SweepChunks(tmp_path)
