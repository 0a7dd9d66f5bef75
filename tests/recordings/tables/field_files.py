"""Files after real cases of the field, beside the project; tests of them are skipped, with the reason, without it."""

from pathlib import Path

import pytest

from tests.conftest import SHARED

FIELD, CASES = SHARED / "field", SHARED / "cases" / "field"


def field_file(name: str) -> Path:
    """A file of the field; the test is skipped without it."""
    path = FIELD / name if (FIELD / name).is_file() else CASES / name
    if not path.is_file():
        pytest.skip(f"{path} is not there: it is beside the project, not in it")
    return path
