"""The tables as text and over HTTP: the same rows as the forms."""

import json
from pathlib import Path

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.commands.commands import LINE_CHARS, CommandListRow, forms, manual
from imuscope.server.commands.compose import ComposeError
from imuscope.server.configuration.form_builder import all_forms
from imuscope.server.devices.decode.decode_options import DecodeOptions
from tests.support.server_process import imuscope


def test_every_command_and_setting_is_listed_and_described() -> None:
    listed = {line.strip().partition("  ")[0] for line in manual() if line}
    for one in PROTOCOLS.values():
        if one.configuration.driver is None:
            continue
        rows: list[CommandListRow] = [
            *one.configuration.driver.commands(DeviceContext()),
            *one.configuration.driver.settings(DeviceContext()),
        ]
        for row in rows:
            assert row.name in listed
            text = list(manual(DecodeOptions(one.name), row.name))
            assert text[0].startswith(row.name)
            assert all(len(line) <= LINE_CHARS for line in text), row.name
    assert {forms.protocol for forms in all_forms()} == {"xbus", "isb", "idtp"}


def test_a_command_is_described_with_ranges_meaning_and_source() -> None:
    text = "\n".join(manual(DecodeOptions("xbus"), "SetPeriod"))
    assert "period  u2, 1/115200 s, 225 to 65535, usually 1152" in text
    assert "Source: MT0101P 5.3.5" in text
    assert "`send` requires --yes" in " ".join("\n".join(manual(name="RestoreFactoryDef")).split())


def test_missing_names_are_answered_with_the_nearest() -> None:
    with pytest.raises(ComposeError, match="similar: SetPeriod"):
        list(manual(name="SetPeriot"))


def test_the_tables_for_programs_are_those_of_the_server() -> None:
    assert forms(DecodeOptions()) == all_forms()
    [family] = json.loads(imuscope("commands", "SetPeriod", "--json").stdout)
    assert (family["protocol"], [row["name"] for row in family["commands"]]) == ("xbus", ["SetPeriod"])
    with pytest.raises(ComposeError, match="similar: SetPeriod"):
        forms(DecodeOptions(), "SetPeriode")


def test_described_types_are_listed(tmp_path: Path) -> None:
    """`commands` took no --schema, so what `compose` made of one could be looked up nowhere."""
    schema = tmp_path / "wheels.toml"
    schema.write_text('[[message]]\ntype = 0x80\nname = "Wheels"\n[[message.field]]\nname = "Speed"\ntype = "i16"\n')
    done = imuscope("commands", "--schema", str(schema), "Wheels")
    assert done.returncode == 0, done.stderr
    assert "Speed  i2" in done.stdout
    assert imuscope("commands", "Wheels").returncode == 1
