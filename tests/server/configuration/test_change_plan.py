"""Change requests before they become jobs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.server.configuration.change_plan import plan_command
from imuscope.server.configuration.device_controller import DeviceController
from tests.support.each_row import each_row

PRESENT = SimpleNamespace(setting_of=lambda command: None, written_by=lambda command, values: None)
DESK = cast(
    DeviceController,
    SimpleNamespace(driver=IsbDriver(), context=DeviceContext(), values={}, unfinished={}, present=PRESENT),
)


@each_row(
    ("command", "case", "sent"),
    [
        ("ASCE", {}, {"options": 0, "messages": []}),
        ("GET_DID_INS_1", {"period": 5}, {"size": 0, "offset": 0, "period": 5}),
        ("DID_RMC.INS", {}, {"options": 0}),
    ],
)
def test_arguments_that_are_left_out_have_their_defaults(
    command: str, case: dict[str, Any], sent: dict[str, Any]
) -> None:
    """These were refused with "is missing", though the fields have defaults and the command line fills them in."""
    values = plan_command(DESK, command, case).values[command]
    assert {name: list(one) if isinstance(one, tuple) else one for name, one in values.items()} == sent
    assert IsbDriver().frame(command, values, DeviceContext())


@each_row(
    ("command", "case"),
    [
        ("DID_SYS_CMD.SAVE_PERSISTENT_MESSAGES", {}),
        ("DID_SYS_CMD.SAVE_FLASH", {}),
        ("SET_DID_SYS_CMD", {"command": 1}),
        ("PERS", {}),
        ("ASCE", {"options": 1 << 9, "messages": [{"id": 7, "period": 1}]}),
        ("DID_RMC.INS", {"options": 1 << 9}),
        ("SET_DID_RMC", {"bits": 0, "options": 1 << 9}),
    ],
)
def test_what_writes_the_flash_memory_needs_confirmation(command: str, case: dict[str, Any]) -> None:
    """The guide promised it, and these ran at once."""
    assert any("flash" in risk.consequence or "every restart" in risk.consequence or "number" in risk.consequence
               for risk in plan_command(DESK, command, case).risks)  # fmt: skip
