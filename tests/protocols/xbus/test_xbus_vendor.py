"""The tables of Xbus agree with the vendor's headers: their names and numbers are in golden/xbus/vendor.json."""

from __future__ import annotations

import json

from tests.vendor.xsens import CONSTANTS_FILE, SOURCE, differences


def test_every_flag_code_and_message_is_the_vendors() -> None:
    document = json.loads(CONSTANTS_FILE.read_text(encoding="utf-8"))
    assert document["source"] == SOURCE
    assert differences(document["constants"]) == []
    assert len(document["constants"]["XsXbusMessageId"]) > 300
