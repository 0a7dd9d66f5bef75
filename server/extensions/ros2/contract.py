"""Contract of a robot with its sensors: topics, types, frames, rates and covariances that have to be there.

# ros2_contract.toml
["/imu/imu/data"]
type = "sensor_msgs/msg/Imu"
frame = "imu_link"
rate = [95, 105]                                    # messages/s, while there is a subscriber: else none are made
covariances = ["orientation", "angular_velocity"]   # have to be known

not announced within START_S ──┐
differs for LASTS_S ───────────┴─> broken: an event, and the reason in the list of topics ── as agreed ──> an event
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imuscope.server.extensions.ros2.settings import is_name

START_S, LASTS_S = 15.0, 3.0
COVARIANCES = ("orientation", "angular_velocity", "linear_acceleration", "magnetic_field", "position", "velocity")


@dataclass(frozen=True, slots=True)
class TopicTerms:
    """The agreement on one topic; "", None or () for a part without one.

    Args:
        rate: least and most messages/s.
        covariances: names of those that have to be known.
    """

    topic: str
    type: str = ""
    frame: str = ""
    rate: tuple[float, float] | None = None
    covariances: tuple[str, ...] = ()

    def difference(self, row: Mapping[str, Any] | None) -> tuple[str, str]:
        """The kind of the first difference, and a sentence on it; "" for none.

        Args:
            row: of the list of topics; None: it is not announced.
        """
        if row is None or not row["enabled"]:
            return "topic", f"{self.topic} is {'switched off' if row else 'not announced'}."
        if self.type and row["type"] != self.type:
            return "type", f"{self.topic} is of type {row['type']}, not {self.type}."
        if self.frame and row["frame"] != self.frame:
            return "frame", f"{self.topic} has the frame {row['frame']}, not {self.frame}."
        if missing := [one for one in self.covariances if one not in row["covariances"]]:
            return "covariances", f"{self.topic} has no known covariance of {', '.join(missing)}."
        if self.rate and row["subscribers"] and not self.rate[0] <= row["rate"] <= self.rate[1]:
            return "rate", f"{self.topic} has {row['rate']:.1f} messages/s, not {self.rate[0]:g} to {self.rate[1]:g}."
        return "", ""


class Contract:
    """A contract, and how it is kept.

    Args:
        began: when the devices began to be announced, monotonic, s.
    """

    def __init__(self, terms: Sequence[TopicTerms], began: float) -> None:
        self._terms, self._began = terms, began
        self._since: dict[str, tuple[str, float]] = {}  # topic: what differs, and since when
        self.broken: dict[str, str] = {}
        """Topic: the sentence on what differs."""

    def check(self, rows: Sequence[Mapping[str, Any]], now: float) -> Iterator[tuple[str, bool]]:
        """Compare with the topics as they are; yields a sentence on each change, and whether it is a breach."""
        by_name = {row["name"]: row for row in rows}
        for terms in self._terms:
            kind, words = terms.difference(by_name.get(terms.topic))
            before, since = self._since.get(terms.topic, ("", now))
            if kind != before:
                since = now
            self._since[terms.topic] = kind, since
            if not kind:
                if self.broken.pop(terms.topic, ""):
                    yield f"{terms.topic} is as agreed again.", False
            elif terms.topic in self.broken:
                self.broken[terms.topic] = words
            elif now - since >= LASTS_S and now - self._began >= START_S:
                self.broken[terms.topic] = words
                yield words, True


def read_contract(path: str) -> list[TopicTerms]:
    """The terms of a file.

    Raises:
        ValueError: it cannot be read, or is not of the form above; the text is for a user.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}.") from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not TOML: {error}.") from None
    return [_terms(path, topic, about) for topic, about in content.items()]


def _terms(path: str, topic: str, about: Any) -> TopicTerms:
    where = f"{path}, {topic!r:.80}"
    if not is_name(topic) or not isinstance(about, dict):
        raise ValueError(f'{where}: this is not a topic with its terms, such as ["/imu/imu/data"].')
    if unknown := about.keys() - {"type", "frame", "rate", "covariances"}:
        raise ValueError(f"{where}: {sorted(unknown)[0]!r:.40} is not one of type, frame, rate, covariances.")
    rate, names = about.get("rate"), about.get("covariances", [])
    if rate is not None and not (_are(rate, int | float) and len(rate) == 2 and 0 <= rate[0] <= rate[1]):
        raise ValueError(f"{where}: rate {rate!r:.40} is not a least and a most, such as [95, 105].")
    if not _are(names, str) or not set(names) <= set(COVARIANCES):
        raise ValueError(f"{where}: covariances {names!r:.80} are not of {', '.join(COVARIANCES)}.")
    if not all(isinstance(about.get(key, ""), str) for key in ("type", "frame")):
        raise ValueError(f"{where}: type and frame are texts.")
    limits = (float(rate[0]), float(rate[1])) if rate is not None else None
    return TopicTerms(topic, about.get("type", ""), about.get("frame", ""), limits, tuple(names))


def _are(values: Any, kind: Any) -> bool:
    return isinstance(values, list) and all(isinstance(one, kind) and not isinstance(one, bool) for one in values)
