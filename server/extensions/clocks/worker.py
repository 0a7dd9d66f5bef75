"""Subprocess that decodes the bytes of a live link and measures its clocks.

    python -m imuscope.server.extensions.clocks.worker

The request comes on standard input, one JSON object: folder with bytes.npz (live_time.py), device, protocol,
identity, and the decode options. The result is written beside the bytes, as it is sent.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sources import SourceDevice
from imuscope.recordings.system.parent_death import report_to_parent
from imuscope.recordings.system.resource_limits import TooLong
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.extensions.clocks.live_time import BYTES, RESULT, MemorySource, live_time
from imuscope.server.library.decode import decode
from imuscope.server.system.worker_process import begin
from imuscope.server.wire.codec import to_json_safe

TOO_MUCH = "Measuring the clocks exceeds a limit of this machine."


def _work(request: Mapping[str, Any]) -> None:
    folder = Path(request["folder"])
    device = SourceDevice(request["device"], request["protocol"], request["identity"])
    source = MemorySource(folder / BYTES, device)
    options = DecodeOptions(request["protocol"], request["options"])
    store = decode(source, folder / "columns", all_protocols(), options)
    result = json.dumps(to_json_safe(asdict(live_time(source, store))), ensure_ascii=False, allow_nan=False)
    (folder / RESULT).write_text(result, encoding="utf-8")


def main() -> int:
    """Measure what standard input requests. Returns 0, or 1 after a reported error."""
    try:
        _work(begin(10))
    except RecordingError as error:
        report_to_parent(message=error.message, hint=error.hint)
        return 1
    except (MemoryError, TooLong, OSError):
        report_to_parent(message=TOO_MUCH, hint="A smaller bytes_mb in the configuration leaves less to measure.")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
