"""How the command line reads flags and shows them: rules for tyro.

Numbers are read in plain digits. Help names the value alone where a flag need not be given, and
says no default there.

Three things of tyro's are relied on. A rule that answers None leaves the type to the rules before
it, and tyro's own come last (`tyro.constructors.ConstructorRegistry`, "primitive rules", "struct
rules"). The text of a field is shown as given (`StructFieldSpec.helptext`). And an empty
`help_behavior_hint` of `tyro.conf.arg` stands in the place of "(default: ...)".

Help texts are the docstrings below the fields ("attribute docstrings", PEP 257). They are read from
the source: Python forgets them, and tyro breaks their lines before digits and signs but not after a
sentence.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from jcontour.app.plain_numbers import number_in, whole_in

HELP, ALL = {"-h", "--help"}, "--help-all"
READERS: dict[type, Callable[[str], Any]] = {
    int: whole_in,
    float: number_in,
    str: str,
    Path: Path,
}
NOTHING_SAID = tyro.conf.arg(help_behavior_hint="")


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


def read(kind: Any, arguments: Sequence[str], prog: str, description: str) -> Any:
    """Flags from the command line; `--help-all` shows those too that few runs need.

    Raises:
        SystemExit: help was asked for, or a flag is wrong.
    """
    asked = ["--help" if word == ALL else word for word in _files_first(kind, arguments)]
    helped = bool(HELP & set(asked))
    registry = rules(everything=ALL in arguments or not helped, helped=helped)
    return tyro.cli(kind, prog=prog, description=description, args=asked, registry=registry)


def _files_first(kinds: Any, words: Sequence[str]) -> list[str]:
    """The words with files before lists of names: of `--axes X log.csv` the file is no axis."""
    named = [get_type_hints(get_args(one)[0]) for one in get_args(kinds)]
    lists = {
        f"--{name.replace('_', '-')}"
        for hints in named
        for name, hint in hints.items()
        if hint == tuple[str, ...]
    }
    files, others, inside = [], [], False
    for word in words[1:]:
        inside = word in lists if word.startswith("-") else inside
        of_data = inside and Path(word).suffix not in ("", ".py") and Path(word).is_file()
        (files if of_data else others).append(word)
    return [*words[:1], *files, *others]


def described(kind: type) -> str:
    """What a command does, and that it has more flags where it has."""
    more = f" {ALL} shows its other flags." if getattr(kind, "RARE", ()) else ""
    return " ".join((kind.__doc__ or "").split()) + more


def rules(everything: bool = True, helped: bool = False) -> ConstructorRegistry:
    """Rules for tyro; without everything, the flags that a class calls `RARE` are left out.

    Help says nothing of its `REFUSED` ones, which it inherits and answers with what to give.
    """
    registry = ConstructorRegistry()
    registry.primitive_rule(_one_value)

    @registry.struct_rule
    def flags(kind: StructTypeInfo) -> StructConstructorSpec | None:
        """A dataclass of flags with its texts."""
        if not is_dataclass(kind.type) or kind.type.__module__.startswith("tyro."):  # its own
            return None
        types: dict[str, Any] = get_type_hints(kind.type, include_extras=True)
        texts, rare = texts_of(kind.type), getattr(kind.type, "RARE", ())
        specs = []
        for field in fields(kind.type):
            default: Any = tyro.MISSING if field.default is MISSING else field.default
            if is_dataclass(kind.default):  # that of the whole where there is one
                default = getattr(kind.default, field.name)
            elif field.default_factory is not MISSING:
                default = field.default_factory()
            shown: Any = types[field.name]
            if default is None or default is False or default in ((), "", Path()):
                shown = Annotated[shown, NOTHING_SAID]
            if default == () and tyro.conf.Positional in get_args(shown):
                several = f"[{field.name.removesuffix('s').upper()} ...]"
                shown = Annotated[shown, tyro.conf.arg(metavar=several)]
            if helped and field.name in getattr(kind.type, "REFUSED", ()):
                shown = tyro.conf.Suppress[shown]
            if field.name in rare and not everything:
                shown = tyro.conf.Suppress[shown]
            specs.append(StructFieldSpec(field.name, shown, default, texts.get(field.name)))
        return StructConstructorSpec(kind.type, tuple(specs))

    return registry


def _one_value(kind: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """One number, text or path; where it need not be given, the word None as well."""
    named = next((known for known in READERS if kind.type in (known, known | None)), None)
    if named is None:
        return None
    read = READERS[named]
    needed = kind.type == named
    accepted = (named, int) if named is float else named
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=named.__name__.upper(),
        instance_from_str=lambda words: read(words[0]) if needed or words[0] != "None" else None,
        is_instance=lambda value: isinstance(value, accepted) or (value is None and not needed),
        str_from_instance=lambda value: [str(value)],
    )
