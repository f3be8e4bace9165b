"""Content of files that a user names: regular ones alone, up to a size."""

import errno
import os
import stat
from pathlib import Path


def content_of(path: Path, most: int) -> bytes:
    """Bytes of a regular file, or of one that a link leads to.

    A device may have no end, and a pipe may wait for ever: neither is opened.

    Args:
        path: of the file.
        most: its size, at most [bytes].

    Raises:
        OSError: it cannot be read, is a folder, device, pipe or socket, or is larger.
    """
    try:
        mode = path.stat().st_mode
    except ValueError:  # no name of a file holds a null byte
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT)) from None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file but a device, pipe or socket")
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, f"larger than {most >> 20} MiB")
    return content
