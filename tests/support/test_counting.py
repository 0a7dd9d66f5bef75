"""Counted work: the same, whatever earlier tests left behind."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from tests.support.counting import counted_calls


class Ring:
    """An object that only the garbage collector finds, with a finalizer that calls something."""

    def __init__(self) -> None:
        self.itself = self

    def __del__(self) -> None:
        len("called")


@pytest.fixture
def near_collection() -> Iterator[None]:
    """Three hundred finalizers that run once seven hundred more objects are made."""
    before = gc.get_threshold()
    gc.collect()
    gc.set_threshold(1000, *before[1:])
    for _ in range(300):
        Ring()
    yield
    gc.set_threshold(*before)


@pytest.mark.usefixtures("near_collection")
def test_finalizers_of_earlier_tests_do_not_count() -> None:
    with counted_calls() as calls:
        entries = [[number] for number in range(2000)]
    assert len(entries) == 2000
    assert calls.count < 10
    assert gc.isenabled()
