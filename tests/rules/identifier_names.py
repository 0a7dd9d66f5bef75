"""Names that a source file binds, and the words that none of them may have.

    tell, say, hear, look, ask …    senses and moods for input and output: report, send, receive, poll, request
    found, given, wanted, kept …    participles as nouns: the name of the thing itself
    MOST, FEW, NEAR …               constants of one vague word: what they limit, and the unit

A participle before a noun (`kept_tags`), after a predicate (`is_kept`, `last_seen`) or at the end of a sentence
(`test_a_marker_is_kept`) is no noun.
"""

import ast
import re
from collections.abc import Iterator

_SENSES = """
    tell tells telling told say says saying said hear hears hearing heard look looks looking looked ask asks
    asking asked knock knocks knocking greet greets greeted hush anew whoever nobody somebody meanwhile
"""
_PARTICIPLES = "found given wanted kept asked taken seen told said heard"
_VAGUE = """
    MOST MANY FEW FEWEST LITTLE ENOUGH USUAL NEAR FAR EACH ROOM SHARE GAP SURE CERTAIN RARE LONG LONGEST SHORTEST
    LARGE LARGEST SMALL SMALLEST TINY DEEPEST WIDEST FASTEST SLOWEST
"""
_PREDICATES = "is are was were has had be been not last first when if test"
SENSES, PARTICIPLES, PREDICATES = (frozenset(words.split()) for words in (_SENSES, _PARTICIPLES, _PREDICATES))
VAGUE = frozenset(_VAGUE.split())
SUSPECT = re.compile(
    f"(?<![a-zA-Z])(?:(?i:{'|'.join(sorted(SENSES | PARTICIPLES))})|{'|'.join(sorted(VAGUE))})(?![a-zA-Z])"
)
_CAPITAL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def is_wrong(name: str) -> bool:
    """Whether a name has a word of sense, has a participle as its noun, or is one vague word in capitals."""
    if name.strip("_") in VAGUE:
        return True
    words = [word.lower() for part in name.strip("_").split("_") for word in _CAPITAL.split(part) if word]
    if not words:
        return False
    return bool(SENSES.intersection(words)) or (words[-1] in PARTICIPLES and words[0] not in PREDICATES)


def bound_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of each variable, parameter, function, class, renamed import and attribute of `self`."""
    for node in ast.walk(tree):
        match node:
            case (
                ast.Name(id=name, ctx=ast.Store())
                | ast.arg(arg=name)
                | ast.FunctionDef(name=name)
                | ast.AsyncFunctionDef(name=name)
                | ast.ClassDef(name=name)
                | ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name, ctx=ast.Store())
                | ast.ExceptHandler(name=str(name))
                | ast.MatchAs(name=str(name))
                | ast.MatchStar(name=str(name))
                | ast.MatchMapping(rest=str(name))
                | ast.alias(asname=str(name))
            ):
                yield getattr(node, "lineno", 0), name
