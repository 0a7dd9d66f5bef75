"""Reading and writing a device, commands, keeping, taking back: jobs of server/configuration/device_controller.py.

What could harm (a caution of the table, or a change that could cut the line) is answered with 409 and the consequence
in words until it is sent again with `confirmed`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request, Response

from server import wire
from server.api.errors import ApiError, responses
from server.configuration.api_models import Apply, Raw, ReadWish, Run
from server.configuration.controllers import ControllerRegistry
from server.configuration.dangers import Risk
from server.configuration.device_controller import DeviceController
from server.configuration.products import mismatch
from server.configuration.risk_check import ChangeRequest, discarded, plan_changes, plan_command
from server.configuration.value_format import numbers

router = APIRouter(prefix="/api/devices/{device}", tags=["control"])

MOST_RAW = 4096


def desks_of(request: Request) -> ControllerRegistry:
    desks: ControllerRegistry = request.app.state.desks
    return desks


def desk_of(device: str, desks: Annotated[ControllerRegistry, Depends(desks_of)]) -> DeviceController:
    try:
        return desks.get(device)
    except KeyError:
        raise ApiError(
            404, "not-found", f"There is no device {device:.40}.", "It may have been removed; choose one of the list."
        ) from None


AllDesks = Annotated[ControllerRegistry, Depends(desks_of)]
OneDesk = Annotated[DeviceController, Depends(desk_of)]


def confirmed(dangers: list[Risk], given: bool) -> None:
    """ApiError 409 with what would be lost or cut, unless the person has read it."""
    if dangers and not given:
        words = " ".join(dict.fromkeys(danger.consequence for danger in dangers))
        raise ApiError(409, "confirm", words, "Send it again with `confirmed` once you have read this.")


@router.get("/control", responses=responses(404, 422))
async def get_control(desk: OneDesk) -> wire.ControlState:
    """Queue, running job, trial, the last results."""
    return desk.control


@router.get("/exchange", responses=responses(404, 422))
async def get_exchange(
    desk: OneDesk, before: Annotated[int | None, Query(ge=0)] = None, limit: Annotated[int, Query(ge=1, le=2000)] = 200
) -> list[wire.ExchangeEntry]:
    """The log of the exchange, newest last."""
    desk.log.flush()
    return desk.log.tail(before, limit)


@router.post("/read", status_code=202, responses=responses(404, 409, 422))
async def read_settings(body: ReadWish, desk: OneDesk, desks: AllDesks) -> wire.Job:
    """Read settings into a snapshot. The device does not measure meanwhile."""
    if not desk.rows:
        raise ApiError(409, "no-settings", f"{desk.session.info.name} has no settings.", "It only sends.")
    unknown = [name for name in body.settings or () if name not in desk.rows]
    if unknown:
        raise ApiError(
            404, "not-found", f"There is no setting {unknown[0]!r:.80}.", "Choose one of the list of settings."
        )
    confirmed(discarded(desk), body.confirmed)
    return desk.add("Read all settings", desks.jobs.read(desk, body.settings, body.reason)).job


@router.post("/apply", status_code=202, responses=responses(404, 409, 422))
async def apply(body: Apply, desk: OneDesk, desks: AllDesks) -> wire.Job:
    """Write settings: snapshot, difference, write, read back; on trial where the line could be cut."""
    targets = [desk, *(desk_of(device, desks) for device in dict.fromkeys(body.devices) if device != desk.device)]
    if not body.changes:
        raise ApiError(422, "bad-request", "`changes` holds nothing to write.", "Name a setting and its values.")
    wishes = [await _wish(one, desks, body.changes) for one in targets]
    product = body.product or (desk.known.product if len(targets) > 1 else "")
    others = [Risk("loses-settings", words) for one in targets if (words := mismatch(product, one.known.product))]
    confirmed([*others, *(danger for wish in wishes for danger in wish.dangers)], body.confirmed)
    base = {name: numbers(row.fields, body.base[name]) for name, row in desk.rows.items() if name in body.base}
    tasks = [
        one.add(wish.title, desks.jobs.apply(one, wish.values, body.reason, base if one is desk else None, wish.held))
        for one, wish in zip(targets, wishes, strict=True)
    ]
    return tasks[0].job


async def _wish(
    desk: DeviceController, desks: ControllerRegistry, changes: Mapping[str, Mapping[str, Any]]
) -> ChangeRequest:
    """Settings to write; what the device has told once, according to its snapshots, may go back."""
    who = desk.session.info.protocol, desk.known.serial_number
    return await asyncio.to_thread(plan_changes, desk, changes, lambda: desks.snapshots.told(*who))


@router.post("/run", status_code=202, responses=responses(404, 409, 422))
async def run(body: Run, desk: OneDesk, desks: AllDesks) -> wire.Job:
    """One command. One that writes a setting is applied like any change, with snapshot and way back."""
    wish = plan_command(desk, body.command, body.values)
    confirmed(wish.dangers, body.confirmed)
    if wish.setting:
        return desk.add(wish.title, desks.jobs.apply(desk, wish.values, "")).job
    values = wish.values[body.command]
    work = desks.jobs.run(desk, body.command, values, changes=wish.changes, restarts=wish.restarts)
    return desk.add(wish.title, work).job


@router.post("/raw", status_code=202, responses=responses(404, 409, 422))
async def send_raw(body: Raw, desk: OneDesk, desks: AllDesks) -> wire.Job:
    """Bytes as they are. Nobody checks them, so they are sent only when `confirmed`."""
    try:
        data = bytes.fromhex(body.hex)
    except ValueError:
        raise ApiError(422, "bad-request", "This is not hex.", "Two digits a byte: FA FF 30 00 D1.") from None
    if not 0 < len(data) <= MOST_RAW:
        raise ApiError(422, "bad-request", f"1 to {MOST_RAW} bytes can be sent, not {len(data)}.", "Send it in pieces.")
    words = "Bytes that nobody has checked are sent to the device; they may change anything in it."
    confirmed([Risk("", words)], body.confirmed)
    return desk.add(f"Send {len(data)} bytes", desks.jobs.raw(desk, data)).job


@router.post("/keep", responses=responses(404, 409, 422))
async def keep(desk: OneDesk) -> wire.ControlState:
    """The settings on trial stay."""
    desk.decide(keep=True)
    return desk.control


@router.post("/revert", responses=responses(404, 409, 422))
async def revert(desk: OneDesk) -> wire.ControlState:
    """The settings on trial go back now."""
    desk.decide(keep=False)
    return desk.control


@router.post("/restore", status_code=202, responses=responses(404, 409, 422))
async def restore(desk: OneDesk, desks: AllDesks) -> wire.Job:
    """The guided procedure for a device that answers at no rate."""
    _ = desk.driver
    return desk.add("Restore communication", desks.jobs.restore(desk)).job


@router.delete("/jobs/{job}", status_code=204, responses=responses(404, 409, 422))
async def drop_job(job: int, desk: OneDesk) -> Response:
    """Take a job out of the queue, or stop it; the device measures again."""
    await desk.drop(job)
    return Response(status_code=204)
