"""Parts of a condition that depend on earlier samples: filters, moving windows, derivatives, integrals.

    rms(highpass(Acceleration.z, 1 Hz), 2 s) > 0.5 g
    └────────────── one LiveExpression ────┘ > 0.5 g      its samples take the place of those of a channel

Their state is kept from batch to batch, so that the result is that of everything at once, without looking ahead. It
restarts after a gap. A moving window has no value until it is full: one of 10 s has none after 0.1 s.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from imuscope.server.extensions.analysis.expressions.expression_functions import DELAYED
from imuscope.server.extensions.analysis.expressions.expression_syntax import Call, Name, Node, parse
from imuscope.server.extensions.analysis.expressions.expressions import names_in
from imuscope.server.extensions.analysis.expressions.live_expression import LiveExpression, check_window
from imuscope.server.wire import ChannelInfo

ALONG_TIME = frozenset({*DELAYED, "unwrap", "derivative", "integral", "resample", "shift"})
_MARK = "\0"  # begins a name that no user can type


class AlongTime:
    """The parts of a condition that depend on earlier samples.

    Args:
        infos: channels of the device.
        rates: usual rates of these, Hz, by id.

    Attributes:
        node: the condition with a name in place of each part.
        parts: these by that name.

    Raises:
        RateUnknownError: a rate is not known yet.
        ExpressionError: something does not fit; says where.
    """

    def __init__(self, node: Node, infos: Sequence[ChannelInfo], rates: Mapping[int, float]) -> None:
        self.parts: dict[str, LiveExpression] = {}
        self.node = self._taken_out(node, infos, rates)

    def _taken_out(self, node: Node, infos: Sequence[ChannelInfo], rates: Mapping[int, float]) -> Node:
        if not isinstance(node, Call):
            return node
        if node.name in ALONG_TIME and next(names_in(node), None) is not None:
            name = f"{_MARK}{len(self.parts)}"
            self.parts[name] = LiveExpression(infos, node, rates, whole_windows=True)
            check_window(sum(part.window for part in self.parts.values()), node)
            return Name(name, node.begin, node.end)
        arguments = tuple(self._taken_out(one, infos, rates) for one in node.arguments)
        return Call(node.name, arguments, node.begin, node.end)

    def feed(self, rows: Mapping[int, Sequence[NDArray[Any]]]) -> dict[str, Sequence[NDArray[Any]]]:
        """New samples of the parts, as those of a channel: time twice, then the columns."""
        pieces = {name: part.feed(rows) for name, part in self.parts.items() if not part.channels.isdisjoint(rows)}
        return {name: [piece.time, piece.time, *piece.parts] for name, piece in pieces.items() if len(piece)}


def notes_on(text: str) -> list[str]:
    """Sentences for a user about the parts of an expression that depend on earlier samples."""
    used = sorted({call.name for call in calls_in(parse(text)) if call.name in ALONG_TIME})
    if not used:
        return []
    what = "Causal filter" if any(name.endswith("pass") for name in used) else "Causal"
    return [f"{what}: {', '.join(used)} takes past samples only, and restarts after a gap."]


def calls_in(node: Node) -> Iterator[Call]:
    """All operators and functions of a tree."""
    if isinstance(node, Call):
        yield node
        for argument in node.arguments:
            yield from calls_in(argument)


def is_along_time(node: Node) -> bool:
    """Whether a part depends on earlier samples."""
    return any(call.name in ALONG_TIME for call in calls_in(node))
