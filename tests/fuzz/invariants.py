"""Invariants that hold for any bytes.

    raised       nothing raises: decoder, listing, columns, sentences, guess; and every line can be written as JSON
    chunks       the events do not depend on how the stream was cut
    buffered     after a drain at most one maximal frame (and an unfinished sentence) is held back; after the last, none
    oracle       the listing's frames and rejects are those of the slow oracle, and so are its values
    decoder      the decoder's frames are the listing's, each with the arrival time of its last byte
    columns      columns hold the oracle's values, in shown units (columns.py)
    compose      what is said of a frame as plain values, through JSON, is the frame again, byte for byte
    account      frames and messages of others do not overlap; what is left is exactly what the decoder calls skipped
    datagrams    where chunks are datagrams, each is searched on its own

`check` raises BrokenError at the first that does not, and otherwise returns what the case showed, for the corpus.
"""

import json
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from imuscope.protocols.embedded.quantities import NmeaQuantities
from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap, Text
from imuscope.protocols.registry.families import PROTOCOLS, detect
from tests.fuzz import columns
from tests.fuzz.cases import BrokenError, Case
from tests.oracles import idtp as idtp_oracle
from tests.protocols.protocol_cases import KEY, UNFINISHED_TEXT, ProtocolCase, canonical

Lines = list[dict[str, Any]]
Features = frozenset[tuple[Any, ...]]

LATE = ("stale", "far_ahead")  # rejects of whole frames


def check(speaker: ProtocolCase, case: Case, *, guessing: bool = False) -> Features:
    """Check one case.

    Raises:
        BrokenError: an invariant does not hold.
    """
    try:
        whole, skipped = _decoded(speaker, case, [case.data])
        cut, _ = _decoded(speaker, case, case.chunks())
        lines = _listed(speaker, case)
        if guessing:
            _guessed(case)
    except BrokenError:
        raise
    except Exception as problem:
        raise BrokenError("raised", f"{type(problem).__name__}: {problem}") from problem
    _same(whole, cut)
    _arrivals(speaker, case, cut, lines)
    _like_the_oracle(speaker, case, lines)
    _like_the_listing(speaker, whole, lines)
    columns.check(speaker.name, case, [event for event in whole if isinstance(event, Batch)])
    _composed(speaker, case, lines)
    _accounted(speaker, case, lines, skipped)
    if speaker.name == "idtp":
        _datagrams(speaker, case)
    return _features(whole, lines)


def _decoded(speaker: ProtocolCase, case: Case, chunks: Sequence[bytes]) -> tuple[list[Event], int]:
    """All events of the stream with these cuts, and the number of bytes outside frames. Arrival is the
    chunk's number.
    """
    decoder = speaker.family.decoding.decoder(**case.settings)
    events: list[Event] = []
    for number, chunk in enumerate(chunks):
        decoder.feed(chunk, number)
        events += decoder.drain()
        if decoder.buffered > speaker.longest + UNFINISHED_TEXT:
            raise BrokenError("buffered", f"{decoder.buffered} bytes are held back")
    events += decoder.drain(stalled=True)
    if decoder.buffered:
        raise BrokenError("buffered", f"{decoder.buffered} bytes are held back at the end")
    NmeaQuantities().batches(event for event in events if isinstance(event, Text))
    return events, decoder.skipped  # type: ignore[attr-defined]


def _listed(speaker: ProtocolCase, case: Case) -> Lines:
    """The lines, through JSON and back, as a script reads them."""
    listing = speaker.family.frames.listing(**case.settings)
    listing.feed(case.data)
    lines = listing.drain(stalled=True)
    return [json.loads(json.dumps(line, ensure_ascii=False, allow_nan=False)) for line in lines]


def _guessed(case: Case) -> None:
    for one in detect(case.data):
        if not 0 <= one.score <= 1:
            raise BrokenError("guess", f"{one.protocol} has a score of {one.score}")


# -- the decoder against itself ----------------------------------------------------------------------------------------


def _same(whole: list[Event], cut: list[Event]) -> None:
    a, b = canonical(whole), canonical(cut)
    if a != b:
        odd = next((pair for pair in zip(a, b, strict=False) if pair[0] != pair[1]), (a[-1:], b[-1:]))
        raise BrokenError("chunks", f"{len(a)} and {len(b)} events; {str(odd[0])[:300]} | {str(odd[1])[:300]}")


def _arrivals(speaker: ProtocolCase, case: Case, events: list[Event], lines: Lines) -> None:
    """Every frame arrives with the chunk that completes it."""
    ends: list[int] = []
    for chunk in case.chunks():
        ends.append((ends[-1] if ends else 0) + len(chunk))
    size = {line["offset"]: line["size"] for line in lines if line.get("protocol") == speaker.name}
    for event in events:
        if isinstance(event, Batch):
            places = zip(event.offset.tolist(), event.arrival_ns.tolist(), strict=True)
        elif isinstance(event, Reply) and event.message.id >= 0:
            places = zip([event.offset], [event.arrival_ns], strict=True)
        else:
            continue
        for offset, arrival in places:
            expected = sum(end < offset + size.get(offset, 0) for end in ends)
            if offset not in size or arrival != expected:
                raise BrokenError("decoder", f"the frame at {offset} arrived at {arrival}, not {expected}")


# -- the decoder against others ----------------------------------------------------------------------------------------


def _like_the_oracle(speaker: ProtocolCase, case: Case, lines: Lines) -> None:
    frames, rejects = speaker.expected(case.data, **case.settings)
    own = [line for line in lines if "reject" not in line and line["protocol"] == speaker.name]
    got = [line["offset"] for line in own]
    if got != [offset for offset, _ in frames]:
        raise BrokenError("oracle", f"frames at {got}, the oracle has {[offset for offset, _ in frames]}")
    for line, (offset, expected) in zip(own, frames, strict=True):
        message = speaker.of_line(line) if isinstance(expected, str) else line["id"]
        if message != expected:
            raise BrokenError("oracle", f"the frame at {offset} says {message!s:.300}, the oracle {expected!s:.300}")
    first = speaker.preamble[0]
    failed = [(x["offset"], x["reject"]) for x in lines if "reject" in x and case.data[x["offset"]] == first]
    failed = [one for one in failed if one[1] != "bad_item"]
    if failed != rejects:
        raise BrokenError("oracle", f"rejects {failed!s:.300}, the oracle has {rejects!s:.300}")


def _like_the_listing(speaker: ProtocolCase, events: list[Event], lines: Lines) -> None:
    """Same frames by name, same texts, same rejects."""
    expected = sorted((x["offset"], speaker.message_of(x)) for x in lines if x.get("protocol") == speaker.name)
    got = [(offset, e.message.name) for e in events if isinstance(e, Batch) for offset in e.offset.tolist()]
    got += [(e.offset, e.message.name) for e in events if isinstance(e, Reply) and e.message.id >= 0]
    twice = [e for e in events if isinstance(e, RejectedFrame) and e.reason == "repeated"]  # listed as what they are
    events = [e for e in events if e not in twice]
    got += [(e.offset, "MTData2") for e in twice]
    if speaker.name == "idtp":  # a payload too short for its type has a separate message
        got = [(offset, name.removesuffix("Bytes")) for offset, name in got]
    if sorted(got) != expected:
        raise BrokenError("decoder", f"{sorted(set(got) ^ set(expected))!s:.300} differ, or come twice")
    texts = [(x["offset"], x["size"], x["message"]) for x in lines if x.get("id", 0) is None]
    if sorted((e.offset, e.size, e.name) for e in events if isinstance(e, Text)) != texts:
        raise BrokenError("decoder", f"texts differ from the listing's {texts!s:.300}")
    rejects = sorted((x["offset"], x["size"], x["reject"]) for x in lines if "reject" in x)
    if sorted((e.offset, e.size, e.reason) for e in events if isinstance(e, RejectedFrame)) != rejects:
        raise BrokenError("decoder", f"rejects differ from the listing's {rejects!s:.300}")


def _composed(speaker: ProtocolCase, case: Case, lines: Lines) -> None:
    for line in lines:
        if line.get("protocol") != speaker.name or line.get("verified") is False:
            continue
        frame = case.data[line["offset"] : line["offset"] + line["size"]]
        key = case.settings.get("key", KEY)
        try:
            again = speaker.again(line) if key == KEY else speaker.again(line, key)  # type: ignore[call-arg]
        except Exception as problem:
            words = f"{type(problem).__name__}: {problem}; of {json.dumps(line)[:300]}"
            raise BrokenError("compose", words) from problem
        if again != frame:
            raise BrokenError("compose", f"{frame.hex()[:200]} becomes {again.hex()[:200]} by {json.dumps(line)[:300]}")


def _accounted(speaker: ProtocolCase, case: Case, lines: Lines, skipped: int) -> None:
    """Every byte is in a frame, in a message of others, or skipped (rejected, or noise): exactly once."""
    spans = sorted((x["offset"], x["offset"] + x["size"]) for x in lines if "reject" not in x or x["reject"] in LATE)
    end = 0
    for begin, stop in spans:
        if begin < end or stop > len(case.data) or stop <= begin:
            raise BrokenError("account", f"what lies at {begin} to {stop} overlaps what ends at {end}")
        end = stop
    left = len(case.data) - sum(stop - begin for begin, stop in spans)
    if left != skipped:
        raise BrokenError("account", f"{left} bytes belong to nothing, the decoder says {skipped}")
    frames = [(x["offset"], x["offset"] + x["size"]) for x in lines if x.get("protocol") == speaker.name]
    visited: set[tuple[int, str]] = set()
    for line in lines:
        if "reject" not in line:
            continue
        at, size = line["offset"], line["size"]
        if not 0 < size <= len(case.data) - at or (at, line["reject"]) in visited:
            raise BrokenError("account", f"the reject at {at} of {size} bytes is beside the stream, or comes twice")
        visited.add((at, line["reject"]))
        if any(begin <= at < stop for begin, stop in frames) != (line["reject"] == "bad_item"):
            raise BrokenError("account", f"the reject at {at}, {line['reject']}, lies in a frame that was accepted")


def _datagrams(speaker: ProtocolCase, case: Case) -> None:
    """Chunks as datagrams: no frame extends over the end of one."""
    settings = case.settings
    decoder = PROTOCOLS["idtp"].decoding.decoder(datagrams=True, **settings)
    for number, chunk in enumerate(case.chunks()):
        decoder.feed(chunk, number)
    events = decoder.drain()
    if decoder.buffered:
        raise BrokenError("datagrams", f"{decoder.buffered} bytes are held back")
    got = sorted(int(offset) for e in events if isinstance(e, Batch) for offset in e.offset)
    key = settings.get("key")
    least = settings.get("min_mode", idtp_oracle.LITE if key is None else idtp_oracle.SECURE)
    frames: list[idtp_oracle.OracleIdtpFrame] = []
    at = 0
    for chunk in case.chunks():
        results = idtp_oracle.scan(
            chunk, final=True, key=key, min_mode=least, unverified=bool(settings.get("show_unverified"))
        )
        for frame in results.frames:
            frame.offset += at
        frames += results.frames
        at += len(chunk)
    if settings.get("replay_check", True):
        frames = [frame for frame, _ in idtp_oracle.judge(frames, keyed=key is not None)[0]]
    if got != [frame.offset for frame in frames]:
        raise BrokenError("datagrams", f"frames at {got}, the oracle has {[frame.offset for frame in frames]}")


# -- what it showed ----------------------------------------------------------------------------------------------------


def _features(events: list[Event], lines: Lines) -> Features:
    """Words for what happened, single and in pairs: a case with a new one is worth going on from."""
    words: list[tuple[Any, ...]] = []
    for event in events:
        if isinstance(event, Batch):
            names = [field.name for field in event.message.fields][:8]
            words.append(("batch", event.message.name, event.time_ns is None, *names[:3], min(len(names), 6)))
        elif isinstance(event, Reply):
            words.append(("reply", event.message.name, min(len(event.values), 4)))
        elif isinstance(event, Text):
            words.append(("text", event.protocol, event.name[:6]))
        elif isinstance(event, RejectedFrame):
            words.append(("reject", event.reason))
        elif isinstance(event, ClockStep):
            words.append(("step", event.kind, event.by_ns > 0))
        elif isinstance(event, SampleGap):
            words.append(("gap", event.missing > 1))
    results = set(words)
    kinds = [word[:2] for word in words]
    results |= {("then", *a, *b) for a, b in pairwise(kinds) if "batch" not in (a[0], b[0])}
    for line in lines:
        results |= {("wire", line.get("message"), name) for name in line.get("wire", ())}
        results |= {("note", name) for name in line.get("notes", ())}
    return frozenset(results)
