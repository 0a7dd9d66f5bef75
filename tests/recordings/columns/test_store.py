"""A query of a store equals a plain loop over all rows at every zoom, and hides no fault."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from imuscope.recordings.columns import store as module
from imuscope.recordings.columns.rows import ExactRows, MinMaxBuckets
from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from tests.support.each_row import each_row

Array = NDArray[Any]
SHAPE = ChannelLayout(("f4", "u2", "i8"), (False, True, False))
START = 1_760_000_000.0


def rows(n: int, seed: int = 1) -> list[Array]:
    rng = np.random.default_rng(seed)
    arrival = START + np.cumsum(rng.exponential(0.002, n))
    time = arrival - 0.001 - rng.random(n) * 0.0005
    value = rng.normal(size=n).astype(np.float32)
    value[rng.random(n) < 0.01] = np.nan
    flags = np.full(n, 0x0003, np.uint16)
    flags[rng.integers(0, n)] |= 0x0400  # one fault of one sample
    return [arrival, time, value, flags, rng.integers(-(2**40), 2**40, n)]


def made(folder: Path, columns: list[Array], piece: int = 997) -> ColumnStore:
    writer = ColumnStoreWriter(folder)
    writer.channel(7, SHAPE)
    for start in range(0, len(columns[0]), piece):
        writer.append(7, [column[start : start + piece] for column in columns])
    return writer.finish({"title": "a drive"})


def key_of(columns: list[Array]) -> Array:
    return np.maximum.accumulate(np.where(np.isnan(columns[1]), columns[0], columns[1]))


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BLOCK_ROWS", 4096)


def test_a_stretch_is_exactly_its_rows(tmp_path: Path) -> None:
    columns = rows(20_000)
    store = made(tmp_path / "a", columns)
    key = key_of(columns)
    t0, t1 = key[5000], key[14_321]
    results = store.query(7, t0, t1)
    assert isinstance(results, ExactRows)
    inside = (key >= t0) & (key <= t1)
    for got, whole in zip((results.arrival, results.time, *results.columns), columns, strict=True):
        np.testing.assert_array_equal(got, whole[inside])
    assert store.rows(7) == 20_000
    assert store.span(7) == (key[0], key[-1])
    assert store.manifest["title"] == "a drive"


@given(data=st.data())
def test_buckets_agree_with_a_plain_loop(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Each bucket covers at least the rows within it, and none further away than one summary."""
    n = data.draw(st.integers(1, 30_000))
    columns = rows(n, data.draw(st.integers(0, 9)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "BLOCK_ROWS", 4096)
        store = made(tmp_path_factory.mktemp("q") / "a", columns, data.draw(st.integers(1, 9000)))
    base = data.draw(st.sampled_from(["device", "arrival"]))
    key = key_of(columns) if base == "device" else columns[0]
    ends = sorted((data.draw(st.floats(-0.2, 1.2)), data.draw(st.floats(-0.2, 1.2))))
    t0, t1 = (key[0] + f * (key[-1] - key[0]) for f in ends)
    width = data.draw(st.integers(1, 400))
    results = store.query(7, t0, t1, width, base=base)  # type: ignore[arg-type]
    inside = (key >= t0) & (key <= t1)
    if isinstance(results, ExactRows):
        assert inside.sum() <= 2 * width
        np.testing.assert_array_equal(results.columns[2], columns[4][inside])
        return
    assert len(results) <= width
    assert (np.diff(results.t) > 0).all()
    value, flags = columns[2][inside], columns[3][inside]
    assert results.low[0].dtype == np.float32
    assert np.nanmin(results.low[0]) <= np.nanmin(value)
    assert np.nanmax(results.high[0]) >= np.nanmax(value)
    assert np.bitwise_or.reduce(results.low[1]) & np.bitwise_or.reduce(flags) == np.bitwise_or.reduce(flags)
    assert inside.sum() <= results.n.sum() <= inside.sum() + 2 * 4096 / 8 * 2
    # every row is between low and high of a bucket that starts no later than it, and at most one later
    bucket = np.maximum(np.searchsorted(results.t, key[inside], "right") - 1, 0)
    low, high = results.low[0][bucket], results.high[0][bucket]
    previous = np.maximum(bucket - 1, 0)
    low, high = np.fmin(low, results.low[0][previous]), np.fmax(high, results.high[0][previous])
    ok = np.isnan(value) | ((value >= low) & (value <= high))
    assert ok.all()


def test_a_fault_of_one_sample_is_seen_at_every_zoom(tmp_path: Path) -> None:
    columns = rows(100_000)
    store = made(tmp_path / "a", columns)
    for width in (1, 3, 10, 100, 1000, 10_000):
        result = store.query(7, START - 1, START + 1e6, width)
        assert isinstance(result, MinMaxBuckets)
        assert np.count_nonzero(result.low[1] & 0x0400) == 1
        assert not (result.high[1] & 0x0400).any() or width == 10_000
        assert (result.high[1] & 0x0003 == 0x0003).all()


def test_wide_queries_read_little(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seeking reads summaries only, regardless of the length of the range."""
    columns = rows(200_000)
    store = made(tmp_path / "a", columns)
    read = 0
    inner = ColumnStore._column

    def counted(self: ColumnStore, *arguments: Any) -> Array:
        nonlocal read
        array = inner(self, *arguments)
        read += len(array)
        return array

    monkeypatch.setattr(ColumnStore, "_column", counted)
    store.query(7, START - 1, START + 1e6, 50)
    assert 0 < read < 20_000 + 2 * 4096


def test_a_whole_recording_is_read_from_the_overview_alone(tmp_path: Path) -> None:
    """Else its first plot waits for a thousand places of a slow disk."""
    store = made(tmp_path / "a", rows(200_000))
    assert store.span() is not None
    whole = store.query(7, START - 1, START + 1e6, 60)
    reopened = ColumnStore(tmp_path / "a")
    reopened._near = np.empty(0, np.uint8)
    again = reopened.query(7, START - 1, START + 1e6, 60)
    assert isinstance(whole, MinMaxBuckets)
    assert isinstance(again, MinMaxBuckets)
    np.testing.assert_array_equal(whole.t, again.t)
    np.testing.assert_array_equal(whole.low[0], again.low[0])


def test_a_sample_without_a_clock_is_found_by_its_arrival_and_late_ones_are_not_lost(tmp_path: Path) -> None:
    columns = rows(5000)
    columns[1][1000:2000] = np.nan
    columns[1][3000] -= 0.3  # a fix that is older than its neighbours
    store = made(tmp_path / "a", columns)
    result = store.query(7, START - 10, START + 1e6)
    assert isinstance(result, ExactRows)
    np.testing.assert_array_equal(result.time, columns[1])
    np.testing.assert_array_equal(result.arrival, columns[0])
    row = store.row_at(7, columns[0][1500])
    assert columns[0][row] <= columns[0][1500] < columns[0][row + 2]


def test_chosen_columns_alone_are_given(tmp_path: Path) -> None:
    columns = rows(3000)
    store = made(tmp_path / "a", columns)
    result = store.query(7, START - 1, START + 1e6, columns=[2])
    assert isinstance(result, ExactRows)
    assert len(result.columns) == 1
    np.testing.assert_array_equal(result.columns[0], columns[4])


def test_an_empty_channel_and_an_empty_stretch_are_empty(tmp_path: Path) -> None:
    writer = ColumnStoreWriter(tmp_path / "a")
    writer.channel(7, SHAPE)
    store = writer.finish({})
    assert store.span() is None
    assert len(store.query(7, 0, 1, 100)) == 0
    full = made(tmp_path / "b", rows(100))
    assert len(full.query(7, 0, 1, 100)) == 0
    assert full.row_at(7, 0) == -1


def test_a_store_is_written_atomically(tmp_path: Path) -> None:
    writer = ColumnStoreWriter(tmp_path / "a")
    writer.channel(7, SHAPE)
    writer.append(7, rows(10_000))
    assert not (tmp_path / "a").exists()
    writer.abandon()
    assert list(tmp_path.iterdir()) == []
    made(tmp_path / "a", rows(10))
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    made(tmp_path / "a", rows(20))  # again, over the old one
    assert ColumnStore(tmp_path / "a").rows(7) == 20


def test_a_store_of_another_version_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made(tmp_path / "a", rows(10))
    monkeypatch.setattr(module, "VERSION", 99)
    with pytest.raises(ValueError, match="columns of version"):
        ColumnStore(tmp_path / "a")


def test_a_thinned_range_contains_original_rows(tmp_path: Path) -> None:
    columns = rows(50_000)
    store = made(tmp_path / "a", columns)
    key = key_of(columns)
    results = store.thinned(7, key[100], key[40_000], 300)
    assert 250 <= len(results) <= 300
    inside = columns[4][(key >= key[100]) & (key <= key[40_000])]
    assert np.isin(results.columns[2], inside).all()
    assert results.columns[2][-1] == inside[-1]
    assert (np.diff(np.searchsorted(columns[0], results.arrival)) > 0).all()
    assert len(store.thinned(7, key[100], key[200], 300)) == 101


def test_an_unfinished_store_is_readable_and_the_result_is_the_same(tmp_path: Path) -> None:
    columns = rows(20_000)
    writer = ColumnStoreWriter(tmp_path / "a")
    writer.channel(7, SHAPE)
    for n, start in enumerate(range(0, 20_000, 997)):
        writer.append(7, [column[start : start + 997] for column in columns])
        if n in (0, 3, 11):
            so_far = ColumnStore(writer.show({"progress": n / 21}))
            known = so_far.query(7, -np.inf, np.inf)
            assert isinstance(known, ExactRows)
            assert len(known) == min(start + 997, 20_000)
            np.testing.assert_array_equal(known.columns[1], columns[3][: len(known)])
            early = so_far
    store = writer.finish({"title": "a drive"})
    assert early.manifest["progress"] == 11 / 21
    np.testing.assert_array_equal(early.exact(7, 0, 5).arrival, columns[0][:5])  # open readers still can read it
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    whole = store.exact(7, 0, 20_000)
    for got, expected in zip((whole.arrival, *whole.columns), (columns[0], *columns[2:]), strict=True):
        np.testing.assert_array_equal(got, expected)
    plain = made(tmp_path / "b", columns)
    t0, t1 = store.span(7) or (0.0, 0.0)
    coarse, other = store.query(7, t0, t1, 20), plain.query(7, t0, t1, 20)
    assert isinstance(coarse, MinMaxBuckets)
    assert isinstance(other, MinMaxBuckets)
    np.testing.assert_array_equal(coarse.low[1], other.low[1])  # a fault of one sample is in both


@each_row(
    ("name", "content"),
    [
        ("blocks.npy", b""),
        ("blocks.npy", b"garbage"),
        ("columns.bin", b"garbage"),
        ("columns.bin", None),
        ("overview.bin", b""),
        ("manifest.json", b"null"),
        ("manifest.json", b"[" * 100_000),
        ("manifest.json", b'{"version": 0}'),
    ],
)
def test_a_damaged_store_is_refused_when_it_is_opened(tmp_path: Path, name: str, content: bytes | None) -> None:
    made(tmp_path / "a", rows(20_000))
    path = tmp_path / "a" / name
    path.write_bytes(np.random.default_rng(1).bytes(path.stat().st_size) if content is None else content)
    with pytest.raises((ValueError, OSError)):
        ColumnStore(tmp_path / "a")
