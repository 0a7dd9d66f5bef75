"""Evidence files: what is in them, how large they become, what is left out, and that nothing in them can run."""

import html
import re
import resource
import struct
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.idtp.frames import build as idtp
from imuscope.recordings.errors import RecordingError
from imuscope.server.cli import main
from imuscope.server.extensions.evidence.content import About
from imuscope.server.extensions.evidence.document import pieces_of
from imuscope.server.extensions.evidence.position import REDACTED, Scrubber
from imuscope.server.extensions.evidence.request import EvidencePlot, EvidenceRequest, EvidenceSeries
from imuscope.server.extensions.evidence.routes import evidence_work
from imuscope.server.extensions.evidence.series import gaps_in, intervals_for, tick_of
from imuscope.server.extensions.evidence.worker import MAX_BYTES
from imuscope.server.library.api_models import RecordingInfo
from tests.recordings.store_fixtures import START
from tests.server.extensions.evidence.evidence_harness import (
    CHANNELS,
    ECEF,
    LATITUDE,
    LONGITUDE,
    block_in,
    content_in,
    drive,
    made,
    series_in,
)
from tests.support.each_row import each_row

HOSTILE = "</script><script>window.hit=1</script><img src=x onerror=hit()>"


def test_a_short_range_has_every_sample_and_its_figures(tmp_path: Path) -> None:
    store = drive(tmp_path / "store")
    text = made(store, tmp_path / "out.html", cursor_a=START + 3, cursor_b=START + 5)
    rows = store.exact(1, 0, store.rows(1))
    series = series_in(text, "Acceleration", "x")
    assert np.array_equal(block_in(text, series["v"]), rows.columns[0])
    tick = tick_of(content_in(text)["t1"] - content_in(text)["t0"])
    np.testing.assert_allclose(block_in(text, series["t"]) * tick, rows.time - START, atol=1e-6)
    part = (rows.time >= START + 3) & (rows.time <= START + 5)
    values = rows.columns[0].astype(float)
    assert series["between"]["n"] == part.sum() == 201
    assert series["between"]["mean"] == pytest.approx(values[part].mean(), abs=1e-12)
    assert series["figures"]["sigma"] == pytest.approx(values.std(ddof=1), rel=1e-9)
    assert series["figures"]["max"] == values.max()
    assert series["breaks"] == [1000]
    assert "Every sample of the range is in this file." in text
    for words in ("0080A1B2", "1.12.0", "kerb", "20 samples lost.", "12\u2009345"):
        assert words in text


def evidence_of(folder: Path, data: bytes) -> str:
    """The text of the evidence of a file of these bytes; "" if none was made."""
    source, target = folder / "device.bin", folder / "evidence.html"
    source.write_bytes(data)
    return re.sub(r"<[^>]+>", " ", target.read_text()) if main(["decode", str(source), "-o", str(target)]) == 0 else ""


def test_a_counter_that_restarts_within_a_file_leaves_the_loss_unknown(tmp_path: Path) -> None:
    """Regression: 1900 intact frames were missing, with "0 lost", no event, and a "wrong checksum"."""
    numbers = [*range(5000, 5200), *range(190)]
    frames = (idtp(0, struct.pack("<3f", 0, 0, 9.8), sequence=n, timestamp=10_000 * n, mode=1) for n in numbers)
    text = evidence_of(tmp_path, b"".join(frames))
    assert "the device may have restarted" in text
    assert "0 known" in text
    assert "the number of lost samples is not known" in text
    assert "190 intact, but old" in text
    assert "wrong checksum" not in text


def test_quantities_without_a_valid_value_are_called_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Regression: flagged quaternions were "nothing to show. Choose a longer range"."""
    turned = (idtp(6, struct.pack("<4f", 1.3, 0, 0, 0), sequence=n, timestamp=10_000 * n, mode=1) for n in range(50))
    assert evidence_of(tmp_path, b"".join(turned)) == ""
    assert "No sample in this range is valid." in capsys.readouterr().err


def test_a_quantity_in_two_messages_is_there_twice(tmp_path: Path) -> None:
    """Regression: the newer one stood there two times, and the other one never."""
    twin = {**CHANNELS[3], "name": "Acceleration", "title": "Acceleration", "message": "Other"}
    store = drive(tmp_path / "store", channels=[*CHANNELS[:3], twin, CHANNELS[4]])
    text = made(store, tmp_path / "out.html")
    plots = [one for one in content_in(text)["plots"] if one["title"].startswith("Acceleration")]
    assert [one["title"] for one in plots] == ["Acceleration · MTData2", "Acceleration · Other"]
    assert [one["series"][2]["name"] for one in plots] == ["MTData2/Acceleration.z", "Other/Acceleration.z"]
    assert [one["series"][2]["figures"]["max"] for one in plots] == [987.0, pytest.approx(1e-3)]


def test_on_a_full_disk_the_former_file_stays_and_no_part_of_the_new_one(tmp_path: Path) -> None:
    store = drive(tmp_path / "store")
    out = tmp_path / "out.html"
    before = made(store, out)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(OSError, match="too large"):
            made(store, out, About("Another drive"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert out.read_text(encoding="utf-8") == before
    assert {path.name for path in tmp_path.iterdir()} == {"store", "out.html"}


def test_latitudes_keep_their_digits(tmp_path: Path) -> None:
    store = drive(tmp_path / "store")
    text = made(store, tmp_path / "out.html")
    series = series_in(text, "LatLon", "lat")
    assert series["v"]["type"] == "f8"
    assert np.array_equal(block_in(text, series["v"]), store.exact(2, 0, store.rows(2)).columns[0])


def test_only_the_chosen_range_and_plots_are_in_it(tmp_path: Path) -> None:
    store = drive(tmp_path / "store")
    norm = EvidenceSeries('norm("Acceleration")', label="|a|", factor=2.0)
    gone = EvidenceSeries("Nothing.x", label="gone")
    plots = [EvidencePlot("Norm", "m/s²", [norm, gone], low=0.0, high=5.0)]
    text = made(store, tmp_path / "out.html", plots=plots, t0=START + 4, t1=START + 6)
    content = content_in(text)
    assert [(one["title"], len(one["series"]), one["low"], one["high"]) for one in content["plots"]] == [
        ("Norm", 1, 0.0, 5.0)
    ]
    rows = store.exact(1, 400, 601)
    expected = 2 * np.sqrt(sum(np.square(axis.astype(float)) for axis in rows.columns))
    np.testing.assert_allclose(block_in(text, series_in(text, "Norm", "|a|")["v"]), expected, rtol=1e-7)
    assert content["not_shown"] == ["Signal Nothing.x not found."]
    assert content["notes"]["times"] == []
    with pytest.raises(RecordingError, match="nothing to show"):
        made(store, tmp_path / "out.html", t0=START + 100, t1=START + 101)


def test_an_hour_of_1_khz_stays_below_the_limit_and_keeps_its_extremes(tmp_path: Path) -> None:
    store = drive(tmp_path / "store", n=3_600_000, rate=1000.0)
    text = made(store, tmp_path / "out.html")
    size = (tmp_path / "out.html").stat().st_size
    assert 0.6 * MAX_BYTES < size <= MAX_BYTES
    series = series_in(text, "Acceleration", "z")
    low, high = block_in(text, series["low"]), block_in(text, series["high"])
    values = np.concatenate(list(store.values(1, 2, 0, store.rows(1))))
    assert high.max() == 987.0
    assert low.min() == values.min()
    assert series["n"] == 3_600_000
    assert len(low) == series["shown"] > 80_000
    assert series["figures"]["n"] == 3_600_000
    # every sample lies between the extremes of its interval
    tick = tick_of(content_in(text)["t1"] - content_in(text)["t0"])
    at = np.searchsorted(block_in(text, series["t"]) * tick, store.clock(1, 0, 3_600_000) - START + tick, "right") - 1
    outside = (values < low[at]) | (values > high[at])
    assert outside.mean() < 1e-3  # those at an edge, by the rounding of times
    assert re.search(r"Acceleration, z: [\d\u2009]+ of 3\u2009600\u2009000 samples; of each [\d.]+ ms the least", text)


def test_the_name_of_a_file_without_position_is_not_the_title() -> None:
    """A title may be the name of a place."""
    info = RecordingInfo("drive", "Yard of Ada", "drive.mcap", "mcap", 1, None, None, [])
    work = evidence_work(info, [], EvidenceRequest(t0=1.0, t1=2.5, with_position=False))
    assert (work.words, "Yard" in work.stem) == ("Evidence, 1.500 s, without position", False)
    assert evidence_work(info, [], EvidenceRequest()).stem.startswith("Yard")


def test_position_is_left_out_of_everything(tmp_path: Path) -> None:
    store = drive(tmp_path / "store")
    notes = f"Mast at {LATITUDE:.3f}N {LONGITUDE:.3f}E, or 52°13'13\"N 6°53'44\"E, or X {ECEF[0]:.0f} m"
    notes += "; 9.81 m/s² and 4 laps"
    marker = {"time": START + 3, "kind": "note", "text": f"geo:{LATITUDE},{LONGITUDE}", "device": ""}
    about = About(f"Yard {LATITUDE:.2f}", notes, [f"{LONGITUDE:.4f}"], [marker], f"run_{LATITUDE:.4f}.mcap", "mcap")
    named = [EvidencePlot(f"At {LATITUDE:.5f}", "°", [EvidenceSeries("LatLon.lat")])]
    ecef = [EvidencePlot("E", "m", [EvidenceSeries('norm("PositionEcef")')])]
    entries = [EvidencePlot("a", "m/s²", [EvidenceSeries("Acceleration.x", label=f"{LATITUDE:.4f}")])]
    for plots in (None, [*named, *ecef, *entries]):
        text = made(store, tmp_path / "out.html", about, plots=plots, with_position=False)
        plain = html.unescape(text)
        for digits in ("52.22", "6.895", "6.89", "52°", "6°53", "3886", "4699", "5018", "31.5", "geo:5"):
            assert digits not in re.sub(r'id="block-\d+">[^<]*<|\b1\d{9}\.\d+', "<", plain), digits  # nor in unix times
        assert REDACTED in plain
        assert "9.81 m/s² and 4 laps" in plain
        assert "Position left out" in plain
        names = {series["name"] for plot in content_in(text)["plots"] for series in plot["series"]}
        assert not {name for name in names if re.search("LatLon|Ecef|Speed", name)}
        assert any("Acceleration" in name for name in names)
        for plot in content_in(text)["plots"]:
            for series in plot["series"]:
                values = block_in(text, series["v"])
                assert not ((abs(values - LATITUDE) < 1) | (abs(values - LONGITUDE) < 0.1)).any(), series["name"]
    assert f"{LATITUDE:.3f}" in made(store, tmp_path / "all.html", about)
    with pytest.raises(RecordingError, match="nothing to show"):
        made(store, tmp_path / "out.html", plots=named, with_position=False)


@each_row(
    "words",
    ["48.8584 2.2945", "48,8584; 2,2945", "48°51'30.2\"N", "4851.5040,N", "8FW4V75V+8Q", "@48.8584,2.2945,17z"],
)
def test_coordinates_in_texts_are_recognised_without_a_recorded_position(words: str) -> None:
    scrub = Scrubber()
    assert re.sub(r"\D", "", scrub(f"at {words} now").replace(REDACTED, "")) in ("", "17")
    assert scrub.removed >= 1


@each_row("words", ["9.80665 m/s² at 400 Hz", "2026-11-21 14:32:18", "MTi-630 1.12.0, 3 laps, 52 %"])
def test_other_numbers_stay(words: str) -> None:
    assert Scrubber([(52.22, 52.23), (6.89, 6.9)], [(3.88e6, 3.89e6)])(words) == words


class Tags(HTMLParser):
    """Elements of a document and attributes that could run or load something."""

    def __init__(self) -> None:
        super().__init__()
        self.scripts: list[str | None] = []
        self.loads: list[tuple[str, str | None]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.scripts.append(dict(attrs).get("type"))
        self.loads += [one for one in attrs if one[0] in ("src", "href", "style", "action") or one[0].startswith("on")]
        self.loads += [(tag, None)] if tag in ("img", "link", "iframe", "object", "embed", "form", "base") else []


def test_what_others_wrote_cannot_run(tmp_path: Path) -> None:
    device = {
        "id": "1",
        "name": HOSTILE,
        "protocol": "xbus",
        "product": HOSTILE,
        "source": HOSTILE,
        "firmware": HOSTILE,
    }
    events = [{"time": START + 1, "device": "1", "kind": HOSTILE, "level": f'"{HOSTILE}', "text": HOSTILE}]
    snapshots = {"1": {"values": {HOSTILE: {HOSTILE: HOSTILE}}}}
    store = drive(
        tmp_path / "store", devices=[{**device, "serial_number": HOSTILE}], events=events, snapshots=snapshots
    )
    marker = {"time": START + 3, "kind": "note", "text": HOSTILE, "device": ""}
    about = About(HOSTILE, HOSTILE, [HOSTILE], [marker], HOSTILE, HOSTILE)
    plots = [EvidencePlot(HOSTILE, HOSTILE, [EvidenceSeries("Acceleration.x", label=HOSTILE), EvidenceSeries(HOSTILE)])]
    text = made(store, tmp_path / "out.html", about, plots=plots)
    tags = Tags()
    tags.feed(text)
    assert tags.loads == []
    assert set(tags.scripts) == {"application/json", "text/plain", None}
    assert tags.scripts.count(None) == 1
    assert content_in(text)["title"] == HOSTILE
    assert "default-src 'none'; script-src 'sha256-" in text


def test_times_in_notes_lead_to_the_plots(tmp_path: Path) -> None:
    store = drive(tmp_path / "store")  # begins at 08:53:20 UTC
    notes = "kerb [08:53:22.5], turn [08:53:23 – 08:53:24.25], <b>[08:53]</b> [2025-13-40 08:53:23]"
    text = made(store, tmp_path / "out.html", About("A drive", notes))
    assert f'data-time="{START + 2.5!r}">08:53:22.5</button>, turn' in text
    assert f'data-time="{START + 3!r}" data-end="{START + 4.25!r}">08:53:23 – 08:53:24.25</button>' in text
    assert "&lt;b&gt;[08:53]&lt;/b&gt; [2025-13-40 08:53:23]" in text


def test_a_time_after_midnight_is_on_the_next_day() -> None:
    late = 1_760_054_395.0  # 23:59:55 UTC
    assert pieces_of("[00:00:05]", late) == [("00:00:05", late + 10, None)]
    assert pieces_of("a [23:59:55 - 00:00:05]", late) == [("a ", None, None), ("23:59:55 - 00:00:05", late, late + 10)]


def test_gaps_are_judged_by_the_usual_step() -> None:
    assert gaps_in(np.array([0.0, 1.0, 2.0, 3.0, 6.0, 7.0])).tolist() == [4]
    bursts = np.repeat(np.arange(20) * 0.016, 8)  # eight samples at once, every 16 ms
    assert gaps_in(bursts).tolist() == []


def test_intervals_fill_the_room() -> None:
    assert intervals_for([(1000, 12)], 16_000) == 0
    result = intervals_for([(1_000_000, 12), (500, 4)], 1_000_000)
    assert result * (4 + 24) + 500 * 8 <= 1_000_000 < (result + 1) * (4 + 24) + 500 * 8
