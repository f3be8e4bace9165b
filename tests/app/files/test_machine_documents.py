import json

import pytest

from jcontour.app.files.machine_documents import SCHEMA, documents
from jcontour.app.files.machine_file import LinearMachineFile


@pytest.mark.parametrize("path", documents(), ids=lambda path: path.name)
def test_the_documents_are_those_of_the_schemas(path):
    again = "run python -m jcontour.app.files.machine_documents"
    assert path.read_text() == documents()[path], again


def test_an_editor_knows_every_field():
    known = json.loads(SCHEMA.read_text())["$defs"]["LinearMachineFile"]
    assert set(known["properties"]) == set(LinearMachineFile.model_fields)
    assert known["required"] == ["A", "B", "C", "dt"]
