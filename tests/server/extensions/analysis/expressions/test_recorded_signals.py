"""Computed signals of recordings: their definitions are recorded, and any server that opens the file shows them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from mcap.reader import make_reader
from scipy import signal

from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.live_writer import Limits
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.source import McapSource
from imuscope.server.devices.decode import protocol_set
from imuscope.server.extensions.analysis.expressions.recorded_signals import add_computed_signals
from imuscope.server.library.decode import decode
from imuscope.server.library.decoder_fingerprint import decoding_sources
from imuscope.server.library.recorder import Recorder, RecordingOptions
from imuscope.server.library.recording_detail import channels_of
from imuscope.server.library.signal_definitions import SignalDefinition, SignalDefinitions
from tests.recordings.mcap_files import json_messages
from tests.recordings.recorded_drive import drive
from tests.support.each_row import each_row
from tests.support.recorder_harness import recorder
from tests.support.waiting import until

TOTAL = {"Total": "norm(Acceleration)"}


def opened(tmp_path: Path, signals: Mapping[str, str]) -> ColumnStore:
    path = tmp_path / "a.mcap"
    drive(path, signals=signals)
    compact(path)
    return decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols(), compute=add_computed_signals)


def rows(store: ColumnStore, name: str) -> ExactRows:
    [number] = [number for number, info in channels_of(store).items() if info.name == name]
    return store.exact(number, 0, store.rows(number))


def notices_of(store: ColumnStore) -> list[str]:
    return [one["text"] for one in store.manifest["events"] if one["data"].get("reason") == "computed"]


def test_a_recorded_definition_is_a_channel_with_the_samples_of_its_device(tmp_path: Path) -> None:
    store = opened(tmp_path, TOTAL)
    [info] = [info for info in channels_of(store).values() if info.name == "Total"]
    assert (info.device, info.message, info.unit, info.kind) == ("1", "expression", "m/s²", "scalar")
    source, result = rows(store, "Acceleration"), rows(store, "Total")
    np.testing.assert_allclose(result.columns[0], np.linalg.norm(np.array(source.columns, float), axis=0), rtol=1e-6)
    np.testing.assert_allclose(result.time, source.time, atol=1e-6)
    np.testing.assert_allclose(result.arrival, source.arrival, atol=1e-6)
    assert notices_of(store) == []


def test_a_filter_is_without_delay_and_states_it(tmp_path: Path) -> None:
    store = opened(tmp_path, {"Slow": "lowpass(Acceleration.x, 5 Hz)"})
    [info] = [info for info in channels_of(store).values() if info.name == "Slow"]
    assert "forwards and backwards: lowpass" in info.doc
    source, result = rows(store, "Acceleration"), rows(store, "Slow")
    steps = np.diff(source.time)
    end = int(np.argmax(steps > 5 * np.median(steps))) + 1  # the hole of the drive
    rate = 1 / steps[steps <= 1.5 * np.median(steps)].mean()
    sections = signal.butter(2, 5.0, fs=rate, output="sos")
    expected = signal.sosfiltfilt(sections, np.asarray(source.columns[0][:end], float))
    np.testing.assert_allclose(result.columns[0][:end], expected, atol=1e-6)


def test_signals_may_use_each_other_in_any_order(tmp_path: Path) -> None:
    store = opened(tmp_path, {"Twice": "2 * Total", **TOTAL, "Loop": "Knot + Total", "Knot": "Loop"})
    np.testing.assert_allclose(rows(store, "Twice").columns[0], 2 * rows(store, "Total").columns[0])
    assert [text.partition(":")[0] for text in notices_of(store)] == [
        "The computed signal “Loop” is left out",
        "The computed signal “Knot” is left out",
    ]


def test_a_definition_that_does_not_fit_is_reported_and_the_rest_is_opened(tmp_path: Path) -> None:
    mistakes = {"Odd": "norm(Sped)", "Mixed": "Acceleration + 3 °/s", "Acceleration": "Acceleration.x", "Three": "3 m"}
    store = opened(tmp_path, {**mistakes, **TOTAL})
    assert len(rows(store, "Total")) > 100
    words = notices_of(store)
    assert {text.split("”")[0] for text in words} == {f"The computed signal “{name}" for name in mistakes}
    assert any("Signal Sped not found." in text for text in words)


@each_row("export_format", ["csv", "parquet", "mcap"])
def test_computed_signals_are_exported_as_data(tmp_path: Path, export_format: str) -> None:
    store = opened(tmp_path, TOTAL)
    made = export(export_format, ExportRequest(store), tmp_path / f"run.{export_format}")
    expected = rows(store, "Total").columns[0]
    if export_format == "mcap":
        with made[0].open("rb") as file:
            topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
        assert sum("expression" in topic for topic in topics) == len(expected)
        return
    [file] = [one for one in made if "expression" in one.name]
    if export_format == "csv":
        lines = file.read_text(encoding="utf-8").splitlines()
        heading = next(line for line in lines if "Total" in line and not line.startswith("#"))
        assert "m/s²" in heading
        assert len(lines) >= len(expected) + 1
    else:
        table = pq.read_table(file)
        [name] = [one for one in table.column_names if "Total" in one]
        np.testing.assert_allclose(table[name].to_numpy(), expected)


def test_a_decoded_recording_is_made_again_when_an_expression_would_give_something_else() -> None:
    assert {"expression_functions.py", "recorded_signals.py"} <= {path.name for path in decoding_sources()}


def signals_in(path: Path) -> list[Any]:
    with McapReader(path) as recording:
        return [body["signals"] for _, body in json_messages(recording, "signals/1")]


async def test_definitions_are_recorded_and_those_that_change_too(tmp_path: Path) -> None:
    definitions = SignalDefinitions(tmp_path)
    async with recorder(tmp_path) as (made, plain):
        desk = await made.add("sim:xbus")
        plan = RecordingOptions(tmp_path / "recordings", Limits(), request_header=False)
        one = Recorder(made.telemetry.bus, made.sessions, made.desks, plan, None, signals=definitions)
        total, double = SignalDefinition("Total", "norm(Acceleration)"), SignalDefinition("Double", "2 * Total")
        definitions.put(desk.member.info, total)
        state = await one.start()
        await until(lambda: one.state.behind_s == 0, "it is written")
        definitions.put(desk.member.info, double)
        await one.stop()
        written = [{"name": one.name, "expression": one.expression} for one in (total, double)]
        assert signals_in(tmp_path / "recordings" / f"{state.id}.mcap") == [written[:1], written]
        await plain.close()
