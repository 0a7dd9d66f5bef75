"""The columns of a recording are rebuilt if, and only if, a part of its decoding has changed."""

from __future__ import annotations

import subprocess
import sys

from imuscope.server.library import decoder_fingerprint
from tests.support.server_process import ROOT

RUN = """
import sys
from imuscope.server.library import decode_worker
from imuscope.protocols.registry import families as registry
from imuscope.recordings.importers import open_file as importers
print(*(module for module in sys.modules if module.partition(".")[0] == "imuscope"))
"""


def test_all_that_the_decoding_process_imports_names_its_columns() -> None:
    done = subprocess.run([sys.executable, "-c", RUN], cwd=ROOT, capture_output=True, text=True, check=True)
    results = set(decoder_fingerprint.decoding_sources())
    assert "imuscope.recordings.importers.open_file" in done.stdout
    for module in done.stdout.split():
        place = ROOT.joinpath(*module.split("."))
        there = {place.with_suffix(".py"), place / "__init__.py"} & results
        assert there or decoder_fingerprint.is_simulator(module), module


def test_the_decoding_mark_covers_all_decoders_and_no_simulators() -> None:
    results = {str(path.relative_to(decoder_fingerprint.PACKAGE)) for path in decoder_fingerprint.decoding_sources()}
    assert results >= {
        "recordings/tables/table_source.py",
        "recordings/importers/open_file.py",
        "recordings/readers/vendor_logs.py",
        "protocols/rotations.py",
        "recordings/mcap/messages.py",
        "recordings/readers/message_source.py",
        "recordings/columns/health_history.py",
        "server/wire/codec.py",
        "server/wire/__init__.py",
        "server/library/decode.py",
        "server/devices/device/jitter_causes.py",
        "server/devices/decode/decode_options.py",
        "protocols/registry/families.py",
        "protocols/messages/cdr.py",
        "protocols/xbus/decoder.py",
        "protocols/isb/time_base.py",
        "protocols/isb/logs.py",
        "protocols/clocks/clock_sync.py",
    }
    assert not [name for name in results if name.startswith("protocols/") and "simulator" in name]
