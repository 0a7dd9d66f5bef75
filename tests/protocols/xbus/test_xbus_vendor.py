"""The tables of Xbus agree with the vendor's headers: their names and numbers are in golden/xbus/vendor.json."""

from __future__ import annotations

import json

from tests.vendor.xsens import KEPT, SOURCE, differences


def test_every_flag_code_and_message_is_the_vendors() -> None:
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    assert kept["source"] == SOURCE
    assert differences(kept["constants"]) == []
    assert len(kept["constants"]["XsXbusMessageId"]) > 300
