"""`python -m imuscope.server.extensions.viser.worker`: the process of viser, started by service.py.

    input:   {"op": "open", "key": "", "title": …,  open a scene: "" of all devices, else of the one with this id;
              "secret": …}                          required from clients (server/integrations/shared_secret.py)
             {"op": "close", "key": …}
    output:  {"op": "scene", "key": …, "port": …}   it is served on this loopback port

Samples arrive 30 times a second and are shown 60 times a second, each row in its time
(server/extensions/viser/playout_buffer.py). Nothing is sent while nothing moves.
"""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from imuscope.server.extensions.viser.poses import TRACK_S, DeviceView, device_views
from imuscope.server.extensions.viser.scene import Scene
from imuscope.server.integrations.viewer_client import ViewerClient
from imuscope.server.wire.codec import SampleFrame

SHOWN_PER_S = 60.0


class SceneManager:
    """All scenes, and the devices in them."""

    def __init__(self, client: ViewerClient) -> None:
        self._client = client
        self._scenes: dict[str, Scene] = {}
        self._appearances: list[DeviceView] = []
        self._by_channel: dict[int, list[DeviceView]] = {}
        self._devices: list[tuple[str, tuple[int, ...]]] = []
        self._recorded: dict[str, list[DeviceView]] = {}
        self._next = 0.0

    def due(self) -> float | None:
        """Time of the next update, monotonic, s; None while there is nothing new."""
        return self._next if any(view.waits for view in self._appearances) else None

    def show(self) -> None:
        """Update all live scenes to the present time."""
        now = time.monotonic()
        self._next = max(self._next + 1 / SHOWN_PER_S, now)  # even intervals, regardless of delays
        for view in self._appearances:
            view.play(now)
        for key, scene in self._scenes.items():
            if key not in self._recorded:
                scene.show(now)

    def on_message(self, message: Sequence[SampleFrame] | Mapping[str, Any]) -> None:
        """Handle the next message."""
        if isinstance(message, Mapping):
            self._apply(message)
            return
        if self._client.changed:
            self._client.changed = False
            self._configure()
        now = time.monotonic()
        for samples in message:
            for view in self._by_channel.get(samples.channel, ()):
                view.update(samples, now)
        if self.due() is None:  # a position without an attitude
            self.show()

    def _apply(self, words: Mapping[str, Any]) -> None:
        key = str(words["key"])
        if words["op"] == "rows":
            self._replay(key, words)
            return
        if words["op"] == "open" and key not in self._scenes:
            if "devices" in words:
                self._recorded[key] = device_views(words["devices"], words["channels"])
            scene = self._scenes[key] = Scene(str(words["title"]), str(words["secret"]))
            scene.configure(self._of(key))
        elif words["op"] == "close" and key in self._scenes:
            self._scenes.pop(key).close()
            self._recorded.pop(key, None)
        if key in self._scenes:
            self._client.send(op="scene", key=key, port=self._scenes[key].port)

    def _replay(self, key: str, words: Mapping[str, Any]) -> None:
        views = self._recorded.get(key, [])
        if "past" in words:
            for view in views:
                view.forget_track()
        for name, history in (("past", True), ("rows", False)):
            for number, columns in words.get(name, {}).items():
                arrays = [np.array(column, np.float64) for column in columns]
                samples = SampleFrame(int(number), 0, len(arrays[0]), 0, history, 0.0, arrays)
                for view in views:
                    view.update(samples)
        if key in self._scenes:
            self._scenes[key].show(time.monotonic())

    def _of(self, key: str) -> list[DeviceView]:
        if key in self._recorded:
            return self._recorded[key]
        return [view for view in self._appearances if key in ("", view.id)]

    def _configure(self) -> None:
        """Apply changed devices or channels; unchanged devices keep their state."""
        newest = {
            (info["device"], info["name"]): info for info in self._client.channels.values()
        }  # a layout may change
        views = device_views(self._client.devices, list(newest.values()))
        before = {(view.id, view.title, *view.channels): view for view in self._appearances}
        self._appearances = [before.get((view.id, view.title, *view.channels), view) for view in views]
        known = [(view.title, tuple(view.channels)) for view in self._appearances]
        if known == self._devices:
            return
        self._devices = known
        self._by_channel = {}
        for view in self._appearances:
            for number in view.channels:
                self._by_channel.setdefault(number, []).append(view)
            view.forget_track()
        past = [view.position.channel for view in self._appearances if view.position]
        self._client.subscribe(list(self._by_channel), past, TRACK_S)
        for key, scene in self._scenes.items():
            if key not in self._recorded:
                scene.configure(self._of(key))


def main() -> None:
    """Run until standard input ends."""
    client = ViewerClient()
    scenes = SceneManager(client)
    for message in client.messages_until(scenes.due):
        if message is None:
            scenes.show()
        else:
            scenes.on_message(message)


if __name__ == "__main__":
    main()
