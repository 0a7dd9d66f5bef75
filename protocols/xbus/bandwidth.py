"""Bandwidth of an output configuration, exact to the byte, and the rates that fit.

    message = header 4 (6 if the payload exceeds 254 bytes) + items + checksum 1
    item    = 3 + size

Each stream of output_configuration.py sends one message at every tick with items due; at tick k of a stream of R
ticks/s every item is due whose rate r makes k a multiple of R/r. So the ticks of one second are counted by the sets of
items due
together: the number of messages of each kind, times their length.

The part of an output is the cost of its items; the fixed cost of messages is the part with path "". The list of
satellites has variable length: 20 are assumed.

A device that sends sentences instead is counted with the longest usual form of each: an upper bound, not exact.

Source: MT0101P 2020.A, 5.1, 5.3.5 and 5.3.6.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from imuscope.protocols.commands.transactions import LinkLoad, OutputLoad
from imuscope.protocols.xbus.annotate import identifier_words
from imuscope.protocols.xbus.enums import STRING_TYPES
from imuscope.protocols.xbus.frames import MAX_SENT, MAX_STANDARD
from imuscope.protocols.xbus.output_configuration import (
    ALWAYS,
    OUTPUTS,
    OutputStream,
    accepted_rates,
    allowed,
    max_rate,
    output_of,
    streams,
)
from imuscope.protocols.xbus.products import Model, as_built

MAX_ENTRIES = 32
ECEF = 0x5030

_SENTENCES: Mapping[str, int] = {  # bytes of the longest usual line, line end included
    **{"HCHDM": 19, "HCHDG": 34, "TSS2": 27, "PHTRO": 25, "PRDID": 33, "EM1000": 10, "PSONCMS": 120, "HCMTW": 19},
    **{"HEHDT": 19, "HEROT": 20, "GPGGA": 82, "PTCF": 52, "XSVEL": 42, "GPZDA": 38, "GPRMC": 82},
}

Pair = tuple[int, int]
Setting = Mapping[str, Any]


def pairs_of(values: Setting, model: Model | None) -> list[Pair]:
    """(identifier, granted rate) of each entry that the product can send; the others send nothing."""
    pairs = []
    for entry in values.get("outputs", ()):
        identifier, requested = int(entry["data_identifier"]), int(entry["output_frequency"])
        output = output_of(identifier, model)
        pairs.append((identifier, accepted_rates(requested, max_rate(output, model)) if output else -1))
    return pairs


def load(settings: Mapping[str, Setting], model: Model | None) -> LinkLoad:
    """Bytes per second of each output, at the rates of these settings."""
    model = as_built(model, settings.get("HardwareVersion", {}))
    strings = settings.get("StringOutputType", {})
    if strings.get("string_types"):
        return _of_strings(int(strings["string_types"]), _string_rate(settings))
    return _of_outputs(settings.get("OutputConfiguration", {}), model)


def message_rate(settings: Mapping[str, Setting], model: Model | None) -> float | None:
    """MTData2 messages per second of these settings; None for a device that sends sentences, or whose were not read."""
    if "OutputConfiguration" not in settings or settings.get("StringOutputType", {}).get("string_types"):
        return None
    model = as_built(model, settings.get("HardwareVersion", {}))
    sent = [pair for pair in pairs_of(settings["OutputConfiguration"], model) if pair[1] > 0]
    return float(sum(count for stream in streams(sent) for _, count in messages_of(stream)))


def _of_outputs(values: Setting, model: Model | None) -> LinkLoad:
    entries = list(values.get("outputs", ()))
    pairs = pairs_of(values, model)
    sent = [pair for pair in pairs if pair[1] > 0]
    cost: Counter[Pair] = Counter()
    envelope, limits = 0, []
    for stream in streams(sent):
        for due, messages in messages_of(stream):
            size = sum(3 + size_of(pair) for pair in due)
            envelope += messages * (5 if size <= MAX_STANDARD else 7)
            for pair in due:
                cost[pair] += messages * (3 + size_of(pair))
            if size > MAX_SENT:
                limits.append(f"A message of the {stream.kind} stream has {size} bytes; the limit is {MAX_SENT}.")
    parts = [_part(f"outputs.{place}", pair, cost.pop(pair, 0)) for place, pair in enumerate(pairs)]
    parts.append(OutputLoad("", "Header and checksum", float(envelope)))
    return LinkLoad(tuple(parts), sum(part.bytes_per_s for part in parts), (*_limits(entries), *dict.fromkeys(limits)))


def _part(path: str, pair: Pair, bytes_per_s: int) -> OutputLoad:
    return OutputLoad(path, identifier_words(pair[0]), float(bytes_per_s))


def _limits(entries: Sequence[Setting]) -> list[str]:
    limits = []
    if len(entries) > MAX_ENTRIES:
        limits.append(f"An output configuration has at most {MAX_ENTRIES} entries; this one has {len(entries)}.")
    if any(entry["data_identifier"] & 0xFFF0 == ECEF and entry["data_identifier"] & 3 in (1, 2) for entry in entries):
        limits.append("A fixed-point format cannot represent a position in ECEF; select Float32 or Float64.")
    return limits


def size_of(pair: Pair) -> int:
    """Bytes of an item's data."""
    return OUTPUTS[pair[0] & 0xFFF0].size(pair[0])


def messages_of(stream: OutputStream) -> list[tuple[tuple[Pair, ...], int]]:
    """The messages of one second: their items, and the number of messages with these items."""
    timed = [pair for pair in stream.items if pair[1] != ALWAYS]
    due: Counter[tuple[Pair, ...]] = Counter()
    for tick in range(stream.rate):
        due[tuple(pair for pair in timed if tick % (stream.rate // pair[1]) == 0)] += 1
    return [
        (tuple(pair for pair in stream.items if pair in now or pair[1] == ALWAYS), count)
        for now, count in due.items()
        if now or not timed
    ]


def _string_rate(settings: Mapping[str, Setting]) -> float:
    """Lines of each kind per second: with the strings (600-series), else from period and skip factor."""
    strings = settings["StringOutputType"]
    if "frequency" in strings:
        return float(strings["frequency"])
    period = int(settings.get("Period", {}).get("period", 1152)) or 1152
    skip = int(settings.get("OutputSkipFactor", {}).get("skip_factor", 0))
    return 0.0 if skip == 0xFFFF else 115_200 / (period * (skip + 1))


def _of_strings(types: int, rate: float) -> LinkLoad:
    chosen = [bits.name for bits in STRING_TYPES if bits.of(types) and bits.name in _SENTENCES]
    parts = tuple(OutputLoad("string_types", f"{name}, at most", _SENTENCES[name] * rate) for name in chosen)
    return LinkLoad(parts, sum(part.bytes_per_s for part in parts))


def fit(settings: Mapping[str, Setting], capacity: float, model: Model | None) -> dict[str, Setting]:
    """The same settings with rates below the greatest common ceiling that fits; if none fits, with the lowest rates."""
    model = as_built(model, settings.get("HardwareVersion", {}))
    values = settings.get("OutputConfiguration", {})
    pairs = pairs_of(values, model)
    ceilings = sorted({rate for pair in pairs if 0 < pair[1] != ALWAYS for rate in _ladder(pair, model)}, reverse=True)
    best = dict(settings)
    for ceiling in ceilings:
        outputs = [_lowered(entry, pair, ceiling, model) for entry, pair in zip(values["outputs"], pairs, strict=True)]
        best = {**settings, "OutputConfiguration": {**values, "outputs": outputs}}
        if load(best, model).total <= capacity:
            break
    return best


def _ladder(pair: Pair, model: Model | None) -> tuple[int, ...]:
    """The possible rates of an item, from its present one down."""
    return tuple(rate for rate in allowed(max_rate(OUTPUTS[pair[0] & 0xFFF0], model)) if rate <= pair[1])


def _lowered(entry: Setting, pair: Pair, ceiling: int, model: Model | None) -> Setting:
    if not 0 < pair[1] != ALWAYS or pair[1] <= ceiling:
        return entry
    ladder = _ladder(pair, model)
    return {**entry, "output_frequency": next((rate for rate in ladder if rate <= ceiling), ladder[-1])}
