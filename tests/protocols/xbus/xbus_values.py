"""Values for every command of every MTi, as a form starts with them."""

from collections.abc import Mapping
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.schema.fields import Command, Field
from imuscope.protocols.schema.validation import bounds
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.products import MODELS

DRIVER = XbusDriver()
UNKNOWN = DeviceContext()
KNOWN = {model.name: DeviceContext(product=f"{model.name}-8A1G6") for model in MODELS.values()}


def sync(args: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "settings": [
            {
                "function": one["function"],
                "line": one["line"],
                "polarity": one["polarity"],
                "trigger_once": one.get("once", 0),
                "skip_first": one.get("skip_first", 0),
                "skip_factor": one.get("skip_factor", 0),
                "pulse_width": one.get("pulse_width_100us", 0),
                "delay_offset_or_clock_period": one.get("delay_100us", one.get("offset_100us", 0)) & 0xFFFF,
            }
            for one in args["list"]
        ]
    }


def sensible(command: Command, known: DeviceContext) -> dict[str, Any]:
    """Values as a form starts with them: defaults, first choices, the least that is allowed."""
    if command.name == "SetCanOutputConfig":
        return {"outputs": [{"can_data_id": 5, "frame_format": 0, "can_id": 0x123, "frequency": 100}]}
    if command.name == "SetPortConfig":
        return {"words": [0x10002, 0x10002, 0]}
    if command.name == "SetOutputConfiguration":
        return {"outputs": [{"data_identifier": 0x1020, "output_frequency": 0xFFFF}]}
    if command.name == "AdjustUTCTime":
        return {"correction": 5}
    return {field.name: sensible_value(field) for field in command.arguments}


def sensible_value(field: Field) -> Any:
    if field.dtype == "bytes":
        return "d300133ed7d30202980edeef34b4bd62ac0941986f33360b98"
    if field.dtype == "ascii":
        return field.doc.partition("Labels: ")[2].split(",")[0] or "General"
    if field.fields:
        record = {part.name: sensible_value(part) for part in field.fields}
        return [record] if field.shape else record
    value = field.default if field.default is not None else max(bounds(field)[0], 0)
    if field.choices and value not in field.choices:
        value = next(iter(field.choices))
    return [value] if field.shape else value


SWEEP = [(name, command) for name in ["", *KNOWN] for command in DRIVER.commands(KNOWN.get(name, UNKNOWN))]
