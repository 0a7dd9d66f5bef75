"""Types of HTTP answers that have the keys of the previous version too (server/previous_names.py).

The previous keys are not in the schema of the API.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import WrapSerializer

from imuscope.server import wire
from imuscope.server.previous_names import with_previous_keys

_PREVIOUS_KEYS = WrapSerializer(lambda value, serialize: with_previous_keys(serialize(value)))

DeviceAnswer = Annotated[wire.DeviceInfo, _PREVIOUS_KEYS]
JobAnswer = Annotated[wire.Job, _PREVIOUS_KEYS]
JobsAnswer = Annotated[wire.DeviceJobs, _PREVIOUS_KEYS]
TrafficAnswer = Annotated[wire.TrafficEntry, _PREVIOUS_KEYS]
