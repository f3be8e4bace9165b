"""Entries of the catalogue: a name is the key, a line describes the thing.

Where it is made is said in words, `module:name`, and imported when the thing is asked for.
"""

from importlib import import_module
from typing import Any, NamedTuple


class Entry(NamedTuple):
    """A thing with a name.

    Attributes:
        line: description in one line.
        place: `module:name` of what makes it.
    """

    line: str
    place: str

    def load(self) -> Any:
        """Maker of the thing, or a table of makers."""
        return loaded(self.place)

    def __call__(self) -> Any:
        """The thing itself."""
        return self.load()()


def loaded(place: str) -> Any:
    """The thing that `module:name` names."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
