"""`python -m server.integrations.viser_worker`: the process of viser, started by server/integrations/viser.py.

told:  {"op": "open", "key": "", "title": …,      begin a scene: "" of all devices, else of the one with this id;
        "secret": …}                          who does not say this is not let in (server/integrations/shared_secret.py)
       {"op": "close", "key": …}
says:  {"op": "scene", "key": …, "port": …}       it is served on this loopback port

Samples come 30 times a second and are shown 60 times a second, each row in its time
(server/integrations/playout_buffer.py). While nothing moves nothing is done.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from server.integrations.poses import TRACK_S, DeviceView, looks_of
from server.integrations.scene import Scene
from server.integrations.viewer_client import ViewerClient
from server.wire_codec import SampleFrame

SHOWN_PER_S = 60.0


class SceneManager:
    """All scenes, and the devices in them."""

    def __init__(self, told: ViewerClient) -> None:
        self._told = told
        self._scenes: dict[str, Scene] = {}
        self._looks: list[DeviceView] = []
        self._by_channel: dict[int, list[DeviceView]] = {}
        self._known: list[tuple[str, tuple[int, ...]]] = []
        self._recorded: dict[str, list[DeviceView]] = {}
        self._next = 0.0

    def due(self) -> float | None:
        """When the next picture is to be shown, monotonic, s; None while there is nothing new in it."""
        return self._next if any(look.waits for look in self._looks) else None

    def show(self) -> None:
        """Show what is to be seen now."""
        now = time.monotonic()
        self._next = max(self._next + 1 / SHOWN_PER_S, now)  # evenly, however late this one was
        for look in self._looks:
            look.play(now)
        for key, scene in self._scenes.items():
            if key not in self._recorded:
                scene.show(now)

    def hear(self, message: Sequence[SampleFrame] | Mapping[str, Any]) -> None:
        """What came next."""
        if isinstance(message, Mapping):
            self._obey(message)
            return
        if self._told.changed:
            self._told.changed = False
            self._arrange()
        now = time.monotonic()
        for samples in message:
            for look in self._by_channel.get(samples.channel, ()):
                look.hear(samples, now)
        if self.due() is None:  # a place without an attitude
            self.show()

    def _obey(self, words: Mapping[str, Any]) -> None:
        key = str(words["key"])
        if words["op"] == "rows":
            self._replay(key, words)
            return
        if words["op"] == "open" and key not in self._scenes:
            if "devices" in words:
                self._recorded[key] = looks_of(words["devices"], words["channels"])
            scene = self._scenes[key] = Scene(str(words["title"]), str(words["secret"]))
            scene.arrange(self._of(key))
        elif words["op"] == "close" and key in self._scenes:
            self._scenes.pop(key).close()
            self._recorded.pop(key, None)
        if key in self._scenes:
            self._told.say(op="scene", key=key, port=self._scenes[key].port)

    def _replay(self, key: str, words: Mapping[str, Any]) -> None:
        looks = self._recorded.get(key, [])
        if "past" in words:
            for look in looks:
                look.forget_track()
        for name, history in (("past", True), ("rows", False)):
            for number, columns in words.get(name, {}).items():
                arrays = [np.array(column, np.float64) for column in columns]
                samples = SampleFrame(int(number), 0, len(arrays[0]), 0, history, 0.0, arrays)
                for look in looks:
                    look.hear(samples)
        if key in self._scenes:
            self._scenes[key].show(time.monotonic())

    def _of(self, key: str) -> list[DeviceView]:
        if key in self._recorded:
            return self._recorded[key]
        return [look for look in self._looks if key in ("", look.id)]

    def _arrange(self) -> None:
        """Devices or channels are others: those that stayed the same keep what is known of them."""
        newest = {(info["device"], info["name"]): info for info in self._told.channels.values()}  # a layout may change
        found = looks_of(self._told.devices, list(newest.values()))
        before = {(look.id, look.title, *look.channels): look for look in self._looks}
        self._looks = [before.get((look.id, look.title, *look.channels), look) for look in found]
        known = [(look.title, tuple(look.channels)) for look in self._looks]
        if known == self._known:
            return
        self._known = known
        self._by_channel = {}
        for look in self._looks:
            for number in look.channels:
                self._by_channel.setdefault(number, []).append(look)
            look.forget_track()
        past = [look.position.channel for look in self._looks if look.position]
        self._told.subscribe(list(self._by_channel), past, TRACK_S)
        for key, scene in self._scenes.items():
            if key not in self._recorded:
                scene.arrange(self._of(key))


def main() -> None:
    """Until standard input ends."""
    told = ViewerClient()
    stage = SceneManager(told)
    for message in told.messages_until(stage.due):
        if message is None:
            stage.show()
        else:
            stage.hear(message)


if __name__ == "__main__":
    main()
