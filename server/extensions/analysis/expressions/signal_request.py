"""Signals as a request names them: columns of channels, or expressions over them."""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import NO_UNIT, Unit
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.expression_functions import Context, SampleBudget, euler_angles
from imuscope.server.extensions.analysis.expressions.expression_syntax import Node, parse
from imuscope.server.extensions.analysis.expressions.expressions import columns_of, evaluate, names_in, notes_of
from imuscope.server.extensions.analysis.noise.data_sheet import Product, data_sheet_of, unknown_product
from imuscope.server.extensions.analysis.signals.companions import companions_in
from imuscope.server.extensions.analysis.signals.quantities import Quantity
from imuscope.server.extensions.analysis.signals.signals import (
    ReadSamples,
    Signal,
    SignalColumn,
    addressed_device,
    angles_named,
    columns_named,
    finite_signal,
    meant,
    temperature_of,
)
from imuscope.server.wire import ChannelInfo

SIGNS = frozenset("()+-*/^<>=!,")
WORDS = (" and ", " or ", "not ")


@dataclass(frozen=True, slots=True)
class ExpressionSignal:
    """An expression over columns.

    Attributes:
        text: as requested; the name of its signal.
        node: its tree.
        named: columns of each name in it.
        context: whether filters may look ahead.
        angles: names of Euler angles that are computed from a quaternion, and which of them.
    """

    text: str
    node: Node
    named: dict[str, list[SignalColumn]]
    context: Context
    angles: dict[str, str] = field(default_factory=dict)

    @property
    def columns(self) -> list[SignalColumn]:
        return [column for columns in self.named.values() for column in columns]

    @property
    def device(self) -> str:
        """Its device; "" if it has none or several."""
        devices = {column.device for column in self.columns}
        return devices.pop() if len(devices) == 1 else ""

    def quantity(self, read: ReadSamples) -> Quantity:
        """Its samples, undefined ones (NaN) included.

        Raises:
            ExpressionError: a function or a unit does not fit.
        """
        axes: dict[int, Floats] = {}

        def resolve(name: str) -> Quantity:
            columns = self.named[name]
            info = columns[0].info
            own = [info.columns[column.at] for column in columns]
            pairs = [read(column) for column in columns]
            time = axes.setdefault(info.id, pairs[0][0])
            parts = tuple(values for _, values in pairs)
            breaks = columns[0].breaks
            if name in self.angles:
                turned = Quantity(parts, NO_UNIT, time, tuple(one.name for one in own), breaks=breaks)
                return euler_angles(turned, self.angles[name])
            names = tuple(one.name for one in own) if len(own) > 1 else ("",)
            return Quantity(parts, Unit.parse(own[0].unit), time, names, own[0].period, breaks=breaks)

        value = evaluate(self.node, resolve, self.context)
        if value.time is None:
            hint = "Name a signal in it."
            raise DomainError("bad-expression", f"{self.text:.80} is the number {value.number:g}, no signal.", hint)
        return value

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on how it is computed."""
        return tuple(notes_of(self.node, self.context))

    def signals(self, read: ReadSamples) -> list[Signal]:
        """Its samples; of a vector a signal for each column.

        Raises:
            ExpressionError: a function or a unit does not fit.
        """
        value = self.quantity(read)
        assert value.time is not None  # it is not a number
        sampled = []
        for name, part in zip(value.names, value.parts, strict=True):
            title = f"({self.text}).{name}" if name else self.text
            plain = finite_signal(title, str(value.unit), value.period, value.time, part)
            sampled.append(replace(plain, notes=(*self.notes, *plain.notes), breaks=value.breaks))
        return sampled


def requested_signals(
    infos: Iterable[ChannelInfo],
    words: Sequence[str],
    *,
    zero_phase: bool,
    product: Product = unknown_product,
    device: str = "",
    others: Sequence[ChannelInfo] = (),
    companions: bool = False,
    segments: Mapping[str, Sequence[float]] = {},
) -> list[SignalColumn | ExpressionSignal]:
    """Signals that the words name: a column, a channel with all its columns, or an expression over them.

    Args:
        zero_phase: filters and moving windows of expressions may look ahead.
        product: of a device.
        device: whose signals are meant by names without a device, as in `columns_named`.
        others: channels that have to be named with their device: `2/Acceleration`.
        companions: columns are read with the other sensors of their device.
        segments: times at which the clock of a device steps, unix s.

    Raises:
        DomainError: "not-found", "which-device" or "bad-expression".
    """
    known = list(infos)
    context = Context(zero_phase, SampleBudget())
    signals: list[SignalColumn | ExpressionSignal] = []
    beside = functools.cache(functools.partial(companions_in, [*known, *others]))
    for word in words:
        try:
            columns = columns_named(meant(known, others, word), [word], device)
            signals += [
                replace(
                    one,
                    data_sheet=data_sheet_of(one.info, one.at, product),
                    temperature=temperature_of([*known, *others], one),
                    companions=beside(one.device) if companions else None,
                    axes="" if product is unknown_product else product(one.device)[1].axes,
                    breaks=tuple(segments.get(one.device, ())),
                )
                for one in columns
            ]
        except DomainError:
            if angles_named(meant(known, others, word), word, device) is not None:
                signals.append(
                    replace(expression_over(known, f'"{word}"', context, device, others, segments), text=word)
                )
                continue
            if not _may_be_expression(word, [*known, *others]):
                raise
            signals.append(expression_over(known, word, context, device, others, segments))
    return signals


def expression_over(
    infos: Sequence[ChannelInfo],
    text: str,
    context: Context,
    device: str,
    others: Sequence[ChannelInfo] = (),
    segments: Mapping[str, Sequence[float]] = {},
) -> ExpressionSignal:
    """An expression over channels; `device`, `others` and `segments`: as for `requested_signals`.

    Raises:
        ExpressionError: a mistake in it, or an unknown name, with its position.
    """
    node = parse(text)
    named: dict[str, list[SignalColumn]] = {}
    angles: dict[str, str] = {}
    for name in names_in(node):
        if name.name in named:
            continue
        columns, angle = columns_of(meant(infos, others, name.name), name, device)
        if angle is not None:
            angles[name.name] = angle
        named[name.name] = [replace(one, breaks=tuple(segments.get(one.device, ()))) for one in columns]
    return ExpressionSignal(text, node, named, context, angles)


def _may_be_expression(word: str, infos: Sequence[ChannelInfo]) -> bool:
    """Whether a word that is not a signal can be an expression: `2/RateOfTurn.z` names device 2, where there is one."""
    if addressed := addressed_device(infos, word):
        word = word.removeprefix(f"{addressed}/")
    return bool(SIGNS.intersection(word)) or any(one in word for one in WORDS)
