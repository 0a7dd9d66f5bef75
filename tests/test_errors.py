"""Every error a person can meet is one sentence and a hint. `python -m tests.errors` lists them."""

from __future__ import annotations

import re

from tests.errors import Said, everything

MOST = 200  # characters, with what is filled in
FILLED = 12  # that a brace is counted as
JARGON = re.compile(
    r"\b(None|NoneType|Traceback|[Ee]rrno|[A-Z]\w*(Error|Exception)\b|dict|tuple|str\b|int\b|bool\b|NaN|stderr|stdin"
    r"|asyncio|kwargs|isinstance|invalid literal)"
)
KIND = re.compile(r"[a-z]+(-[a-z]+)*\Z")

NO_HINT: dict[str, str] = {}
"""Errors that say all there is to say: how the message begins → why."""

ALL = everything()


def shown(said: Said) -> str:
    return f"{said.where} {said.sort} [{said.kind}] {said.message!r} → {said.hint!r}"


def listed(wrong: list[Said]) -> str:
    return "\n".join(shown(said) for said in wrong)


def test_the_list_is_all_of_them() -> None:
    """A walk that finds little checks little."""
    assert len(ALL) > 250
    for sort in ("ApiError", "LinkError", "RecordingError", "ConfigError", "RefusedError", "JobError", "ViewError"):
        assert any(said.sort == sort for said in ALL), sort


def test_each_is_a_sentence() -> None:
    wrong = [
        said
        for said in ALL
        if not re.match(r"--|[A-Z0-9{“`]|[a-z_]+[ _.{:]", said.message)
        or not said.message.endswith((".", "?", "}"))
        or len(re.sub(r"\{\w*\}", "x" * FILLED, said.message)) > MOST
    ]
    assert not wrong, listed(wrong)


def test_none_speaks_python() -> None:
    wrong = [said for said in ALL if JARGON.search(re.sub(r"\{\w*\}", "", f"{said.message} {said.hint or ''}"))]
    assert not wrong, listed(wrong)


def test_each_says_what_to_do() -> None:
    wrong = [
        said
        for said in ALL
        if said.hinted and said.hint == "" and not any(said.message.startswith(words) for words in NO_HINT)
    ]
    assert not wrong, listed(wrong)


def test_hints_are_sentences() -> None:
    wrong = [
        said
        for said in ALL
        if said.hint
        and (not said.hint.endswith((".", "?", "}", "…")) or len(re.sub(r"\{\w*\}", "x" * FILLED, said.hint)) > MOST)
    ]
    assert not wrong, listed(wrong)


def test_kinds_are_words_for_programs() -> None:
    wrong = [said for said in ALL if said.kind and not all(KIND.match(kind) for kind in said.kind.split("/"))]
    assert not wrong, listed(wrong)
