"""Snapshots of a device, by serial number, and comparisons between them, devices, files and the factory."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from fastapi.responses import Response

from protocols.transactions import DeviceContext
from server.api.configure import AllDesks, OneDesk, desk_of
from server.api.errors import ApiError, responses
from server.configuration.api_models import Compare, Difference, Keep, SideRef, SnapshotBody, SnapshotInfo
from server.configuration.budget import overload
from server.configuration.controllers import ControllerRegistry
from server.configuration.device_controller import DeviceController
from server.configuration.products import mismatch
from server.configuration.reading import plain_values
from server.configuration.risk_check import dangers_of
from server.configuration.settings_diff import NO_DEFAULT, SideValues, compare
from server.configuration.snapshots import Snapshot, SnapshotError, from_text
from server.wire_codec import to_json_safe

router = APIRouter(prefix="/api/devices/{device}", tags=["snapshots"])

NOT_READ = "The device has not been read yet."
READ_FIRST = "Read its settings first."
FACTORY_HINT = "Compare with “First contact”, which is what it had when it was first read here."


def _who(desk: DeviceController) -> tuple[str, str]:
    """Protocol and serial number: where a device's snapshots are."""
    return desk.session.info.protocol, desk.known.serial_number


@router.get("/values", responses=responses(404, 409, 422))
async def get_values(desk: OneDesk) -> SnapshotBody:
    """What the device has, as last read or written; `taken` 0: never read."""
    return plain_body(_now(desk), "")


def plain_body(snapshot: Snapshot, name: str) -> SnapshotBody:
    """For a page: whole numbers that JavaScript cannot hold are text."""
    body = snapshot.body(name)
    return replace(body, values=to_json_safe(body.values))


def _now(desk: DeviceController, title: str = "Device, as last read") -> Snapshot:
    known = desk.known
    return Snapshot(
        protocol=desk.session.info.protocol,
        product=known.product,
        serial_number=known.serial_number,
        firmware=known.firmware,
        title=title,
        taken=desk.read_at,
        values=plain_values(desk.values),
        missing=desk.missing,
    )


@router.get("/snapshots", responses=responses(404, 422))
async def list_snapshots(desk: OneDesk, desks: AllDesks) -> list[SnapshotInfo]:
    """Newest first. Empty while the device has not told its serial number."""
    return await asyncio.to_thread(desks.snapshots.all, *_who(desk))


YAML = "application/yaml"


@router.get(
    "/snapshots/{name}",
    responses={
        200: {"model": SnapshotBody, "content": {YAML: {"schema": {"type": "string"}}}},
        **responses(404, 409, 422),
    },
    response_model=None,
)
async def get_snapshot(
    name: str, desk: OneDesk, desks: AllDesks, format: Annotated[Literal["yaml", "json"], Query()] = "yaml"
) -> Response | SnapshotBody:
    """As YAML, to read and to keep; as JSON for programs."""
    if format == "json":
        return plain_body(await _load(desk, desks, name), name)
    try:
        text = await asyncio.to_thread(desks.snapshots.text, *_who(desk), name)
    except KeyError:
        raise _none(name) from None
    file = f'attachment; filename="{name}.yaml"' if name.isascii() and '"' not in name else "attachment"
    return Response(text, media_type=YAML, headers={"content-disposition": file})


@router.post("/snapshots", status_code=201, responses=responses(404, 409, 422, 507))
async def keep_snapshot(body: Keep, desk: OneDesk, desks: AllDesks) -> SnapshotInfo:
    """Keep a text, or what the device had when it was last read, under a name."""
    title = " ".join(body.title.split())[:120]
    if not title:
        raise ApiError(422, "bad-request", "A snapshot needs a name.", "For example: New mast fitted.")
    protocol, serial_number = _who(desk)
    if body.text:
        parsed = _of_protocol(desk, await _parsed(body.text))
        snapshot = replace(parsed, title=title, pinned=True, taken=desk.hub.now())
        reason = f"From a file of {snapshot.product or 'a device'} {snapshot.serial_number}".strip()
        snapshot = replace(snapshot, protocol=protocol, serial_number=serial_number, reason=reason, imported=True)
    elif desk.values:
        snapshot = replace(_now(desk, title), reason="Kept by a person", taken=desk.hub.now(), pinned=True)
    else:
        raise ApiError(409, "not-read", NOT_READ, READ_FIRST)
    try:
        return await asyncio.to_thread(desks.snapshots.keep, snapshot, desk.rows)
    except SnapshotError as error:
        raise ApiError(507, "disk", str(error), error.hint) from None


@router.delete("/snapshots/{name}", status_code=204, responses=responses(404, 409, 422))
async def delete_snapshot(name: str, desk: OneDesk, desks: AllDesks) -> Response:
    """Delete a snapshot."""
    try:
        await asyncio.to_thread(desks.snapshots.delete, *_who(desk), name)
    except KeyError:
        raise _none(name) from None
    return Response(status_code=204)


@router.post("/compare", responses=responses(404, 409, 422))
async def compare_sides(body: Compare, desk: OneDesk, desks: AllDesks) -> Difference:
    """Two sides, field by field, and what to write to make the left one what the right one is."""
    left, right = await _side(body.left, desk, desks), await _side(body.right, desk, desks)
    found = compare(desk.driver, desk.known, left, right)
    if found.changes and body.left.side == "device":
        found = replace(found, dangers=_dangers(desk, found), blocked=overload(desk.present, found.changes))
    rows = [
        replace(row, left_value=to_json_safe(row.left_value), right_value=to_json_safe(row.right_value))
        for row in found.rows
    ]
    return replace(found, rows=rows, changes=to_json_safe(found.changes), profile=to_json_safe(found.profile))


def _dangers(desk: DeviceController, found: Difference) -> list[str]:
    """What writing the right side to this device could cost, in words."""
    words = [mismatch(found.product, desk.known.product)]
    for name, values in found.changes.items():
        words += [danger.consequence for danger in dangers_of(desk, desk.rows[name], values)]
    return [one for one in dict.fromkeys(words) if one]


async def _side(ref: SideRef, desk: DeviceController, desks: ControllerRegistry) -> SideValues:
    match ref.side:
        case "device":
            return _device(desk, "Device, as last read")
        case "other":
            other = _alike(desk, desk_of(ref.device, desks))
            return _device(other, other.session.info.name)
        case "factory":
            certain = _certain(desk)
            defaults = desk.driver.factory(certain)
            if not defaults:
                message = f"The document does not tell the factory settings of the {certain.product}."
                raise ApiError(409, "no-defaults", message, FACTORY_HINT)
            return SideValues("Factory default", defaults, otherwise=NO_DEFAULT, product=certain.product)
        case "snapshot":
            owner = _alike(desk, desk_of(ref.device, desks)) if ref.device else desk
            snapshot = await _load(owner, desks, ref.snapshot)
            title = snapshot.title or ref.snapshot
            told = owner is desk and not snapshot.imported
            return SideValues(title, snapshot.values, snapshot.missing, product=snapshot.product, told=told)
        case "text":
            snapshot = _of_protocol(desk, await _parsed(ref.text))
            return SideValues(snapshot.title or "File", snapshot.values, snapshot.missing, product=snapshot.product)


def _device(desk: DeviceController, title: str) -> SideValues:
    if not desk.values:
        raise ApiError(409, "not-read", f"{desk.session.info.name} has not been read yet.", READ_FIRST)
    return SideValues(title, desk.values, desk.missing, "could not be read", desk.known.product)


def _alike(desk: DeviceController, other: DeviceController) -> DeviceController:
    """Another device of the same family."""
    if other.session.info.protocol != desk.session.info.protocol:
        message = f"{other.session.info.name} speaks another protocol."
        raise ApiError(409, "not-alike", message, "Compare with a device of the same family.")
    return other


def _of_protocol(desk: DeviceController, snapshot: Snapshot) -> Snapshot:
    """A file of a device of the same family; one that does not say whose it is may be of any."""
    protocol = desk.session.info.protocol
    if snapshot.protocol not in ("", protocol):
        hint = f"This device speaks {protocol}."
        raise ApiError(422, "bad-snapshot", f"This file is of a device that speaks {snapshot.protocol}.", hint)
    return snapshot


def _certain(desk: DeviceController) -> DeviceContext:
    if not desk.known.product:
        raise ApiError(409, "not-read", "The product is not known yet, so its defaults are not.", READ_FIRST)
    return desk.known


async def _load(desk: DeviceController, desks: ControllerRegistry, name: str) -> Snapshot:
    try:
        return await asyncio.to_thread(desks.snapshots.get, *_who(desk), name)
    except KeyError:
        raise _none(name) from None
    except SnapshotError as error:
        raise ApiError(422, "bad-snapshot", str(error), error.hint) from None


async def _parsed(text: str) -> Snapshot:
    try:
        return await asyncio.to_thread(from_text, text)  # seconds, for the largest
    except SnapshotError as error:
        raise ApiError(422, "bad-snapshot", str(error), error.hint) from None


def _none(name: str) -> ApiError:
    return ApiError(
        404,
        "not-found",
        f"There is no snapshot {name!r:.80}.",
        "Choose one of the list of snapshots; it may have been deleted.",
    )
