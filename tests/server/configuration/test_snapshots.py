"""Snapshots: round trip, names that are never paths, and harmless handling of untrusted text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.stored_settings import settings_of
from imuscope.protocols.schema.fields import Field, Setting
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.recordings.system import bounded_yaml
from imuscope.server.configuration.settings_diff import NO_DEFAULT, ComparedValues, compare
from imuscope.server.configuration.snapshot_text import from_text
from imuscope.server.configuration.snapshots import Snapshot, SnapshotError, Snapshots, to_text
from imuscope.server.configuration.value_format import field_at, title_at, value_at
from tests.support.each_row import each_row

ROWS = {row.name: row for row in XbusDriver().settings(DeviceContext(product="MTi-630"))}
MAX_FILES = 20  # files of one device
OUTPUTS = {"outputs": [{"data_identifier": 0x2010, "output_frequency": 100}]}

leaves = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False, allow_infinity=False)
leaves |= st.text(max_size=20)
values = st.dictionaries(
    st.text(max_size=12),
    st.recursive(
        leaves,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
        max_leaves=6,
    ),
    max_size=4,
)


@given(st.dictionaries(st.text(max_size=12), values, max_size=4), st.text(max_size=30), st.text(max_size=30))
def test_any_values_come_back(settings: dict[str, Any], title: str, why: str) -> None:
    """Strings that YAML takes for numbers, dates or "no", floats without a point, names with colons."""
    snapshot = Snapshot("xbus", "MTi", "0080", title=title, reason=why, taken=1.0, values=settings, missing={"A": why})
    again = from_text(to_text(snapshot, ROWS))
    assert again == snapshot


@each_row("loader", [yaml.SafeLoader, yaml.CSafeLoader])
def test_a_snapshot_is_read_alike_with_and_without_libyaml(loader: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_yaml, "LOADER", loader)
    snapshot = Snapshot("xbus", "MTi", "0080", title="é 😀", taken=1.0, values={"OutputConfiguration": OUTPUTS})
    text = to_text(snapshot, ROWS)
    assert from_text(text) == snapshot
    for line, words in (
        ("a: &x 1", "anchors"),
        ("a: !!set {}", "anchors"),
        ("a: [", "not valid"),
        ("a: " + "[" * 50, "deep"),
    ):
        with pytest.raises(SnapshotError, match=words):
            from_text(f"{text}\n{line}\n")


def test_a_snapshot_is_readable_text() -> None:
    text = to_text(
        Snapshot(
            "xbus",
            "MTi-630",
            "00800001",
            title="Before this change",
            taken=1.0,
            values={"OutputConfiguration": OUTPUTS, "StringOutputType": {"string_types": 0, "frequency": 50}},
            missing={"CanConfig": "message unknown"},
        ),
        ROWS,
    )
    assert "# Settings of MTi-630, serial number 00800001" in text
    assert "      - {data_identifier: 0x2010, output_frequency: 100}  # Quaternion, 100 Hz" in text
    assert "    frequency: 50  # Hz" in text
    assert 'missing:\n  CanConfig: "message unknown"' in text


@each_row(
    ("text", "words"),
    [
        ("", "A snapshot must be names with values"),
        ("- 1", "A snapshot must be names with values"),
        ("imuscope: 0", "not a snapshot of imuscope"),
        ("imuscope: 2", "newer imuscope"),
        ("imuscope: 1\nsettings: 5", "settings must be names with values"),
        ("imuscope: 1\nsettings: {A: 3}", "settings.A must be names with values"),
        ("imuscope: 1\nsettings: {A: {b: 2026-01-01}}", "settings.A.b is a date"),
        ("a: &x [1]\nb: [*x, *x]", "anchors and tags are not allowed"),
        ("a: !!python/object:os.system x", "tags are not allowed"),
        ("a: [1", "not valid YAML"),
        ("[" * 5000, "nested too deeply"),
        ("#" * (1 << 21), "too large"),
    ],
)
def test_invalid_text_is_refused_with_a_reason(text: str, words: str) -> None:
    with pytest.raises(SnapshotError, match=words):
        from_text(text)


def keep(folder: Snapshots, title: str, batch: float = 1.0, **more: Any) -> str:
    return folder.save(Snapshot("xbus", "MTi-630", "0080", title=title, taken=batch, **more), ROWS).name


def test_snapshots_are_listed_by_serial_number_newest_first(tmp_path: Path) -> None:
    folder = Snapshots(tmp_path)
    names = [keep(folder, "Before this change", 1.0), keep(folder, "New mast", 2.0), keep(folder, "New mast", 2.0)]
    assert names[1:] == ["19700101T000002Z-new-mast", "19700101T000002Z-new-mast-2"]
    assert [info.name for info in folder.all("xbus", "0080")] == [names[2], names[1], names[0]]
    assert folder.all("xbus", "0081") == []
    folder.delete("xbus", "0080", names[0])
    assert [info.name for info in folder.all("xbus", "0080")] == [names[2], names[1]]


def test_the_oldest_unpinned_snapshots_are_deleted(tmp_path: Path) -> None:
    folder = Snapshots(tmp_path, max_files=MAX_FILES)
    first = keep(folder, "First contact", 0.0, pinned=True)
    for batch in range(1, MAX_FILES + 3):
        keep(folder, "Before this change", float(batch))
    names = [info.name for info in folder.all("xbus", "0080")]
    assert len(names) == MAX_FILES
    assert first in names
    assert "19700101T000001Z-before-this-change" not in names


def test_a_full_disk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    folder = Snapshots(tmp_path)
    with pytest.raises(SnapshotError, match="No space left on device"):
        keep(folder, "one")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


# ── comparing ────────────────────────────────────────────────────────────────────────────────────────────────────────


def difference(left: dict[str, Any], right: dict[str, Any]) -> Any:
    sides = ComparedValues("Left", left), ComparedValues("Right", right, {"CanConfig": "message unknown"}, NO_DEFAULT)
    return compare(XbusDriver(), DeviceContext(product="MTi-630"), *sides)


def test_outputs_are_compared_by_quantity_whatever_their_order() -> None:
    both = [{"data_identifier": one, "output_frequency": 100} for one in (0x4020, 0x8020)]
    left = {"outputs": [{"data_identifier": 0x2010, "output_frequency": 400}, *both]}
    right = {"outputs": [*reversed(both), {"data_identifier": 0x2015, "output_frequency": 100}]}
    results = difference({"OutputConfiguration": left}, {"OutputConfiguration": right})
    assert [(row.title, row.left, row.right) for row in results.rows] == [
        ("Quaternion", "400 Hz", "100 Hz, Fp12.20, NED")
    ]
    assert results.same == 2
    assert results.changes == {"OutputConfiguration": right}


def test_missing_values_of_a_side_have_a_reason() -> None:
    result = difference({"LocationID": {"location_id": 1}, "CanConfig": {"word": 12}}, {})
    assert result.rows == []
    assert result.missing == {"LocationID": f"Right: {NO_DEFAULT}", "CanConfig": "Right: message unknown"}


def test_read_only_values_are_compared_but_not_written() -> None:
    results = difference({"ProductCode": {"product_code": "A"}}, {"ProductCode": {"product_code": "B"}})
    assert [(row.left, row.right, row.writable) for row in results.rows] == [("A", "B", False)]
    assert results.changes == {}


def test_a_value_has_its_meaning_and_unit() -> None:
    row = Setting("S", (Field("a", "u1", choices={2: "115 200 Bd"}), Field("b", ">f4", unit="°", scale=2.0)))
    text = to_text(Snapshot("xbus", taken=1.0, values={"S": {"a": 2, "b": 1.5}}), {"S": row})
    assert "    a: 2  # 115 200 Bd\n    b: 1.5  # 3 °\n" in text


def test_names_with_points_are_written_too() -> None:
    """wheelConfig.radius was taken for a part of wheelConfig and dropped out of what was to be written."""
    left = {"wheelConfig.radius": 0.1, "wheelConfig.transform.t_b2w": [0.0, 0.0, 1.0], "startupNavDtMs": 4}
    right = {"wheelConfig.radius": 0.2, "wheelConfig.transform.t_b2w": [0.0, 0.5, 1.0], "startupNavDtMs": 4}
    sides = (ComparedValues(name, {"DID_FLASH_CONFIG": one}) for name, one in (("Left", left), ("Right", right)))
    results = compare(IsbDriver(), DeviceContext(), *sides)
    assert [row.path for row in results.rows] == ["wheelConfig.transform.t_b2w", "wheelConfig.radius"]
    changed = {name: right[name] for name in ("wheelConfig.transform.t_b2w", "wheelConfig.radius")}
    assert results.changes == {"DID_FLASH_CONFIG": changed}
    fields = settings_of()["DID_FLASH_CONFIG"].fields
    for path, value in (("wheelConfig.radius", 0.2), ("wheelConfig.transform.t_b2w.1", 0.5)):
        at = field_at(fields, path)
        assert at is not None
        assert path.startswith(at.name)
        assert value_at(right, path) == value
    assert title_at(fields, "wheelConfig.transform.t_b2w.1").endswith(" 2")


def test_an_unreadable_snapshot_is_listed_with_the_reason_and_never_deleted(tmp_path: Path) -> None:
    """Regression: a snapshot of a newer format was missing from the list."""
    folder = Snapshots(tmp_path, max_files=MAX_FILES)
    keep(folder, "Ours", 5.0)
    later = next(tmp_path.rglob("*.yaml")).with_name("19700102T000000Z-new-mast.yaml")
    later.write_text("imuscope: 7\ntitle: New mast\n", encoding="utf-8")
    later.with_name("torn.yaml").write_bytes(b"\xff\xfe")
    results = {info.name: info for info in folder.all("xbus", "0080")}
    newest = results[later.stem]
    assert (newest.title, newest.taken, newest.readable) == ("New mast", 86400.0, False)
    assert "newer imuscope" in newest.reason
    assert "Update imuscope" in newest.reason
    assert "not text" in results["torn"].reason
    assert [info.readable for info in results.values()].count(True) == 1
    for second in range(MAX_FILES + 2):
        keep(folder, "Loose", 10.0 + second)
    assert later.exists()


def test_a_snapshot_under_a_misread_serial_number_is_found(tmp_path: Path) -> None:
    """The words of a 64-bit identifier were read in the wrong order: the device had a folder for each."""
    before = Snapshots(tmp_path)
    for number, title in (("80ABCDEF", "after reading"), ("80ABCDEF00000000", "first contact")):
        before.save(Snapshot("xbus", "MTi-680G", number, title=title, taken=1.0), ROWS)
    driver = XbusDriver()
    now = Snapshots(tmp_path, lambda protocol, number: driver.formerly(number))
    now.save(Snapshot("xbus", "MTi-680G", "0080ABCDEF", title="now", taken=2.0), ROWS)
    results = now.all("xbus", "0080ABCDEF")
    assert {info.title for info in results} == {"after reading", "first contact", "now"}
    for info in results:
        assert now.get("xbus", "0080ABCDEF", info.name).title == info.title
