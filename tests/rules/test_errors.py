"""Every error a person can meet is one sentence and a hint. `python -m tests.rules.error_catalog` lists them."""

from __future__ import annotations

import re

from imuscope.server.errors import KINDS
from tests.rules.error_catalog import ErrorText, everything, kinds

MAX_LENGTH = 200  # characters, with values filled in
FILLED = 12  # that a brace is counted as
JARGON = re.compile(
    r"\b(None|NoneType|Traceback|[Ee]rrno|[A-Z]\w*(Error|Exception)\b|dict|tuple|str\b|int\b|bool\b|NaN|stderr|stdin"
    r"|asyncio|kwargs|isinstance|invalid literal)"
)
KIND = re.compile(r"[a-z]+(-[a-z]+)*\Z")

NO_HINT: dict[str, str] = {}
"""Errors that say all there is to say: how the message begins → why."""

BY_HTTP = {"not-allowed", "no-view"}
"""Kinds that are put into an error by what was called, not by who calls (api/errors.py, integrations/proxy.py)."""


def listed(wrong: list[ErrorText]) -> str:
    return "\n".join(f"{one.where} {one.sort} [{one.kind}] {one.message!r} → {one.hint!r}" for one in wrong)


def test_the_error_list_is_complete() -> None:
    """A walk that finds little checks little."""
    assert len(everything()) > 250
    for sort in ("DomainError", "LinkError", "RecordingError", "ConfigError", "RefusedError", "JobError", "ViewError"):
        assert any(message.sort == sort for message in everything()), sort


def test_each_is_a_sentence() -> None:
    wrong = [
        output
        for output in everything()
        if not re.match(r"--|[A-Z0-9{“`]|[a-z_]+[ _.{:]", output.message)
        or not output.message.endswith((".", "?", "}"))
        or len(re.sub(r"\{\w*\}", "x" * FILLED, output.message)) > MAX_LENGTH
    ]
    assert not wrong, listed(wrong)


def test_no_message_contains_python_terms() -> None:
    wrong = [
        output
        for output in everything()
        if JARGON.search(re.sub(r"\{\w*\}", "", f"{output.message} {output.hint or ''}"))
    ]
    assert not wrong, listed(wrong)


def test_each_states_what_to_do() -> None:
    wrong = [
        output
        for output in everything()
        if output.hinted and output.hint == "" and not any(output.message.startswith(words) for words in NO_HINT)
    ]
    assert not wrong, listed(wrong)


def test_hints_are_sentences() -> None:
    wrong = [
        message
        for message in everything()
        if message.hint
        and (
            not message.hint.endswith((".", "?", "}", "…"))
            or len(re.sub(r"\{\w*\}", "x" * FILLED, message.hint)) > MAX_LENGTH
        )
    ]
    assert not wrong, listed(wrong)


def test_kinds_are_words_for_programs() -> None:
    wrong = [
        message
        for message in everything()
        if message.kind and not all(KIND.match(kind) for kind in message.kind.split("/"))
    ]
    assert not wrong, listed(wrong)


def test_one_kind_is_one_meaning() -> None:
    """A program acts on the kind: "busy" once meant a port in use and a queue that was full."""
    message = kinds()
    assert len(message) > 150
    assert not [(where, kind) for where, kind, _ in message if kind not in KINDS], "without a row in server/errors.py"
    assert KINDS.keys() - {kind for _, kind, _ in message} == BY_HTTP, "rows that nothing says"
    assert not [one for one in message if one[2] and one[2] != KINDS[one[1]].status]
    meanings = [kind.meaning for kind in KINDS.values()]
    assert len(set(meanings)) == len(meanings)


def test_one_meaning_is_one_kind() -> None:
    by_message: dict[str, set[str]] = {}
    for output in everything():
        if output.kind and re.sub(r"\{\w*\}\W*", "", output.message):
            by_message.setdefault(output.message, set()).add(output.kind)
    assert not {message: results for message, results in by_message.items() if len(results) > 1}


def test_none_refers_users_to_a_route() -> None:
    """Regression: a form showed "POST …/preview tells them all."."""
    wrong = [
        output
        for output in everything()
        if re.search(r"\b(GET|POST|PUT|DELETE) […/]", f"{output.message} {output.hint}")
    ]
    assert not wrong, listed(wrong)
