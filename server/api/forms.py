"""Forms: every setting and command of a device, what a form would send, and outputs that fit the line.

`preview`, `fit` and `compare` change nothing and send nothing; they are POST because they carry values, and are there
for who may only look, too (LOOKING in server/auth.py).
"""

from __future__ import annotations

from fastapi import APIRouter

from protocols.layouts import EncodeError
from server.api.configure import OneDesk
from server.api.errors import ApiError, responses
from server.configuration.api_models import Fit, FitAnswer, Forms, Preview, PreviewAnswer
from server.configuration.device_controller import DeviceController
from server.configuration.form_builder import forms_of
from server.configuration.preview import fit, preview_command, preview_setting

router = APIRouter(prefix="/api/devices/{device}", tags=["forms"])

UNKNOWN = "The product is not known yet, so all that its family has is listed; read the device to see what it has."


@router.get("/forms", responses=responses(404, 409, 422))
async def get_forms(desk: OneDesk) -> Forms:
    """Every setting and command, as forms."""
    known = desk.known
    return forms_of(desk.driver, desk.session.info.protocol, known, "" if known.product else UNKNOWN, desk.values)


@router.post("/preview", responses=responses(404, 409, 422))
async def preview(body: Preview, desk: OneDesk) -> PreviewAnswer:
    """The frames, what each byte means, what is wrong with the values, what the line would have to carry."""
    if bool(body.setting) == bool(body.command):
        raise ApiError(422, "bad-request", "Name a setting or a command.", "Exactly one of the two.")
    try:
        if body.setting:
            return preview_setting(desk.present, body.setting, body.values)
        return preview_command(desk.present, body.command, body.values)
    except KeyError:
        raise _unknown(desk, body.setting or body.command) from None


@router.post("/fit", responses=responses(404, 409, 422))
async def make_it_fit(body: Fit, desk: OneDesk) -> FitAnswer:
    """The same outputs with rates that the line can carry."""
    try:
        return fit(desk.present, body.setting, body.values, body.baud)
    except KeyError:
        raise _unknown(desk, body.setting) from None
    except EncodeError as error:
        raise ApiError(422, "bad-value", f"{error}.", "Correct the value that is marked, then try again.") from None
    except ValueError as error:
        raise ApiError(409, "no-rate", str(error), "A network or a file carries what it carries.") from None


def _unknown(desk: DeviceController, name: str) -> ApiError:
    return ApiError(
        404,
        "not-found",
        f"{desk.session.info.name} has no {name!r:.80}.",
        "Choose one of the list of settings and commands.",
    )
