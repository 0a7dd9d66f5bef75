"""Lists of callbacks: an odd message ends neither the others nor the one that failed."""

import logging

import pytest

from imuscope.server.concurrency.listeners import CallbackList


def test_a_callback_that_failed_is_called_again(caplog: pytest.LogCaptureFixture) -> None:
    callbacks: CallbackList[[int]] = CallbackList()
    got: dict[str, list[int]] = {"fails": [], "other": []}

    def fails(value: int) -> None:
        got["fails"].append(value)
        if value % 2 == 0:
            raise ValueError("odd numbers only")

    callbacks.add(fails)
    callbacks.add(got["other"].append)
    with caplog.at_level(logging.ERROR, "imuscope.listeners"):
        for value in range(20):
            callbacks.call(value)
    assert got == {"fails": [*range(20)], "other": [*range(20)]}
    assert [record.args for record in caplog.records] == [(1,), (2,), (4,), (8,)]  # of ten: the log is not flooded


def test_a_callback_may_be_removed_while_all_are_called() -> None:
    callbacks: CallbackList[[]] = CallbackList()
    got: list[str] = []

    def once() -> None:
        got.append("once")
        remove()

    remove = callbacks.add(once)
    callbacks.add(lambda: got.append("always"))
    callbacks.call()
    callbacks.call()
    remove()
    assert got == ["once", "always", "always"]
    assert callbacks
