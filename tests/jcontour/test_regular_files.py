import os

import pytest

from jcontour._regular_files import content_of


def test_content_of_a_regular_file_and_of_a_link_to_one(tmp_path):
    (tmp_path / "part.ngc").write_bytes(b"G1")
    (tmp_path / "link.ngc").symlink_to(tmp_path / "part.ngc")
    assert content_of(tmp_path / "part.ngc", 2) == b"G1"
    assert content_of(tmp_path / "link.ngc", 2) == b"G1"
    with pytest.raises(OSError, match="larger than 0 MiB"):
        content_of(tmp_path / "part.ngc", 1)


def test_a_pipe_and_a_device_are_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")  # nothing ever writes into it
    (tmp_path / "zero.json").symlink_to("/dev/zero")
    for name in ("pipe.csv", "zero.json"):
        with pytest.raises(OSError, match="not a regular file"):
            content_of(tmp_path / name, 2**20)
    with pytest.raises(IsADirectoryError):
        content_of(tmp_path, 2**20)
