"""Work in the background goes after live devices."""

from __future__ import annotations

import os

import pytest

from imuscope.recordings.system.priority import SAME, lower_priority


def test_it_is_nicer_unless_it_must_not_be(monkeypatch: pytest.MonkeyPatch) -> None:
    requests: list[int] = []
    monkeypatch.setattr(os, "nice", requests.append)
    monkeypatch.setenv(SAME, "1")
    lower_priority(10)
    assert requests == []
    monkeypatch.delenv(SAME)
    lower_priority(10)
    assert requests == [10]
