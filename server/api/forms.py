"""Routes of forms: every setting and command of a device, what a form would send, and outputs that fit the line.

`preview`, `fit-rates` and `compare` change nothing and send nothing; they are POST because they carry values, and a
view token may call them (LOOKING in server/access/auth.py).
"""

import asyncio
from functools import lru_cache

from imuscope.protocols.schema.layouts import EncodeError
from imuscope.server.api.configure import OneController
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.configuration.api_models import (
    FitRatesRequest,
    FitRatesResult,
    Forms,
    PreviewRequest,
    PreviewResult,
)
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.form_builder import all_forms, forms_of
from imuscope.server.configuration.preview import fit, preview_command, preview_setting
from imuscope.server.errors import DomainError

router = lazy_router(prefix="/api", tags=["forms"])
_tables = lru_cache(maxsize=1)(all_forms)

UNKNOWN = "The product is not known yet, so everything of its family is listed; read the device to see what it has."


@router.get("/devices/{device}/forms", responses=responses(404, 409, 422))
async def get_forms(controller: OneController) -> Forms:
    """Every setting and command, as forms."""
    known = controller.context
    note = controller.driver.lacking_rules(known) if known.product else UNKNOWN
    return forms_of(controller.driver, controller.member.info.protocol, known, note, controller.values)


@router.post("/devices/{device}/preview", responses=responses(404, 409, 422))
async def preview(body: PreviewRequest, controller: OneController) -> PreviewResult:
    """The frames with the meaning of each byte, problems of the values, and the load of the line."""
    if bool(body.setting) == bool(body.command):
        raise DomainError("bad-request", "Name a setting or a command.", "Exactly one of the two.")
    try:
        if body.setting:
            return preview_setting(controller.present, body.setting, body.values)
        return preview_command(controller.present, body.command, body.values)
    except KeyError:
        raise _unknown(controller, body.setting or body.command) from None


@router.post("/devices/{device}/fit-rates", responses=responses(404, 409, 422))
async def fit_rates(body: FitRatesRequest, controller: OneController) -> FitRatesResult:
    """The same outputs with rates that the line can carry."""
    try:
        return fit(controller.present, body.setting, body.values, body.baud)
    except KeyError:
        raise _unknown(controller, body.setting) from None
    except EncodeError as error:
        raise DomainError("bad-value", f"{error}.", "Correct the value that is marked, then try again.") from None
    except ValueError as error:
        raise DomainError("no-rate", str(error), "Only a serial line has a rate to fit.") from None


@router.get("/commands")
async def get_commands() -> list[Forms]:
    """Every command and setting of every protocol, all products together; GET …/forms has those of one device."""
    return await asyncio.to_thread(_tables)


def _unknown(controller: DeviceController, name: str) -> DomainError:
    return DomainError(
        "not-found",
        f"{controller.member.info.name} has no {name!r:.80}.",
        "Choose one of the list of settings and commands.",
    )
