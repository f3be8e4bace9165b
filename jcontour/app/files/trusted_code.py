"""Python files that this user has chosen to run, by their content.

A run folder holds a copy of the user's own classes, and its settings may name any file: where the
folder comes from somebody else, so does that code. A file runs if one of the user's commands has
named it, now or before. The hashes of those lie outside every run folder, in the user's state
folder; a name, a date or an owner in the run folder itself proves nothing.
"""

import os
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

_chosen: set[str] = set()  # by this process: the user's folder may not be writable


class UntrustedCodeError(ValueError):
    """A Python file that the user has not chosen to run; one line."""


def trust(content: bytes) -> None:
    """Let a Python file of this content run, now and later."""
    digest = sha256(content).hexdigest()
    _chosen.add(digest)
    with suppress(OSError):  # then it is asked for again
        if digest not in _recorded():
            _record().parent.mkdir(parents=True, exist_ok=True)
            with _record().open("a") as file:
                file.write(f"{digest}\n")


def check_trusted(path: Path, content: bytes) -> None:
    """Refuse code that the user has not chosen.

    Raises:
        UntrustedCodeError: no command of the user has named a file of this content.
    """
    digest = sha256(content).hexdigest()
    if digest not in _chosen and digest not in _recorded():
        raise UntrustedCodeError(
            f"{path}: this Python file would run, and none of your commands has named it: read it, "
            "then add --trust-code"
        )


def _recorded() -> set[str]:
    try:
        return set(_record().read_text().split())
    except OSError:
        return set()


def _record() -> Path:
    states = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(states) / "jcontour" / "trusted-code"
