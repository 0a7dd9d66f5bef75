"""Checks on the English of docstrings and names: first lines are noun phrases or imperatives, identifiers are nouns,
verbs and terms of the field.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from imuscope.protocols.schema.plural import counted, plural
from tests.rules.identifier_names import SUSPECT, bound_names, is_wrong
from tests.support.each_row import each_row
from tests.support.source_files import ROOT, facts_of, module_docstring, python_files, text_of, tree_of

SOURCES = ("protocols", "recordings", "server")
OPENING = re.compile(
    r"(What|How|Which|Who|Where|Whose|Does|Do|Did|Is|Are|Was|Can|Could|Has|Have|Had|Will|Would|May|Must|Nobody|Somebody"
    r"|Whatever|Whoever|Wherever|And|So|It|They|He|To whom|From whom)\b"
)
PLURAL = re.compile(r"""(['"])s\1 if |else (['"])s\2|\b(['"])\w+\3 if .*== 1 else (['"])\w*s\4""")
SENTENCE = re.compile(r"(?<=[.?!:])\s")
UNWANTED = re.compile(
    r"\b(?:anew|whoever|wherever|nobody|somebody|meanwhile|likewise|thereby|tells?|telling|told|hears?|heard|asked|said"
    r"|(?:a|no|that) person|persons"
    r"|(?<!there )(?:is|are|was|were) no (?!longer\b|more\b|such\b|need\b)[a-z]+"
    r"|what (?:is|was|are|were|has|had|have|arrive[sd]|follows|waits) (?!to\b|it\b)\w+)\b",
    re.IGNORECASE,
)
"""Words of docstrings, comments and messages that a technical writer would not use, with the plain ones: again, in the
meantime, a user, no client; report, receive; is not a …; the received bytes.
"""
ALLOWED_NAMES = {
    ("server/configuration/api_models.py", "taken"): "SnapshotInfo of the HTTP API",
    ("server/configuration/snapshots.py", "taken"): "as in the HTTP API",
    ("server/extensions/calibration/report.py", "seen"): "DirectionCoverage of the HTTP API",
    ("server/extensions/shares/holder/socket_paths.py", "LONGEST"): "changed with the next change of the holder",
}
"""Names that cross to users, by file, and where they cross."""
ALLOWED_TEXTS = {
    *ALLOWED_NAMES,
    *((f"server/extensions/{name}/service.py", "said") for name in ("foxglove", "ros2", "viser")),  # data of an event
}


def docstrings(folder: str) -> Iterator[tuple[str, str]]:
    """Place and text of each docstring."""
    for path in python_files(folder):
        for line, text in facts_of(path).docstrings:
            yield f"{path.relative_to(ROOT)}:{line}", text


def first_sentence(text: str) -> str:
    """The first sentence, on one line."""
    return " ".join(SENTENCE.split(text.strip(), maxsplit=1)[0].split())


@each_row("folder", SOURCES)
def test_docstrings_open_with_a_noun_phrase_or_an_imperative(folder: str) -> None:
    wrong = [
        f"{where} {sentence}"
        for where, text in docstrings(folder)
        if (sentence := first_sentence(text)).endswith("?") or OPENING.match(sentence)
    ]
    assert not wrong, "\n".join(wrong)


@each_row("folder", ["tests", "web"])
def test_modules_open_with_a_noun_phrase_or_an_imperative(folder: str) -> None:
    wrong = [
        f"{where}:1 {sentence}"
        for path in python_files(folder)
        if not re.search(r"(golden|node_modules)/", where := str(path.relative_to(ROOT)))
        and (text := module_docstring(path))
        and (
            (sentence := first_sentence(text)).endswith("?")
            or re.match(r"(What|How|Which|Where|Does|Is|Are)\b", sentence)
        )
    ]
    assert not wrong, "\n".join(wrong)


@each_row("folder", SOURCES)
def test_plurals_come_from_one_function(folder: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{number} {line.strip()}"
        for path in python_files(folder)
        if path != ROOT / "protocols" / "schema" / "plural.py" and PLURAL.search(text_of(path))
        for number, line in enumerate(text_of(path).splitlines(), 1)
        if PLURAL.search(line)
    ]
    assert not wrong, "\n".join(wrong)


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of each line of comments and strings."""
    for token in tokenize.generate_tokens(io.StringIO(text_of(path)).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            yield from enumerate(token.string.splitlines(), token.start[0])


@each_row("folder", SOURCES)
def test_texts_are_plain_english(folder: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line} {match[0]}: {text.strip()[:100]}"
        for path in python_files(folder)
        if UNWANTED.search(text_of(path))
        for line, text in texts(path)
        if (match := UNWANTED.search(text)) and (str(path.relative_to(ROOT)), match[0]) not in ALLOWED_TEXTS
    ]
    assert not wrong, "\n".join([*wrong, "UNWANTED has the plain words."])


def test_an_unwanted_word_is_found() -> None:
    for text in (
        "it begins anew",
        "The worker is told",
        "Nobody reads",
        "This is no frame.",
        "Send what was collected",
    ):
        assert UNWANTED.search(text), text
    for text in ("there is no frame", "it is no longer live", "what to do", "retold"):
        assert not UNWANTED.search(text), text


@each_row("folder", [*SOURCES, "tests"])
def test_identifiers_are_terms_of_the_field(folder: str) -> None:
    wrong = [
        f"{where}:{line} {name}"
        for path in python_files(folder)
        if SUSPECT.search(text_of(path))
        for line, name in bound_names(tree_of(path))
        if is_wrong(name) and ((where := str(path.relative_to(ROOT))), name) not in ALLOWED_NAMES
    ]
    assert not wrong, "\n".join([*wrong, "Name the thing, or the deed: tests/rules/identifier_names.py."])


def test_every_allowed_name_is_needed() -> None:
    bound = {(file, name) for file, _ in ALLOWED_NAMES for _, name in bound_names(tree_of(ROOT / file))}
    assert ALLOWED_NAMES.keys() <= bound, f"no longer needed: {ALLOWED_NAMES.keys() - bound}"


def test_a_word_of_sense_is_found() -> None:
    source = "import a as told\ndef f(asked, kept_tags, is_kept):\n  [given for given in 1]\n  self._seen = look_at = 1"
    wrong = [name for _, name in bound_names(ast.parse(source)) if is_wrong(name)]
    assert sorted(wrong) == ["_seen", "asked", "given", "look_at", "told"]
    assert is_wrong("MarksKept")
    assert is_wrong("_FEW")
    assert not is_wrong("FEW_ROWS")
    assert not is_wrong("last_seen")
    assert not is_wrong("test_a_marker_is_kept")
    assert is_wrong("test_a_loss_is_told")
    assert not is_wrong("lookup")


def test_plurals() -> None:
    assert [counted(n, "gap") for n in (0, 1, 2)] == ["0 gaps", "1 gap", "2 gaps"]
    assert plural(2, "entry", "entries") == "entries"
    assert PLURAL.search("f\"{n} link{'s' if n > 1 else ''}\"")


def test_a_question_is_found() -> None:
    assert OPENING.match("What is recorded?")
    assert not OPENING.match("Recorder: start and stop.")
    assert first_sentence("Ring buffer.\nMore.") == "Ring buffer."
    assert Path(ROOT / "protocols").is_dir()
