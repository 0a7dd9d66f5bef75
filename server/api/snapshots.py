"""Snapshots of a device, by serial number, and comparisons between them, devices, files and the factory."""

import asyncio
from dataclasses import replace
from typing import Annotated, Literal

from fastapi import Query
from fastapi.responses import Response

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.server.api.configure import AllControllers, OneController, controller_of
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.configuration.api_models import (
    CompareRequest,
    Difference,
    SaveRequest,
    SideRef,
    SnapshotBody,
    SnapshotInfo,
)
from imuscope.server.configuration.budget import overload
from imuscope.server.configuration.change_plan import TEMPORARY, dangers_of
from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.products import mismatch
from imuscope.server.configuration.settings_diff import NO_DEFAULT, ComparedValues, compare
from imuscope.server.configuration.settings_reader import plain_values
from imuscope.server.configuration.snapshots import Snapshot, SnapshotError
from imuscope.server.errors import DomainError
from imuscope.server.wire.codec import to_json_safe

router = lazy_router(prefix="/api/devices/{device}", tags=["snapshots"])

NOT_READ = "The device has not been read yet."
READ_FIRST = "Read its settings first."
FACTORY_HINT = "Compare with “First contact”, its settings when it was first read here."


def _identity(controller: DeviceController) -> tuple[str, str]:
    """Protocol and serial number, which identify a device's snapshots."""
    return controller.member.info.protocol, controller.context.serial_number


@router.get("/values", responses=responses(404, 409, 422))
async def get_values(controller: OneController) -> SnapshotBody:
    """Values of the device as last read or written; `taken` 0: never read."""
    ports = controller.driver.own_ports(controller.values, controller.context)
    return replace(plain_body(_now(controller), ""), ports=list(ports))


def plain_body(snapshot: Snapshot, name: str) -> SnapshotBody:
    """A snapshot for JSON: integers that JavaScript cannot represent are text."""
    body = snapshot.body(name)
    return replace(body, values=to_json_safe(body.values))


def _now(controller: DeviceController, title: str = "Device, as last read") -> Snapshot:
    known = controller.context
    return Snapshot(
        protocol=controller.member.info.protocol,
        product=known.product,
        serial_number=known.serial_number,
        firmware=known.firmware,
        title=title,
        taken=controller.read_at,
        values=plain_values(controller.values),
        missing=controller.missing,
    )


@router.get("/snapshots", responses=responses(404, 422))
async def list_snapshots(controller: OneController, controllers: AllControllers) -> list[SnapshotInfo]:
    """Snapshots, newest first. Empty while the device's serial number is not known."""
    return await asyncio.to_thread(controllers.snapshots.all, *_identity(controller))


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
    name: str,
    controller: OneController,
    controllers: AllControllers,
    text_format: Annotated[Literal["yaml", "json"], Query(alias="format")] = "yaml",
) -> Response | SnapshotBody:
    """A snapshot as YAML for reading, or as JSON for programs."""
    if text_format == "json":
        return plain_body(await _load(controller, controllers, name), name)
    try:
        text = await asyncio.to_thread(controllers.snapshots.text, *_identity(controller), name)
    except KeyError:
        raise _unknown_snapshot(name) from None
    file = f'attachment; filename="{name}.yaml"' if name.isascii() and '"' not in name else "attachment"
    return Response(text, media_type=YAML, headers={"content-disposition": file})


@router.post("/snapshots", status_code=201, responses=responses(404, 409, 422, 507))
async def keep_snapshot(body: SaveRequest, controller: OneController, controllers: AllControllers) -> SnapshotInfo:
    """Store a snapshot under a name: a given text, or the settings of the device as last read."""
    title = " ".join(body.title.split())[:120]
    if not title:
        raise DomainError("bad-request", "A snapshot needs a name.", "For example: New mast fitted.")
    protocol, serial_number = _identity(controller)
    if body.text:
        parsed = _of_protocol(controller, await _parsed(body.text, controllers))
        snapshot = replace(parsed, title=title, pinned=True, taken=controller.bus.now())
        reason = f"From a file of {snapshot.product or 'a device'} {snapshot.serial_number}".strip()
        snapshot = replace(snapshot, protocol=protocol, serial_number=serial_number, reason=reason, imported=True)
    elif controller.values:
        snapshot = replace(_now(controller, title), reason="Saved by the user", taken=controller.bus.now(), pinned=True)
    else:
        raise DomainError("not-read", NOT_READ, READ_FIRST)
    try:
        return await asyncio.to_thread(controllers.snapshots.save, snapshot, controller.rows)
    except SnapshotError as error:
        raise DomainError("disk", str(error), error.hint) from None


@router.delete("/snapshots/{name}", status_code=204, responses=responses(404, 409, 422))
async def delete_snapshot(name: str, controller: OneController, controllers: AllControllers) -> Response:
    """Delete a snapshot and its file."""
    try:
        await asyncio.to_thread(controllers.snapshots.delete, *_identity(controller), name)
    except KeyError:
        raise _unknown_snapshot(name) from None
    return Response(status_code=204)


@router.post("/compare", responses=responses(404, 409, 422))
async def compare_sides(body: CompareRequest, controller: OneController, controllers: AllControllers) -> Difference:
    """Compare two sides field by field, with the changes that would make the left side equal the right one."""
    left, right = await _side(body.left, controller, controllers), await _side(body.right, controller, controllers)
    result = compare(controller.driver, controller.context, left, right, body.take, body.take_rest)
    if result.changes and body.left.side == "device":
        result = replace(
            result,
            dangers=_dangers(controller, result, controllers.rollback_s),
            blocked=overload(controller.present, result.changes),
            temporary=any(
                controller.driver.line_change(name, controller.values.get(name), values, controller.context)
                for name, values in result.changes.items()
            ),
        )
    rows = [
        replace(row, left_value=to_json_safe(row.left_value), right_value=to_json_safe(row.right_value))
        for row in result.rows
    ]
    return replace(result, rows=rows, changes=to_json_safe(result.changes), profile=to_json_safe(result.profile))


def _dangers(controller: DeviceController, difference: Difference, rollback_s: float) -> list[str]:
    """Risks of writing the right side to this device, in words."""
    words = [mismatch(difference.product, controller.context.product)]
    for name, values in difference.changes.items():
        dangers = dangers_of(controller, controller.rows[name], values)
        words += [danger.consequence for danger in dangers]
        if any(danger.caution == "cuts-line" for danger in dangers):
            words.append(TEMPORARY.format(seconds=rollback_s))
    return [one for one in dict.fromkeys(words) if one]


async def _side(ref: SideRef, controller: DeviceController, controllers: ControllerRegistry) -> ComparedValues:
    match ref.side:
        case "device":
            return _device(controller, "Device, as last read")
        case "other":
            other = _of_same_protocol(controller, controller_of(ref.device, controllers))
            return replace(_device(other, other.member.info.name), of_another=other is not controller)
        case "factory":
            known_context = _with_product(controller)
            defaults = controller.driver.factory(known_context)
            if not defaults:
                message = f"The documentation does not give the factory settings of the {known_context.product}."
                raise DomainError("no-defaults", message, FACTORY_HINT)
            return ComparedValues("Factory default", defaults, otherwise=NO_DEFAULT, product=known_context.product)
        case "snapshot":
            owner = _of_same_protocol(controller, controller_of(ref.device, controllers)) if ref.device else controller
            snapshot = await _load(owner, controllers, ref.snapshot)
            title = snapshot.title or ref.snapshot
            from_device = owner is controller and not snapshot.imported
            return _snapshot(controller, snapshot, title, from_device)
        case "text":
            snapshot = _of_protocol(controller, await _parsed(ref.text, controllers))
            return _snapshot(controller, snapshot, snapshot.title or "File", False)


def _snapshot(controller: DeviceController, snapshot: Snapshot, title: str, from_device: bool) -> ComparedValues:
    return ComparedValues(
        title,
        snapshot.values,
        snapshot.missing,
        product=snapshot.product,
        from_device=from_device,
        of_another=snapshot.imported or snapshot.serial_number not in ("", controller.context.serial_number),
    )


def _device(controller: DeviceController, title: str) -> ComparedValues:
    if not controller.values:
        raise DomainError("not-read", f"{controller.member.info.name} has not been read yet.", READ_FIRST)
    return ComparedValues(title, controller.values, controller.missing, "could not be read", controller.context.product)


def _of_same_protocol(controller: DeviceController, other: DeviceController) -> DeviceController:
    """The other controller; DomainError if its device belongs to another family."""
    if other.member.info.protocol != controller.member.info.protocol:
        message = f"{other.member.info.name} uses another protocol."
        raise DomainError("not-alike", message, "Compare with a device of the same family.")
    return other


def _of_protocol(controller: DeviceController, snapshot: Snapshot) -> Snapshot:
    """The snapshot; DomainError if its file belongs to another family. A file without a protocol is accepted."""
    protocol = controller.member.info.protocol
    if snapshot.protocol not in ("", protocol):
        hint = f"This device uses {protocol}."
        raise DomainError("bad-snapshot", f"This file is of a device that uses {snapshot.protocol}.", hint)
    return snapshot


def _with_product(controller: DeviceController) -> DeviceContext:
    if not controller.context.product:
        raise DomainError("not-read", "The product is not known yet, so its defaults are not.", READ_FIRST)
    return controller.context


async def _load(controller: DeviceController, controllers: ControllerRegistry, name: str) -> Snapshot:
    try:
        return await asyncio.to_thread(controllers.snapshots.get, *_identity(controller), name)
    except KeyError:
        raise _unknown_snapshot(name) from None
    except SnapshotError as error:
        raise DomainError("bad-snapshot", str(error), error.hint) from None


async def _parsed(text: str, controllers: ControllerRegistry) -> Snapshot:
    try:
        return await asyncio.to_thread(controllers.snapshots.read, text)
    except SnapshotError as error:
        raise DomainError("bad-snapshot", str(error), error.hint) from None


def _unknown_snapshot(name: str) -> DomainError:
    return DomainError(
        "not-found",
        f"Snapshot {name!r:.80} not found.",
        "Choose one of the list of snapshots; it may have been deleted.",
    )
