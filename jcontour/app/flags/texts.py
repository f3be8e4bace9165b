"""Help texts of flags, from the docstrings below their fields.

Such a docstring is a statement of its own that Python forgets ("attribute docstrings", PEP 257), so
the source is read. tyro reads it too, and breaks lines before digits and signs but not after a
sentence.
"""

import ast
import inspect
import textwrap
from functools import cache
from itertools import pairwise


@cache
def texts_of(kind: type) -> dict[str, str]:
    """Name -> text of every field of a dataclass, those that it inherits among them.

    A sentence may begin a new line; other line breaks are those of the source alone.
    """
    texts: dict[str, str] = {}
    for owner in reversed(kind.__mro__[:-1]):
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(body, ast.ClassDef)
        for field, text in pairwise(body.body):
            match field, text:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(said))),
                ):
                    texts[name] = flowing(said)
    return texts


def flowing(text: str) -> str:
    r"""Lines joined, but for those that end a sentence.

    >>> flowing("One sentence\n    on two lines.\n    Another.")
    'One sentence on two lines.\nAnother.'
    """
    lines = [line.strip() for line in text.strip().splitlines()]
    return "".join(line + ("\n" if line.endswith(".") else " ") for line in lines).strip()
