"""Comparison of two sides: a device, a snapshot, a file, another device, the factory defaults.

    left  ─┐   by setting: missing on a side?  ──> missing, with the reason
           ├─> by field: same meaning (Driver.same)?  ──> same, counted
    right ─┘   no ──> a row: "Acceleration, rate   400 Hz   100 Hz"
                    + changes: values to write to make the left side equal to the right one in the rows to take

Every row that can be written is taken, unless the request chooses otherwise (`take`, `take_rest`); the number that a
user gave to another sensor (Setting.per_sensor) only if the request says so. A value that the product on the left does
not have cannot be written, and its row says why.

Momentary values (Field.momentary: temperatures, counters, the state of a calibration) are not compared, and are not
written back, because writing them could start what they report.

A list of records with a key (Field.key_mask), such as an output configuration or the streams of a port, is a set: its
records are compared by quantity, in any order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver, Values
from imuscope.protocols.schema.fields import Field, Setting
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.schema.shown_values import meant
from imuscope.server.configuration.api_models import Difference, DifferenceRow, FieldProblem
from imuscope.server.configuration.form_builder import flat
from imuscope.server.configuration.value_checks import problems_of, sentence
from imuscope.server.configuration.value_format import (
    OFF,
    entry_title,
    entry_value,
    field_at,
    head_of,
    hex_key,
    key_of,
    record_at,
    shown,
    titled,
    value_at,
    words,
)

NO_DEFAULT = "no default is documented"

HEX = "0x"  # a path of a record with a key goes on with it
NOTHING_CHOSEN: Mapping[str, bool] = {}
Entries = Sequence[Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class ComparedValues:
    """One side of a comparison.

    Args:
        title: displayed title.
        missing: setting → why this side does not have it.
        otherwise: the reason for a missing setting that is not in `missing`.
        product: product of these settings, if known.
        from_device: the device on the left reported them itself, so they may be written whatever the tables allow.
        of_another: they belong to another sensor than the compared device.
    """

    title: str
    values: Mapping[str, Values]
    missing: Mapping[str, str] = field(default_factory=dict)
    otherwise: str = "not in it"
    product: str = ""
    from_device: bool = False
    of_another: bool = False

    def lacks(self, name: str) -> str:
        return self.missing.get(name, self.otherwise)


def compare(
    driver: DeviceDriver,
    known: DeviceContext,
    left: ComparedValues,
    right: ComparedValues,
    take: Mapping[str, bool] = NOTHING_CHOSEN,
    take_rest: bool | None = None,
) -> Difference:
    """The differences, and the values to write to the left side to make it equal to the right one.

    Args:
        take: DifferenceRow.key → whether the values to write contain it.
        take_rest: whether they contain the others; None: as by default.
    """
    result = Difference(left.title, right.title, [], 0, product=right.product)
    rows = {row.name: row for row in driver.settings(known)}
    _unknown_settings(driver, known, rows, right, result)
    for row in rows.values():
        if all(one.momentary for one in row.fields):
            continue
        if row.name not in left.values and row.name not in right.values:
            if row.name in left.missing or row.name in right.missing:
                result.missing[row.name] = f"{left.title}: {left.lacks(row.name)}"
            continue
        if row.name not in left.values or row.name not in right.values:
            side = left if row.name not in left.values else right
            result.missing[row.name] = f"{side.title}: {side.lacks(row.name)}"
            continue
        if (
            not right.from_device
            and row.write
            and any(left.values[row.name].get(name) != value for name, value in right.values[row.name].items())
        ):
            _invalid_values(row, right.values[row.name], result)
        _setting(driver, row, left.values[row.name], right.values[row.name], result)
    for row in rows.values() if not right.from_device else ():
        _refuse_absent_values(driver, known, row, left.values, result)
    for one in result.rows:
        one.key = f"{one.setting}/{one.path}"
        is_usual = not (rows[one.setting].per_sensor and right.of_another) if take_rest is None else take_rest
        one.take = one.writable and take.get(one.key, is_usual)
    for row in rows.values():
        _changes(row, left.values.get(row.name, {}), result)
    return result


def _unknown_settings(
    driver: DeviceDriver,
    known: DeviceContext,
    rows: Mapping[str, Setting],
    right: ComparedValues,
    result: Difference,
) -> None:
    """Report settings that this device does not have: those of another product, or misspelt ones."""
    family = {row.name for row in driver.settings(DeviceContext())}
    for name in right.values:
        if name in rows:
            continue
        if name in family:
            result.missing[name] = f"{known.product or 'This device'} has no such setting"
        else:
            similar = get_close_matches(name, list(rows), 1)
            hint = f"Did you mean {similar[0]}?" if similar else "Leave it out."
            result.problems.append(FieldProblem(name, f"No device of this family has a setting {name!r:.80}.", hint))


def _invalid_values(row: Setting, values: Values, result: Difference) -> None:
    """Report fields of the right side that are misspelt, out of range or of another type."""
    read_only = {one.name for one in row.fields if one.read_only}
    writable = {name: value for name, value in values.items() if name not in read_only}
    for problem in problems_of(row.fields, writable, partial=True):
        result.problems.append(replace(problem, path=f"{row.name}.{problem.path}", hint=_suggestion(row, problem.path)))


def _suggestion(row: Setting, path: str) -> str:
    names = [one.name for one in row.fields]
    similar = [] if path.partition(".")[0] in names else get_close_matches(path, names, 1)
    return f"Did you mean {similar[0]}?" if similar else ""


def _setting(driver: DeviceDriver, row: Setting, left: Values, right: Values, result: Difference) -> None:
    momentary = {one.name for one in row.fields if one.momentary}
    common = {name for name in left if name in right and name not in momentary}
    left, right = ({name: side[name] for name in side if name in common} for side in (left, right))
    if any(problem.path.startswith(f"{row.name}.") for problem in result.problems):
        return  # invalid values cannot be compared
    rows, same = _rows(driver, row, left, right)
    result.rows += rows
    result.same += same
    read_only = {one.name for one in row.fields if one.read_only}
    writable = {name: value for name, value in right.items() if name not in read_only}  # without momentary values
    if row.write and writable:
        result.profile[row.name] = writable


def _refuse_absent_values(
    driver: DeviceDriver, known: DeviceContext, row: Setting, left: Mapping[str, Values], result: Difference
) -> None:
    """Mark each difference whose value this product does not have: written alone, it would be refused."""
    rows = [one for one in result.rows if one.setting == row.name and one.writable]
    own = left.get(row.name, {}) if rows else {}
    before = {one.name: own[one.name] for one in row.fields if one.name in own and not one.read_only}
    try:
        driver.setting_frames(row.name, before, known)
    except (EncodeError, KeyError):
        return  # what the device has is not in the tables either
    for one in rows:
        alone = replace(result, rows=[replace(other, take=other is one) for other in rows], changes={})
        _changes(row, own, alone)
        one.why = _not_listed(row, one, left)
        try:
            driver.setting_frames(row.name, alone.changes[row.name], known)
        except EncodeError as error:
            one.why = sentence(error)
    for one in rows:
        one.writable = not one.why


def _not_listed(row: Setting, one: DifferenceRow, left: Mapping[str, Values]) -> str:
    """Why the device does not take a text: it lists others; "" if it does, or lists none."""
    at = field_at(row.fields, one.path)
    if at is None or at.listed is None:
        return ""
    entries = left.get(at.listed.setting, {}).get(at.listed.records, [])
    texts = {str(entry[at.listed.text]).strip() for entry in entries if entry[at.listed.used]}
    absent = texts and any(part not in texts for part in str(one.right_value).split("/"))
    return f"The device lists {', '.join(sorted(texts))}." if absent else ""


def _changes(row: Setting, left: Values, result: Difference) -> None:
    """Values to write for the rows of a setting that are to be taken."""
    rows = [one for one in result.rows if one.setting == row.name]
    if not any(one.take for one in rows):
        return
    written = dict(result.profile[row.name])
    if row.partial:
        paths = {head_of(one.path, written)[0] for one in rows if one.take}
        written = {name: value for name, value in written.items() if name in paths}
    for one in rows:
        name, rest = head_of(one.path, written)
        if not one.take and name in written:
            written[name] = _as_before(written[name], rest, left[name], one) if rest else left[name]
    result.changes[row.name] = written


def _as_before(after: Any, path: str, before: Any, row: DifferenceRow) -> Any:
    """A value with the left side's at one path in it; the left side's as a whole if only one side has the path."""
    is_entry = path.isdecimal() and None in (row.left_value, row.right_value)
    if is_entry or path.startswith(HEX):
        others = [entry for entry in after if entry is not row.right_value]
        return others if row.left_value is None else [*others, row.left_value]
    if row.left_value is None or row.right_value is None:
        return before
    name, rest = head_of(path, after if isinstance(after, Mapping) else ())
    at = name if isinstance(after, Mapping) else int(name)
    inside = _as_before(after[at], rest, before[at], row) if rest else row.left_value
    if isinstance(after, Mapping):
        return {**after, at: inside}
    return [inside if place == at else one for place, one in enumerate(after)]


def _rows(driver: DeviceDriver, row: Setting, left: Values, right: Values) -> tuple[list[DifferenceRow], int]:
    """Differing fields of one setting, and the number that agree."""
    out: list[DifferenceRow] = []
    same = 0
    for one in row.fields:
        key = key_of(one.fields)
        if key is None or one.name not in left:
            continue
        rows, equal = _keyed_rows(driver, row, one, key, left[one.name], right[one.name])
        out, same = out + rows, same + equal
        left, right = ({name: side[name] for name in side if name != one.name} for side in (left, right))
    rows, equal = _field_rows(driver, row, left, right) if left else ([], 0)
    return out + rows, same + equal


def _field_rows(driver: DeviceDriver, row: Setting, left: Values, right: Values) -> tuple[list[DifferenceRow], int]:
    paths = driver.same(row.name, left, right)
    leaves = {path: (one, value) for path, one, value in flat(row.fields, dict(left))}
    others = {path: (one, value) for path, one, value in flat(row.fields, dict(right))}
    alone = [path for path in paths if _is_entry(row, path) and None in (value_at(left, path), value_at(right, path))]
    rows = [_entry_row(row, path, value_at(left, path), value_at(right, path)) for path in alone]
    paths = [path for path in paths if path not in alone]
    for path in dict.fromkeys([*leaves, *others]):
        if not any(path == one or path.startswith(one + ".") or one.startswith(path + ".") for one in paths):
            continue
        here, there = leaves.get(path), others.get(path)
        one = (here or there or (Field(path), None))[0]
        records = record_at(left, path), record_at(right, path)
        rows.append(_row(row, path, one, here[1] if here else None, there[1] if there else None, records))
    return rows, len(set(leaves) & set(others)) - sum(1 for one in rows if one.path in leaves and one.path in others)


def _is_entry(row: Setting, path: str) -> bool:
    """Whether a path is that of a whole record of a list."""
    at = field_at(row.fields, path)
    return path.rpartition(".")[2].isdecimal() and at is not None and bool(at.fields)


def _entry_row(row: Setting, path: str, left: Any, right: Any) -> DifferenceRow:
    """A record of a list that only one side has, as one difference."""
    at = field_at(row.fields, path) or Field(path)
    here, there = (
        ", ".join(
            f"{titled(one.title or one.name)} {words(one, value, entry)}" for _, one, value in flat(at.fields, entry)
        )
        for entry in (left, right)
    )
    title = f"{row.title or row.name} {int(path.rpartition('.')[2]) + 1}"
    return DifferenceRow(
        row.name, path, title, "", here, there, left, right, writable=bool(row.write) and not at.read_only
    )


def _row(
    row: Setting,
    path: str,
    at: Field,
    left: Any,
    right: Any,
    records: tuple[Values | None, Values | None] = (None, None),
) -> DifferenceRow:
    title = titled(at.title or at.name)
    places = [part for part in path.split(".")[:-1] if part.isdecimal()]
    where = f" {int(places[-1]) + 1}" if places else ""
    return DifferenceRow(
        setting=row.name,
        path=path,
        title=f"{row.title or row.name}{where}, {title}" if len(row.fields) > 1 or places else row.title or title,
        unit=shown(meant(at, records[1] or records[0] or {})).unit,
        left=words(at, left, records[0]),
        right=words(at, right, records[1]),
        left_value=left,
        right_value=right,
        writable=bool(row.write) and not at.read_only,
    )


# ── lists of records with a key ──────────────────────────────────────────────────────────────────────────────────────


def _keyed_rows(
    driver: DeviceDriver, row: Setting, of: Field, key: Field, left: Entries, right: Entries
) -> tuple[list[DifferenceRow], int]:
    """Differing records of a list, by quantity, and the number that agree."""
    sides = [_by_quantity(key, entries) for entries in (left, right)]
    rows, same = [], 0
    for quantity in dict.fromkeys([*sides[0], *sides[1]]):
        here, there = (side.get(quantity) for side in sides)
        texts = [entry_value(entry) for entry in (here, there)]
        pair = [{of.name: [entry] if entry else []} for entry in (here, there)]
        if texts[0] == texts[1] or not driver.same(row.name, *pair):
            same += 1
            continue
        title = entry_title(key, quantity)
        path = f"{of.name}.{hex_key(key, quantity)}"
        rows.append(DifferenceRow(row.name, path, title, "", texts[0], texts[1], here, there, writable=bool(row.write)))
    return rows, same


def _by_quantity(key: Field, entries: Entries) -> dict[int, Mapping[str, Any]]:
    on = [entry for entry in entries if entry.get(key.name) and entry_value(entry) != OFF]
    return {int(entry[key.name]) & key.key_mask: entry for entry in on}
