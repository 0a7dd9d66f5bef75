"""Routes that read and write a device, run commands, confirm and roll back: jobs of
server/configuration/device_controller.py.

A request that could do harm (a caution of the table, or a change that could cut the line) is answered with 409 and the
consequence in words until it is sent again with `confirmed`.
"""

import asyncio
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any

from fastapi import Depends, Query, Response

from imuscope.protocols.commands.transactions import Risk
from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.configuration.api_models import ApplyRequest, RawRequest, ReadRequest, RunRequest
from imuscope.server.configuration.change_plan import (
    TEMPORARY,
    ChangeRequest,
    discarded,
    plan_changes,
    plan_command,
    risks_of_bytes,
)
from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.products import mismatch
from imuscope.server.configuration.sensor_check import doubts, sensor_of
from imuscope.server.configuration.value_format import numbers
from imuscope.server.errors import DomainError, unknown_device
from imuscope.server.wire import DeviceHealth

router = lazy_router(prefix="/api/devices/{device}", tags=["control"])

MAX_RAW = 4096
MAX_TITLES = 3  # of the settings that are read, in the title of the job
CONFIRM_S = (1, 600)
SEVERAL = "These settings are written to {count} devices: {names}."


def controllers_of(services: TheServices) -> ControllerRegistry:
    return services.controllers


AllControllers = Annotated[ControllerRegistry, Depends(controllers_of)]


def controller_of(device: str, controllers: AllControllers) -> DeviceController:
    try:
        return controllers.get(device)
    except KeyError:
        raise unknown_device(device) from None


OneController = Annotated[DeviceController, Depends(controller_of)]


def wanted_sensor(device: str, controller: OneController) -> str:
    return sensor_of(controller, device)


WantedSensor = Annotated[str, Depends(wanted_sensor)]
"""Serial number of the sensor that a request is for; "" if it names the device by its id."""


def confirmed(dangers: list[Risk], is_confirmed: bool) -> None:
    """Raise DomainError 409 with the consequences, unless the client has confirmed them."""
    if dangers and not is_confirmed:
        words = " ".join(dict.fromkeys(danger.consequence for danger in dangers))
        raise DomainError("confirm", words, "Send it again with `confirmed` once you have read this.")


@router.get("/jobs", responses=responses(404, 422))
async def get_jobs(controller: OneController) -> wire.DeviceJobs:
    """Queue, running job, pending rollback, last results."""
    return controller.job_report


@router.get("/traffic", responses=responses(404, 422))
async def get_traffic(
    controller: OneController,
    before: Annotated[int | None, Query(ge=0)] = None,
    limit: Annotated[int, Query(ge=1, le=2000)] = 200,
) -> list[wire.TrafficEntry]:
    """The traffic log, newest last."""
    controller.log.flush()
    return controller.log.tail(before, limit)


@router.post("/read", status_code=202, responses=responses(404, 409, 422))
async def read_settings(body: ReadRequest, controller: OneController, controllers: AllControllers) -> wire.Job:
    """Read settings into a snapshot. The device does not measure while it is read."""
    if not controller.rows:
        raise DomainError("no-settings", f"{controller.member.info.name} has no settings.", "It only sends.")
    unknown = [name for name in body.settings or () if name not in controller.rows]
    if unknown:
        raise DomainError("not-found", f"Setting {unknown[0]!r:.80} not found.", "Choose one of the list of settings.")
    confirmed(discarded(controller), body.confirmed)
    titles = [controller.rows[name].title or name for name in body.settings or ()]
    title = "Read all settings" if not titles else f"Read {', '.join(titles[:MAX_TITLES])}"
    title += f" and {len(titles) - MAX_TITLES} more" * (len(titles) > MAX_TITLES)
    return controller.add(title, partial(controllers.jobs.read, names=body.settings, reason=body.reason)).job


@router.get("/health", responses=responses(404, 409, 422))
async def get_health(controller: OneController) -> DeviceHealth:
    """Figures of the device: messages and rates, losses, clock, load of the link. 409 until it has sent something."""
    health = controller.bus.health_of(controller.device)
    if health is None:
        raise DomainError("not-now", f"{controller.member.info.name} has sent nothing yet.", "Ask again later.")
    return health


@router.post("/apply", status_code=202, responses=responses(404, 409, 422))
async def apply(
    body: ApplyRequest, controller: OneController, sensor: WantedSensor, controllers: AllControllers
) -> wire.Job:
    """Write settings: snapshot, difference, write, read back; temporary until confirmed where the link could be
    lost, or whatever they are with `confirm_s`. Devices that are named by their key are written only if this sensor is
    still there.
    """
    sensors = {controller.device: sensor}
    targets = [controller]
    for device in body.devices:
        other = controller_of(device, controllers)
        if other.device not in sensors:
            targets.append(other)
            sensors[other.device] = sensor_of(other, device)
    if not body.changes:
        raise DomainError("bad-request", "`changes` is empty.", "Name a setting and its values.")
    if body.confirm_s is not None and not CONFIRM_S[0] <= body.confirm_s <= CONFIRM_S[1]:
        hint = f"Give {CONFIRM_S[0]} … {CONFIRM_S[1]} s, or leave it out."
        raise DomainError("bad-value", f"confirm_s: {body.confirm_s:g} s cannot be the time to confirm.", hint)
    requests = [await _change_request(one, controllers, body.changes) for one in targets]
    product = body.product or (controller.context.product if len(targets) > 1 else "")
    others = [Risk("loses-settings", words) for one in targets if (words := mismatch(product, one.context.product))]
    if len(targets) > 1:
        names = ", ".join(f"{one.member.info.name} {one.context.serial_number}".strip() for one in targets)
        others.insert(0, Risk("", SEVERAL.format(count=len(targets), names=names)))
    is_temporary = any(danger.caution == "cuts-line" for request in requests for danger in request.risks)
    risks = [*others, *(danger for request in requests for danger in request.risks)]
    if is_temporary or (others and body.confirm_s is not None):
        risks.append(Risk("", TEMPORARY.format(seconds=body.confirm_s or controllers.rollback_s)))
    confirmed(risks, body.confirmed)
    base = {name: numbers(row.fields, body.base[name]) for name, row in controller.rows.items() if name in body.base}
    tasks = [
        one.add(
            request.title,
            partial(
                controllers.jobs.apply,
                changes=request.values,
                reason=body.reason,
                base=base if one is controller else None,
                held=request.current,
                confirm_s=body.confirm_s,
                sensor=sensors[one.device],
            ),
        )
        for one, request in zip(targets, requests, strict=True)
    ]
    return tasks[0].job


async def _change_request(
    controller: DeviceController, controllers: ControllerRegistry, changes: Mapping[str, Mapping[str, Any]]
) -> ChangeRequest:
    """Check the changes; values that the device once reported, according to its snapshots, may be written again."""
    device = controller.member.info.protocol, controller.context.serial_number
    return await asyncio.to_thread(plan_changes, controller, changes, lambda: controllers.snapshots.describe(*device))


@router.post("/run", status_code=202, responses=responses(404, 409, 422))
async def run(
    body: RunRequest, controller: OneController, sensor: WantedSensor, controllers: AllControllers
) -> wire.Job:
    """Run a command. A command that writes a setting is applied like any change, with snapshot and rollback."""
    request = plan_command(controller, body.command, body.values)
    reads_first = request.setting or request.changes
    confirmed([*([] if reads_first else doubts(controller, sensor)), *request.risks], body.confirmed)
    if request.setting:
        work = partial(controllers.jobs.apply, changes=request.values, reason="", sensor=sensor)
        return controller.add(request.title, work).job
    values = request.values[body.command]
    work = partial(
        controllers.jobs.run,
        command=body.command,
        values=values,
        changes=request.changes,
        restarts=request.restarts,
        sensor=sensor,
    )
    return controller.add(request.title, work).job


@router.post("/raw", status_code=202, responses=responses(404, 409, 422))
async def send_raw(
    body: RawRequest, controller: OneController, sensor: WantedSensor, controllers: AllControllers
) -> wire.Job:
    """Send bytes unchanged. Framing and checksum are read, the values are not checked: all but one valid message that
    only asks are sent only when `confirmed`. 409 names what they are and do.
    """
    try:
        data = bytes.fromhex(body.hex)
    except ValueError:
        raise DomainError("bad-request", "Invalid hex.", "Write two digits for each byte: FA FF 30 00 D1.") from None
    if not 0 < len(data) <= MAX_RAW:
        raise DomainError("bad-request", f"1 to {MAX_RAW} bytes can be sent, not {len(data)}.", "Send it in pieces.")
    confirmed([*doubts(controller, sensor), *risks_of_bytes(controller, data)], body.confirmed)
    return controller.add(f"Send {len(data)} bytes", partial(controllers.jobs.raw, data=data)).job


@router.post("/confirm", responses=responses(404, 409, 422))
async def confirm(controller: OneController) -> wire.DeviceJobs:
    """Confirm the pending change: the new settings stay."""
    controller.decide(keep=True)
    return controller.job_report


@router.post("/roll-back", responses=responses(404, 409, 422))
async def roll_back(controller: OneController) -> wire.DeviceJobs:
    """Roll the pending change back now."""
    controller.decide(keep=False)
    return controller.job_report


@router.post("/restore", status_code=202, responses=responses(404, 409, 422))
async def restore(controller: OneController, controllers: AllControllers) -> wire.Job:
    """Guided procedure for a device that does not answer at any baud rate."""
    _ = controller.driver
    return controller.add("Restore communication", controllers.jobs.restore).job


@router.delete("/jobs/{job}", status_code=204, responses=responses(404, 409, 422))
async def drop_job(job: int, controller: OneController) -> Response:
    """Take a job out of the queue, or stop it; the device measures again."""
    await controller.drop(job)
    return Response(status_code=204)
