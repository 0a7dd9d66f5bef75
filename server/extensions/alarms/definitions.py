"""Definitions of alarms, as set over HTTP and stored in the data folder."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from imuscope.server import wire

MAX_NAME = 80
MAX_TEXT = 400
MAX_DURATION_S = 3600.0
MAX_RECORDING_S = 86_400.0

Figure = Literal["rate", "loss", "silence", "clock", "link"]
AlarmLevel = Literal["warning", "error"]
Seconds = Annotated[float, Field(ge=0, le=MAX_DURATION_S, allow_inf_nan=False)]
Limit = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ExpressionCondition(_Strict):
    """A condition on signals: `norm(Acceleration) > 3 g`."""

    kind: Literal["expression"] = "expression"
    expression: str = Field(min_length=1, max_length=MAX_TEXT, description="a comparison, or several with and, or, not")
    clear: str = Field(
        default="", max_length=MAX_TEXT, description="limit to clear, for example `2.5 g`; empty: the limit itself"
    )


class FlagCondition(_Strict):
    """A flag or a bit group of a status word."""

    kind: Literal["flag"]
    signal: str = Field(min_length=1, max_length=MAX_TEXT, description="name of the channel: `StatusWord`")
    flag: str = Field(min_length=1, max_length=MAX_TEXT, description="name of the flag")
    is_set: bool = Field(default=True, description="raised while the flag is set; false: while it is clear")


class HealthCondition(_Strict):
    """A figure of a link beyond a limit."""

    kind: Literal["health"]
    figure: Figure = Field(
        description="`rate` below a limit in Hz, `loss` above a limit in % of the samples of 10 s, `silence` longer "
        "than a limit in s, `clock` uncertainty above a limit in ms, `link` lost"
    )
    limit: Limit = Field(default=0, description="not used for `link`")
    clear: Limit | None = Field(default=None, description="limit to clear; null: the limit itself")


AlarmCondition = Annotated[ExpressionCondition | FlagCondition | HealthCondition, Field(discriminator="kind")]


class DeviceFilter(_Strict):
    """The devices that an alarm is for; empty fields fit any device."""

    device: str = Field(default="", max_length=MAX_TEXT, description="serial number, source or name of one device")
    product: str = Field(default="", max_length=MAX_TEXT, description="beginning of the product's name")
    family: str = Field(default="", max_length=MAX_TEXT, description="name of the protocol")

    def fits(self, info: wire.DeviceInfo) -> bool:
        """Whether a device is one of them."""
        return (
            self.device in ("", info.serial_number, info.source, info.name)
            and (info.product or info.name).lower().startswith(self.product.lower())
            and self.family in ("", info.protocol)
        )


class RecordingAction(_Strict):
    """A recording of what led to an alarm and of what followed."""

    before_s: Seconds = Field(default=10.0, description="begins this long before the limit was crossed, from memory")
    after_s: Seconds = Field(default=10.0, description="ends this long after the condition has ended")
    longest_s: float = Field(
        default=600.0,
        ge=1,
        le=MAX_RECORDING_S,
        allow_inf_nan=False,
        description="ends this long after the alarm was raised in any case",
    )
    per_hour: int = Field(default=6, ge=1, le=60, description="most recordings within an hour")
    every_device: bool = Field(default=False, description="records all devices, not only the one of the alarm")


class AlarmDefinition(_Strict):
    """An alarm as set by a user."""

    name: str = Field(min_length=1, max_length=MAX_NAME)
    condition: AlarmCondition
    devices: DeviceFilter = DeviceFilter()
    level: AlarmLevel = "warning"
    raise_s: Seconds = Field(default=0.0, description="the condition has to hold this long before the alarm is raised")
    clear_s: Seconds = Field(default=0.0, description="the signal has to be within the limit to clear this long")
    missing_s: float = Field(
        default=3.0,
        ge=0.1,
        le=MAX_DURATION_S,
        allow_inf_nan=False,
        description="without samples for this long: no data",
    )
    latched: bool = Field(default=False, description="stays raised until it is acknowledged")
    enabled: bool = True
    webhook: str = Field(
        default="",
        max_length=2000,
        description="address (http or https) that each change is posted to as JSON; answers show its host only, and "
        "what they show keeps the stored one",
    )
    recording: RecordingAction | None = Field(default=None, description="starts a recording when it is raised")


class StoredAlarm(_Strict):
    """An alarm with its id, which never changes."""

    id: str = Field(pattern=r"^[a-z0-9]{1,32}$")
    definition: AlarmDefinition
