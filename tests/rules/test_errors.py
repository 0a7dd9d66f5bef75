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
        assert any(said.sort == sort for said in everything()), sort


def test_each_is_a_sentence() -> None:
    wrong = [
        said
        for said in everything()
        if not re.match(r"--|[A-Z0-9{“`]|[a-z_]+[ _.{:]", said.message)
        or not said.message.endswith((".", "?", "}"))
        or len(re.sub(r"\{\w*\}", "x" * FILLED, said.message)) > MAX_LENGTH
    ]
    assert not wrong, listed(wrong)


def test_no_message_contains_python_terms() -> None:
    wrong = [
        said for said in everything() if JARGON.search(re.sub(r"\{\w*\}", "", f"{said.message} {said.hint or ''}"))
    ]
    assert not wrong, listed(wrong)


def test_each_says_what_to_do() -> None:
    wrong = [
        said
        for said in everything()
        if said.hinted and said.hint == "" and not any(said.message.startswith(words) for words in NO_HINT)
    ]
    assert not wrong, listed(wrong)


def test_hints_are_sentences() -> None:
    wrong = [
        said
        for said in everything()
        if said.hint
        and (
            not said.hint.endswith((".", "?", "}", "…"))
            or len(re.sub(r"\{\w*\}", "x" * FILLED, said.hint)) > MAX_LENGTH
        )
    ]
    assert not wrong, listed(wrong)


def test_kinds_are_words_for_programs() -> None:
    wrong = [said for said in everything() if said.kind and not all(KIND.match(kind) for kind in said.kind.split("/"))]
    assert not wrong, listed(wrong)


def test_one_kind_is_one_meaning() -> None:
    """A program acts on the kind: "busy" once meant a port in use and a queue that was full."""
    said = kinds()
    assert len(said) > 150
    assert not [(where, kind) for where, kind, _ in said if kind not in KINDS], "without a row in server/errors.py"
    assert KINDS.keys() - {kind for _, kind, _ in said} == BY_HTTP, "rows that nothing says"
    assert not [one for one in said if one[2] and one[2] != KINDS[one[1]].status]
    meanings = [kind.meaning for kind in KINDS.values()]
    assert len(set(meanings)) == len(meanings)


def test_one_meaning_is_one_kind() -> None:
    by_message: dict[str, set[str]] = {}
    for said in everything():
        if said.kind and re.sub(r"\{\w*\}\W*", "", said.message):
            by_message.setdefault(said.message, set()).add(said.kind)
    assert not {message: found for message, found in by_message.items() if len(found) > 1}


def test_none_refers_users_to_a_route() -> None:
    """Regression: a form showed "POST …/preview tells them all."."""
    wrong = [said for said in everything() if re.search(r"\b(GET|POST|PUT|DELETE) […/]", f"{said.message} {said.hint}")]
    assert not wrong, listed(wrong)
