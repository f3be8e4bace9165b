"""The page of the fields of machine files, and a JSON Schema for editors, made from the schemas.

`python -m jcontour.app.files.machine_documents` writes both again.
"""

import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from jcontour.app.files.machine_file import FlexibleAxisFile, LinearMachineFile
from jcontour.app.files.schema import Schema

FOLDER = Path(__file__).parents[1] / "machines"
PAGE = FOLDER.parents[2] / "experiments" / "docs" / "reference" / "machine-file.md"
SCHEMA = FOLDER / "machine-file.schema.json"
TEXT = """# Machine file

JSON. With `machine-file.schema.json` of `jcontour/app/machines` an editor completes it.

{linear}

## A flexible axis

{flexible}
"""


def documents() -> dict[Path, str]:
    """Text of both files."""
    schema = TypeAdapter(LinearMachineFile | FlexibleAxisFile).json_schema()
    page = TEXT.format(linear=_section(LinearMachineFile), flexible=_section(FlexibleAxisFile))
    return {PAGE: page, SCHEMA: json.dumps(schema) + "\n"}


def _section(kind: type[Schema]) -> str:
    schema = kind.model_json_schema()
    head = ["| field | value | default | |", "|---|---|---|---|"]
    return "\n".join([schema["description"], "", *head, *_rows(schema, schema["$defs"], "")])


def _rows(schema: dict[str, Any], nested: dict[str, Any], outer: str) -> list[str]:
    """A row of the table for each field, those of an object after it."""
    rows = []
    for name, field in schema["properties"].items():
        form = field.get("anyOf", [field])[0]
        inner = nested.get(form.get("$ref", "").rpartition("/")[2])
        value = f"`{form['const']}`" if "const" in form else form.get("title", "list of texts")
        default = "" if inner or field.get("default") is None else f"`{field['default']}`"
        if name in schema.get("required", ()):
            default = "required"
        words = " ".join(field["description"].split())
        shown = "object" if inner else value
        rows.append(f"| `{outer}{name}` | {shown} | {default} | {words} |")
        if inner:
            rows += _rows(inner, nested, f"{outer}{name}.")
    return rows


if __name__ == "__main__":
    for path, text in documents().items():
        path.write_text(text)
