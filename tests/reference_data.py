"""Numbers of other programs, from the files in tests/data."""

import json
from pathlib import Path
from typing import Any

DATA = Path(__file__).parent / "data"


def numbers_of(name: str) -> Any:
    """Contents of a file, as `mcnab/plants`."""
    return json.loads((DATA / f"{name}.json").read_text())
