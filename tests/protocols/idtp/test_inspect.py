"""`imuscope inspect` of IDTP: keys, modes, replays; and composing the frame from each line."""

import json
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.idtp.frames import build
from imuscope.protocols.idtp.json_codec import frame_from_json
from imuscope.server.cli import main
from tests.protocols.idtp.idtp_vectors import KEY, VECTORS, frame, key_of
from tests.support.each_row import each_row


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """All vectors of the usual key, one after the other."""
    path = tmp_path / "capture.bin"
    path.write_bytes(b"".join(frame(vector) for vector in VECTORS if key_of(vector) in (None, KEY)))
    return path


def lines(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    assert main(["inspect", *arguments, "--format", "jsonl"]) == 0
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_every_vector_comes_back(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    got = lines(capsys, str(file), "--key", KEY.hex(), "--min-mode", "lite", "--no-replay-check")
    assert b"".join(frame_from_json(line, KEY) for line in got) == file.read_bytes()
    assert {line["protocol"] for line in got} == {"idtp"}


def test_modes_and_replays(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def modes(*arguments: str) -> set[int]:
        return {line["fields"]["mode"] for line in lines(capsys, str(file), *arguments)}

    (tmp_path / "key").write_text(KEY.hex() + "\n")
    assert modes() == {0, 1}
    assert modes("--key", f"@{tmp_path / 'key'}") == {2}
    assert modes("--min-mode", "safety") == {1}
    assert modes("--key", KEY.hex(), "--min-mode", "safety") == {1, 2}
    rejects = [line["reject"] for line in lines(capsys, str(file), "--rejects") if "reject" in line]
    assert {"no_key", "stale"} <= set(rejects)
    rejects = [
        line["reject"] for line in lines(capsys, str(file), "--rejects", "--no-replay-check") if "reject" in line
    ]
    assert set(rejects) == {"no_key", "bad_crc8"}  # the preambles inside a refused frame begin nothing


@each_row("case", ["zz", "abc", "", "@nowhere"])
def test_no_key(file: Path, case: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(file), "--key", case]) == 1
    error = [
        line for line in capsys.readouterr().err.splitlines() if "compiling" not in line
    ]  # reported by the first run
    assert len(error) == 1
    assert "key" in error[0]


def test_a_listing_and_the_decoded_columns_of_a_file_have_the_same_frames(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A false number, and numbers that start again: `inspect` listed 501 frames, `decode` wrote 2701."""
    numbers = [*range(1000), *range(1000)]
    numbers[500] = 42_624
    frames = [build(0, bytes(12), sequence=n, timestamp=10_000 * (k + 400 * (k > 999))) for k, n in enumerate(numbers)]
    path = tmp_path / "capture.bin"
    path.write_bytes(b"".join(frames))
    listed = lines(capsys, str(path))
    assert len(listed) == 999  # without the first frame that contradicts the false number, and those that repeat
    assert main(["decode", str(path), "-o", str(tmp_path / "all.csv")]) == 0
    rows = [line for line in (tmp_path / "all_Imu3Acc.csv").read_text().splitlines() if not line.startswith("#")]
    assert len(rows) - 1 == len(listed)
