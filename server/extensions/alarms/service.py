"""Alarms of a server: which there are, and their evaluation on the samples of all devices.

    bus: samples ─> ids of channels with new rows ─┐
    bus: health, devices, channels ────────────────┤ ten times a second
                                                   └─> AlarmInstance of each alarm and device ─> events, states

A turn reads the new rows of every channel that an alarm needs once, for all alarms. Nothing is sampled or downsampled:
rows wait in the rings of the channel store until the next turn. Turns do not depend on pages that look.
"""

import asyncio
import logging
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from imuscope.server import wire
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.alarm_file import AlarmFile, lasting_name
from imuscope.server.extensions.alarms.conditions import Rows, checked
from imuscope.server.extensions.alarms.definitions import AlarmDefinition, ExpressionCondition, StoredAlarm
from imuscope.server.extensions.alarms.instance import AlarmInstance, AlarmState, compiled
from imuscope.server.extensions.alarms.recording_trigger import RecordingTrigger
from imuscope.server.extensions.alarms.settings import FILE, AlarmSettings
from imuscope.server.extensions.alarms.webhooks import Webhooks, checked_url, shown_url
from imuscope.server.extensions.analysis.expressions.channel_rates import ChannelRates, have_changed
from imuscope.server.extensions.analysis.expressions.live_expression import RateUnknownError
from imuscope.server.library.recorder import Recorder
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.channel_store import ChannelStore
from imuscope.server.text.prometheus import PrometheusText

log = logging.getLogger("imuscope.alarms")

TURN_S = 0.1
SAVE_EVERY = 10  # turns
RATES_EVERY = 5  # turns
MAX_PAST = 60_000  # samples of a channel that filters and moving windows begin with
HEALTH_EVERY = 5  # turns
MAX_ALARMS = 100
MAX_BY = 60  # characters of a name


class AlarmService:
    """All alarms.

    Args:
        store: rows of the channels.
        folder: the data folder.
        recorder: starts the recordings of alarms that have one.
        webhook_hosts: hosts that webhooks may reach though they are this machine or its link.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        store: ChannelStore,
        folder: Path,
        recorder: Recorder,
        webhook_hosts: Sequence[str] = (),
    ) -> None:
        self._bus = bus
        self._trigger = RecordingTrigger(recorder)
        self.webhooks = Webhooks(allowed=webhook_hosts)
        self._store = store
        self._path = folder / FILE
        self._stored: dict[str, StoredAlarm] = {}
        self._instances: dict[tuple[str, str], AlarmInstance] = {}
        self._saved: dict[str, dict[str, dict[str, object]]] = {}
        self._touched: set[int] = set()
        self._positions: dict[int, int] = {}  # channel → sequence number of its first row that no turn has read
        self._opened: set[int] = set()  # channels since the last match: their first rows count too
        self._is_stale = True  # alarms, devices or channels have changed
        self._is_dirty = False
        self._turns = 0
        self._has_work = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._writing = asyncio.Lock()
        bus.samples.subscribe(self._touched.update)
        bus.channels.subscribe(self._channel_opened)
        bus.devices.subscribe(lambda _: self._changed())
        bus.removed.subscribe(lambda _: self._changed())

    def _changed(self) -> None:
        self._is_stale = True
        self._has_work.set()

    def _channel_opened(self, info: wire.ChannelInfo) -> None:
        self._opened.add(info.id)
        self._changed()

    # ── life ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    async def start(self) -> None:
        """Load the alarms and evaluate them from now on."""
        stored = await asyncio.to_thread(AlarmFile.load, self._path)
        if stored.problem:
            self._bus.event("", "alarm", "error", stored.problem)
        self._stored = {one.id: one for one in stored.alarms[:MAX_ALARMS]}
        self._saved = stored.states
        self._task = asyncio.get_running_loop().create_task(self._run(), name="alarms")
        self._trigger.start()

    async def close_trigger(self) -> None:
        """Start no further recording; one that runs is ended by the recorder."""
        await self._trigger.close()

    async def close(self) -> None:
        """Stop the evaluation and store the states."""
        await self.webhooks.close()
        if self._task is None:
            return
        async with self._writing:  # a thread that writes goes on when its task is cancelled, and would be the last
            await end_tasks(self._task)
        if self._is_dirty:
            await self._try_save()

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        began = loop.time()
        while True:
            if not (self._instances or self._is_stale or self._is_dirty):  # there are no alarms
                self._touched.clear()
                self._has_work.clear()
                await self._has_work.wait()
                self._turns = int((loop.time() - began) / TURN_S)  # as if it had not paused
            await asyncio.sleep(TURN_S)
            try:
                self.turn()
            except Exception:  # an error of one turn must not end the evaluation of all alarms
                log.exception("evaluating alarms failed")
            if self._is_dirty and self._turns % SAVE_EVERY == 0:
                await self._try_save()

    async def _try_save(self) -> None:
        try:
            await self._save()
        except DomainError as error:
            log.error("%s %s", error.message, error.hint)

    async def _save(self) -> None:
        """Write the file.

        Raises:
            DomainError: writing failed.
        """
        async with self._writing:
            self._is_dirty = False
            for (alarm, _), instance in self._instances.items():
                self._saved.setdefault(alarm, {})[instance.name] = instance.machine.saved()
            states = {alarm: dict(devices) for alarm, devices in self._saved.items() if alarm in self._stored}
            body = AlarmFile(list(self._stored.values()), states)
            try:
                await asyncio.to_thread(body.save, self._path)
            except OSError as error:
                self._is_dirty = True
                message = f"The alarms cannot be stored: {error.strerror or error}."
                raise DomainError("disk", message, "Free space in the data folder, or make it writable.") from None

    # ── evaluation ───────────────────────────────────────────────────────────────────────────────────────────────────

    def turn(self) -> None:
        """Evaluate all alarms on the new samples."""
        self._turns += 1
        if self._turns % RATES_EVERY == 0:
            self._update_rates()
        if self._is_stale:
            self._is_stale = False
            self._match()
        touched = self._touched & self._positions.keys()
        self._touched.clear()
        rows = {}
        for channel in touched:
            known = self._store.get(channel)
            if known is not None:
                rows[channel] = known.ring.read(self._positions[channel])
                self._positions[channel] = known.ring.total
        now = self._bus.now()
        with_health = self._turns % HEALTH_EVERY == 0
        for instance in self._instances.values():
            try:
                if rows:
                    self._is_dirty |= instance.feed(rows)
                if with_health:
                    info = self._bus.devices.latest.get(instance.device)
                    if info is not None:
                        self._is_dirty |= instance.feed_health(info, self._bus.health_of(instance.device), now)
                self._is_dirty |= instance.tick(now)
                if instance.raises:
                    self._trigger.add(instance)
            except Exception:  # an error of one alarm must not affect the others
                log.exception("evaluating the alarm %s failed", instance.definition.name)
                instance.problem = "Internal error while it was evaluated; the log has details."

    def _update_rates(self) -> None:
        """Restart alarms that wait for the rate of a channel, or depend on one that has changed."""
        for instance in self._instances.values():
            if instance.is_waiting:
                self._is_stale = True
            elif instance.rates and have_changed(self._store, instance.rates):
                instance.restart()
                self._is_stale = True

    def _match(self) -> None:
        """Create, compile and remove the instances of the alarms for the present devices and channels."""
        instances: dict[tuple[str, str], AlarmInstance] = {}
        devices = list(self._bus.devices.latest.values())
        infos = {info.id: list(self._store.of_device(info.id).values()) for info in devices}
        rates = ChannelRates(self._store)
        for stored in self._stored.values():
            if not stored.definition.enabled:
                continue
            for info in devices:
                if not stored.definition.devices.fits(info):
                    continue
                key = stored.id, info.id
                instance = self._instances.get(key)
                if instance is None or instance.stored != stored or instance.name != lasting_name(info):
                    instance = self._create(stored, info, infos[info.id], rates)
                else:
                    instance.compile(info, infos[info.id], rates)
                instances[key] = instance
        for key, instance in self._instances.items():
            if instances.get(key) is not instance:
                instance.close(self._bus.now())
                self._saved.get(key[0], {}).pop(instance.name, None)
        self._instances = instances
        self._has_work.set()
        needed = {channel for instance in instances.values() for channel in instance.channels}
        self._positions = {
            channel: self._positions.get(channel, 0 if channel in self._opened else known.ring.total)
            for channel in needed
            if (known := self._store.get(channel)) is not None
        }
        self._opened.clear()
        for instance in instances.values():
            if instance.is_new:
                instance.warm_up(self._past(instance.channels))

    def _past(self, channels: Iterable[int]) -> Rows:
        """The samples in memory of channels before the first row that the next turn reads."""
        times = {}
        for channel in channels:
            ring, end = self._store.of(channel).ring, self._positions[channel]
            begin = max(ring.first, end - MAX_PAST)
            if begin < end:
                times[channel] = [column[: end - begin] for column in ring.read(begin)]
        return times

    def _create(
        self,
        stored: StoredAlarm,
        info: wire.DeviceInfo,
        infos: Sequence[wire.ChannelInfo],
        rates: Mapping[int, float],
    ) -> AlarmInstance:
        instance = AlarmInstance(stored, info, infos, rates, self._bus, lasting_name(info))
        if stored.definition.webhook:
            instance.deliver = self._deliver
        saved = self._saved.get(stored.id, {}).get(instance.name)
        if saved:
            try:
                instance.machine.restore(dict(saved))
            except (TypeError, ValueError):
                log.warning("the stored state of the alarm %s is invalid", stored.definition.name)
        return instance

    def _deliver(self, instance: AlarmInstance, body: dict[str, object]) -> None:
        info = self._bus.devices.latest.get(instance.device)
        names = {} if info is None else {"name": info.name, "serial_number": info.serial_number}
        message = {"imuscope": 1, **body, "device": {"id": instance.device, **names}}
        self.webhooks.send(instance.stored.id, instance.definition.webhook, message, instance.note)

    # ── alarms ───────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def alarms(self) -> list[StoredAlarm]:
        """All alarms, in order of creation."""
        return list(self._stored.values())

    def get(self, alarm: str) -> StoredAlarm:
        """An alarm by its id.

        Raises:
            DomainError: there is none.
        """
        if alarm not in self._stored:
            message = f"Alarm {alarm:.40} not found."
            raise DomainError("not-found", message, "It may have been deleted; choose one of the list.")
        return self._stored[alarm]

    def states(self, alarm: str) -> list[AlarmState]:
        """States of an alarm, one for each device that it is for."""
        return [instance.state() for (own, _), instance in self._instances.items() if own == alarm]

    def add_metrics(self, page: PrometheusText) -> None:
        """Add the families of alarms to the page for Prometheus."""
        states = [(stored, one) for stored in self.alarms for one in self.states(stored.id)]
        page.family("imuscope_alarm_raised", "gauge", "1 while an alarm is raised, also while it has no data.")
        for stored, one in states:
            labels = {"alarm": stored.id, "name": stored.definition.name, "level": stored.definition.level}
            page.add(int(one.raised), device=one.device, **labels)
        page.family("imuscope_alarm_acknowledged", "gauge", "1 while a raised alarm is acknowledged.")
        for stored, one in states:
            page.add(int(one.acknowledged is not None), device=one.device, alarm=stored.id)
        page.family("imuscope_alarm_missing", "gauge", "1 while an alarm has no data and cannot be evaluated.")
        for stored, one in states:
            page.add(int(one.status == "missing"), device=one.device, alarm=stored.id)
        page.family("imuscope_alarm_raised_total", "counter", "How often an alarm was raised.")
        for stored, one in states:
            page.add(one.count, device=one.device, alarm=stored.id)

    async def add(self, definition: AlarmDefinition) -> StoredAlarm:
        """Add an alarm.

        Raises:
            DomainError: it is invalid, there are too many, or it cannot be stored.
        """
        if len(self._stored) >= MAX_ALARMS:
            raise DomainError("full", f"There are {MAX_ALARMS} alarms already.", "Delete one first.")
        self.validate(definition)
        if definition.webhook:
            checked_url(definition.webhook, self.webhooks.allowed)
        stored = StoredAlarm(id=secrets.token_hex(4), definition=definition)
        await self._put(stored, "added")
        return stored

    async def change(self, alarm: str, definition: AlarmDefinition) -> StoredAlarm:
        """Replace the definition of an alarm; its states are reset.

        Raises:
            DomainError: it is unknown or invalid, or it cannot be stored.
        """
        before = self.get(alarm)
        self.validate(definition)
        known = before.definition.webhook
        if definition.webhook == shown_url(known):
            definition = definition.model_copy(update={"webhook": known})
        elif definition.webhook:
            checked_url(definition.webhook, self.webhooks.allowed)
        stored = StoredAlarm(id=before.id, definition=definition)
        if stored != before:
            self._saved.pop(alarm, None)
            await self._put(stored, "changed")
            if definition.webhook != known:
                await self.webhooks.forget(alarm, spare=definition.webhook)  # it may have been raised already
        return stored

    async def _put(self, stored: StoredAlarm, change: str) -> None:
        before = self._stored.get(stored.id)
        self._stored[stored.id] = stored
        self._match()
        try:
            await self._save()
        except DomainError:
            self._stored.pop(stored.id)
            if before is not None:
                self._stored[stored.id] = before
            self._match()
            raise
        self._note(stored, change)

    async def delete(self, alarm: str) -> None:
        """Delete an alarm.

        Raises:
            DomainError: it is unknown, or the deletion cannot be stored.
        """
        stored = self.get(alarm)
        before = dict(self._stored)
        del self._stored[alarm]
        self._match()
        try:
            await self._save()
        except DomainError:
            self._stored = before
            self._match()
            raise
        self._saved.pop(alarm, None)
        self._trigger.forget(alarm)
        await self.webhooks.forget(alarm)
        self._note(stored, "deleted")

    def _note(self, stored: StoredAlarm, change: str) -> None:
        data = {"alarm": stored.id, "name": stored.definition.name, "change": change}
        self._bus.event("", "alarm", "info", f"Alarm “{stored.definition.name}” was {change}.", data=data)

    def validate(self, definition: AlarmDefinition) -> list[str]:
        """Check a definition, against the devices that it is for as far as they are present.

        Returns:
            Names of the devices that it was checked with.

        Raises:
            DomainError: it is invalid; ExpressionError says where.
        """
        if isinstance(definition.condition, ExpressionCondition):
            checked(definition.condition)
        names, problem, rates = [], None, ChannelRates(self._store)
        for info in self._bus.devices.latest.values():
            infos = list(self._store.of_device(info.id).values())
            if not infos or not definition.devices.fits(info):
                continue
            try:
                compiled(definition, infos, rates, info)
            except RateUnknownError:
                continue  # it fits as far as is known; the alarm waits for the rate
            except DomainError as error:
                problem = problem or error
            else:
                names.append(info.name)
        if problem is not None and not names:
            raise problem
        return names

    async def acknowledge(self, alarm: str, by: str, device: str = "") -> StoredAlarm:
        """Acknowledge an alarm, of one device or of all.

        Raises:
            DomainError: it is unknown or not raised, or the name is missing.
        """
        stored = self.get(alarm)
        name = " ".join(by.split())
        if not name or len(name) > MAX_BY:
            raise DomainError("bad-value", "by: give the name of the person who acknowledges.", "Up to 60 characters.")
        own = [one for (id_, at), one in self._instances.items() if id_ == alarm and device in ("", at)]
        raised = [one for one in own if one.machine.is_active] or own[:1]
        if not raised:
            message = f"The alarm {stored.definition.name!r:.90} is not raised."
            raise DomainError("not-now", message, "It is for no present device.")
        for instance in raised:
            instance.acknowledge(name, self._bus.now())
        self._is_dirty = True
        return stored


def parts(services: Services) -> Iterator[ServicePart]:
    """Long-lived objects, for a server with these services."""
    if services.parts.find(AlarmService) is None:  # no alarm was stored at the start
        yield alarm_part(services)


def alarm_part(services: Services) -> ServicePart:
    telemetry, config = services.telemetry, services.config
    hosts = config.of(AlarmSettings).webhook_hosts
    alarms = AlarmService(telemetry.bus, telemetry.store, config.data, services.recorder, hosts)
    return ServicePart(
        "the alarms",
        alarms,
        alarms.close,
        alarms.start,
        before_recorder=alarms.close_trigger,
        metrics=alarms.add_metrics,
    )
