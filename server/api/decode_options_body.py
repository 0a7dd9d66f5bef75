"""Body of requests with decode options: a field for the protocol, and one for each option that the families declare."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, SecretStr, create_model

from imuscope.protocols.family.decode_options import DecodeOption
from imuscope.server.devices.decode.decode_options import (
    DecodeOptionError,
    DecodeOptions,
    checked_options,
    declared_options,
    source_options,
)
from imuscope.server.errors import DomainError

SETTINGS_HINT = "The options of a source are listed at /openapi.json, AddDeviceRequest."
PREFIX = "option_"  # of the fields in Python, because BaseModel has a member named schema
LONGEST: dict[str, int] = {"text": 1000, "secret": 1000, "file": 100_000}


def bad_setting(error: DecodeOptionError) -> DomainError:
    return DomainError("bad-setting", f"{str(error)[:1].upper()}{str(error)[1:]}.", SETTINGS_HINT)


class _ProtocolBody(BaseModel):
    """Decode options of a source."""

    model_config = ConfigDict(extra="forbid")

    protocol: str = Field("", max_length=40, description="name of the protocol; empty to detect it")

    def reading(self) -> DecodeOptions:
        """The checked options.

        Raises:
            DomainError: an option is invalid.
        """
        values = {name: getattr(self, PREFIX + name) for name in declared_options() if hasattr(self, PREFIX + name)}
        try:
            return checked_options(self.protocol, {name: _text(value) for name, value in values.items()})
        except DecodeOptionError as error:
            raise bad_setting(error) from None

    @property
    def option_names(self) -> set[str]:
        return {name.removeprefix(PREFIX) for name in self.model_fields_set} & {"protocol", *declared_options()}


def _text(value: str | bool | SecretStr) -> str:
    if isinstance(value, bool):
        return "1" if value else ""
    return value.get_secret_value() if isinstance(value, SecretStr) else value


def _field(option: DecodeOption) -> tuple[Any, Any]:
    """Type and properties of the field of an option."""
    limit = LONGEST.get(option.kind)
    match option.kind:
        case "flag":
            return bool, Field(False, alias=option.name, description=option.help)
        case "choice":
            values: Any = Literal["", *option.values]
            return values, Field("", alias=option.name, description=option.help)
        case "secret":
            words = f"{option.help}; never returned"
            return SecretStr, Field(SecretStr(""), alias=option.name, max_length=limit, description=words)
        case _:
            return str, Field("", alias=option.name, max_length=limit, description=option.help)


if TYPE_CHECKING:

    class DecodeOptionsBody(_ProtocolBody): ...

else:
    DecodeOptionsBody = create_model(
        "DecodeOptionsBody",
        __base__=_ProtocolBody,
        __doc__=_ProtocolBody.__doc__,
        __module__=__name__,
        **{PREFIX + option.name: _field(option) for option in source_options()},
    )
