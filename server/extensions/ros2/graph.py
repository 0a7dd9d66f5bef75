"""Nodes and publishers of ours in the ROS graph, over one Zenoh session, and the subscribers of others.

A node has a liveliness token, and each of its publishers has one; they vanish with the node, or with the session. Zenoh
says whether a publisher has a subscriber anywhere: without one, nothing is made for it. How many there are, and of
which types, is read from their tokens.
"""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from imuscope.server.concurrency.rate_meter import RateMeter
from imuscope.server.extensions.ros2.attachment import Attachment, gid_of
from imuscope.server.extensions.ros2.key_expressions import (
    KeyExpressionError,
    QosProfile,
    RosEndpoint,
    RosNode,
    graph_pattern,
    parse_token,
)
from imuscope.server.extensions.ros2.type_support import type_hash

Session = Any  # zenoh.Session: its stubs miss return types


class TopicPublisher:
    """A publisher of ours.

    Args:
        changed: called, from any thread, when the first subscriber has come or the last one has gone.
    """

    def __init__(self, session: Session, endpoint: RosEndpoint, changed: Callable[[], None]) -> None:
        import zenoh

        self.endpoint = endpoint
        self.bytes = 0
        self._sequence = 1  # of the next message
        self.rate = RateMeter()
        self._gid = gid_of(endpoint.token)
        self._changed = changed
        reliability = endpoint.qos.reliability == "reliable"
        self._publisher = session.declare_publisher(
            endpoint.key,
            reliability=zenoh.Reliability.RELIABLE if reliability else zenoh.Reliability.BEST_EFFORT,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self._listener = self._publisher.declare_matching_listener(self._on_matching)
        self.has_subscribers = bool(self._publisher.matching_status.matching)
        self._token = session.liveliness().declare_token(endpoint.token)

    def publish(self, messages: Sequence[bytes]) -> None:
        """Publish messages, in order."""
        for message in messages:
            attachment = Attachment(self._sequence, time.time_ns(), self._gid)
            self._publisher.put(message, attachment=attachment.encode())
            self._sequence += 1
            self.bytes += len(message)
        self.rate.add(len(messages), time.monotonic())

    def close(self) -> None:
        """Leave the graph."""
        self._token.undeclare()
        self._listener.undeclare()
        self._publisher.undeclare()

    def _on_matching(self, status: Any) -> None:
        self.has_subscribers = bool(status.matching)
        self._changed()


class RosGraph:
    """Nodes of ours in a domain, and the subscribers that others announce.

    Args:
        changed: called, from any thread, when a publisher has found its first subscriber or lost its last one.
    """

    def __init__(self, session: Session, domain: int, qos: QosProfile, changed: Callable[[], None]) -> None:
        self._session, self._domain, self._qos, self._changed = session, domain, qos, changed
        self._id = str(session.zid())
        self._next = 0
        self._tokens: dict[int, Any] = {}
        self._lock = threading.Lock()
        self._subscribers: dict[str, RosEndpoint] = {}
        self._watch = session.liveliness().declare_subscriber(graph_pattern(domain), self._on_token, history=True)

    @property
    def routers(self) -> list[str]:
        """Ids of the routers that are reached."""
        return [str(one) for one in self._session.info.routers_zid()]

    @property
    def peers(self) -> int:
        """Number of other sessions that are reached directly."""
        return len(list(self._session.info.peers_zid()))

    def add_node(self, namespace: str, name: str) -> RosNode:
        node = RosNode(self._domain, self._id, self._number(), namespace, name)
        self._tokens[node.number] = self._session.liveliness().declare_token(node.token)
        return node

    def remove_node(self, node: RosNode) -> None:
        """Withdraw a node; its publishers are closed before."""
        self._tokens.pop(node.number).undeclare()

    def add_publisher(self, node: RosNode, topic: str, type_name: str) -> TopicPublisher:
        """Announce a publisher of a node, under a topic with its namespace."""
        endpoint = RosEndpoint(node, self._number(), "publisher", topic, type_name, type_hash(type_name), self._qos)
        return TopicPublisher(self._session, endpoint, self._changed)

    def subscribers(self, topic: str, ros_type: str, rihs: str) -> tuple[int, list[RosEndpoint]]:
        """Number of subscribers of a topic, and those that expect another type and so get nothing."""
        with self._lock:
            matches = [one for one in self._subscribers.values() if one.topic == topic]
        other = [one for one in matches if one.type != ros_type or (one.hash != rihs and one.hash.startswith("RIHS"))]
        return len(matches) - len(other), other

    def close(self) -> None:
        self._watch.undeclare()
        for token in self._tokens.values():
            token.undeclare()
        self._tokens.clear()

    def _number(self) -> int:
        self._next += 1
        return self._next - 1

    def _on_token(self, sample: Any) -> None:
        import zenoh

        text = str(sample.key_expr)
        try:
            entity = parse_token(text)
        except KeyExpressionError:
            return
        if isinstance(entity, RosEndpoint) and entity.kind == "subscriber":
            with self._lock:
                if sample.kind == zenoh.SampleKind.PUT:
                    self._subscribers[text] = entity
                else:
                    self._subscribers.pop(text, None)
