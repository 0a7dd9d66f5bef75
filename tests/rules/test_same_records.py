"""Records with the same fields: one dataclass for one thing."""

import ast
import itertools

from tests.support.source_files import python_files, tree_of

# Records of the same fields that are two, and why.
SAME_FIELDS = {
    ("TimedRows", "_Rows"): "rows of one message, and of several: then each has a size and a message of its own",
    ("Bits", "BitsInfo"): "values of a group are numbers, and decimal text as keys of JSON",
    ("Statistics", "ColumnStatistics"): "JSON has no NaN",
    ("AnalysisOption", "OptionInfo"): "the default of a choice is its number in the one, its text in the other",
    ("ProblemBody", "_Problem"): "a robot may leave out the kind and the hint",
    ("MapInfo", "MapTiles"): "the page is told whether there are tiles, never their address",
    ("ExpressionFunction", "SqlFunction"): "of two extensions, each of which can be left out",
    ("AcknowledgeRequest", "ProfileRequest"): "the device may be left out of one; its limits differ",
    ("CalibrationOptions", "CalibrationOptionsBody"): "a request may leave the axis out",
    ("TableColumnInfo", "StoreColumn"): "types of Arrow, and their names",
    ("Devices", "HealthReport"): "messages differ in `op`",
    ("Devices", "JobsReport"): "messages differ in `op`",
    ("HealthReport", "JobsReport"): "messages differ in `op`",
}


def test_no_two_records_have_the_same_fields() -> None:
    """A record is given out as it is, not copied into another; a list names those that are two, with the reason."""
    records: dict[frozenset[str], list[str]] = {}
    for path in python_files("protocols", "recordings", "server"):
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
                names = frozenset(ast.unparse(one.target) for one in fields if "ClassVar" not in ast.unparse(one))
                if len(names) > 1:
                    records.setdefault(names, []).append(node.name)
    assert len(records) > 300
    pairs = {frozenset(pair) for same in records.values() for pair in itertools.combinations(same, 2)}
    listed = {frozenset(pair) for pair in SAME_FIELDS}
    assert not (new := sorted(map(sorted, pairs - listed))), f"use one record: {new}"
    assert not (gone := sorted(map(sorted, listed - pairs))), f"no longer the same: {gone}"
