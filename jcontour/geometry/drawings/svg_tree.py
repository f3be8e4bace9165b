"""Elements of an SVG file, each with its line. Nothing outside the file is ever read."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from jcontour.geometry.toolpath_rules import MOST_MOVES, ToolpathError, shown

SVG = "http://www.w3.org/2000/svg"
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
DEEPEST = 200  # elements in elements


@dataclass
class Element:
    """An element of a file.

    Attributes:
        name: without its namespace; empty for one of another language.
        line: of the file.
        attributes: by name, those of other languages by their last part, those of Inkscape as
            `inkscape:version`.
        children: in order.
    """

    name: str
    line: int
    attributes: dict[str, str]
    children: list["Element"] = field(default_factory=list)

    def text(self, name: str, default: str = "") -> str:
        """An attribute, or its property in `style`."""
        for entry in self.attributes.get("style", "").split(";"):
            key, _, value = entry.partition(":")
            if key.strip() == name:
                return value.strip()
        return self.attributes.get(name, default).strip()

    def all(self) -> Iterator["Element"]:
        """The element and all within it."""
        yield self
        for child in self.children:
            yield from child.all()


def svg_tree(text: str) -> Element:
    """Root element of a file.

    Raises:
        ToolpathError: "line 12: ..." for broken XML, an entity outside the file, elements that are
            too many or too deep, or another root.
    """
    reader = _Reader()
    # the text is decoded already, whatever encoding it states
    parser = expat.ParserCreate("UTF-8", " ")
    parser.StartElementHandler = lambda name, given: reader.start(
        name, given, parser.CurrentLineNumber
    )
    parser.EndElementHandler = lambda name: reader.open.pop()
    parser.EntityDeclHandler = lambda name, parameter, value, base, place, public, notation: (
        _check_inside(name, value, parser.CurrentLineNumber)
    )
    try:
        parser.Parse(text.encode("utf-8", "surrogatepass"), True)
    except expat.ExpatError as error:
        fault = expat.errors.messages[error.code]
        raise ToolpathError(f"line {error.lineno}: broken XML: {fault}") from None
    if reader.root is None or reader.root.name != "svg":
        raise ToolpathError("not an SVG file: its root is no svg element")
    return reader.root


class _Reader:
    def __init__(self):
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0

    def start(self, name: str, given: dict[str, str], line: int) -> None:
        self.count += 1
        if self.count > MOST_MOVES:
            raise ToolpathError(f"line {line}: more than {MOST_MOVES} elements")
        if len(self.open) == DEEPEST:
            raise ToolpathError(f"line {line}: elements more than {DEEPEST} deep")
        space, _, last = name.rpartition(" ")
        attributes = {}
        for key, value in given.items():
            namespace, _, own = key.rpartition(" ")
            attributes[f"inkscape:{own}" if namespace == INKSCAPE else own] = value
        element = Element(last if space in ("", SVG) else "", line, attributes)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)


def _check_inside(name: str, value: str | None, line: int) -> None:
    if value is None:
        raise ToolpathError(
            f"line {line}: the entity {shown(name)} is outside the file and is not read"
        )
