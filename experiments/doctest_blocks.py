"""Doctests of docstrings become blocks of code on the site: an extension of griffe."""

import re
from typing import Any

from griffe import Extension  # pyright: ignore[reportMissingImports]

DOCTEST = re.compile(r"^( *)>>> .*\n?(?:^\1\S.*\n?)*", re.MULTILINE)


class DoctestBlocks(Extension):
    """Puts a fence around the lines of every doctest."""

    def on_object(self, *, obj: Any, **_: Any) -> None:
        """Change the docstring of an object that has been loaded."""
        if obj.docstring:
            obj.docstring.value = DOCTEST.sub(_fenced, obj.docstring.value)


def _fenced(block: re.Match[str]) -> str:
    indent = block[1]
    return f"{indent}```pycon\n{block[0].rstrip()}\n{indent}```\n"
