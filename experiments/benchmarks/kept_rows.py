"""Rows of a long benchmark, kept in a file as they come: a second run goes on."""

import json
from collections.abc import Callable, Hashable, Iterable
from pathlib import Path
from typing import TypeVar

Row = TypeVar("Row")  # a dataclass of numbers, words and lists of them


def kept(
    path: Path | None,
    kind: type[Row],
    keys: Iterable[Hashable],
    run: Callable[..., list[Row]],
) -> list[Row]:
    """Rows of all keys, in their order; `run(*key)` makes those that no file holds.

    Every line of the file is a key with its rows, as JSON. A last line without its end is dropped:
    the run before was ended while it was written.

    Raises:
        ValueError: the file cannot be read or written, or holds something else.
    """
    keys = [key if isinstance(key, tuple) else (key,) for key in keys]
    done = _read(path, kind) if path is not None else {}
    for key in keys:
        if key not in done:
            done[key] = run(*key)
            if path is not None:
                with path.open("a") as file:
                    line = [list(key), [vars(row) for row in done[key]]]
                    file.write(json.dumps(line) + "\n")
    return [row for key in keys for row in done[key]]


def _read(path: Path, kind: type[Row]) -> dict[tuple, list[Row]]:
    try:
        text = path.read_text() if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        lines = [json.loads(line) for line in whole.splitlines()]
        done = {tuple(key): [kind(**row) for row in rows] for key, rows in lines}
        path.write_text(whole)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ValueError(f"keep: {path} is of no such benchmark: {error}") from None
    return done
