"""Comparison of decoded columns with the oracle's values, in display units.

The oracle gives wire values of every frame, by the names of the facts; a column's row is looked up by the frame's
offset. Parts of ISB data sets are merged here a second time, by the plain rule: a part changes the last whole value
that it fits into.
"""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from imuscope.protocols.events import Batch
from imuscope.protocols.idtp.messages import WIRE
from imuscope.protocols.schema.fields import Field
from tests.fuzz.cases import BrokenError, Case
from tests.oracles import idtp as idtp_oracle
from tests.oracles import isb as isb_oracle
from tests.oracles import mip as mip_oracle
from tests.oracles import xbus as xbus_oracle
from tests.protocols.isb import isb_vectors
from tests.protocols.protocol_cases import isb_steady

_IN_A_LIST = re.compile(r"(.+?)\[(\d+)\]\.(.+)")
Values = dict[str, list[Any]]


def check(protocol: str, case: Case, batches: list[Batch]) -> None:
    """Compare.

    Raises:
        BrokenError: a value differs, or a row has no frame.
    """
    expected = dict({"xbus": _xbus, "isb": _isb, "idtp": _idtp, "mip": _mip}[protocol](case))
    for batch in batches:
        fields = {field.name: field for field in batch.message.fields}
        for i, offset in enumerate(batch.offset.tolist()):
            values = expected.get(offset)
            if values is None:
                continue
            if protocol == "xbus":
                values = _by_column(values, list(fields), offset)
            for name, numbers in values.items():
                _compare(batch, fields, i, name, numbers)


def _by_column(values: Values, columns: list[str], offset: int) -> Values:
    """The items of an MTData2 by the names of their columns: the last of a name has it, the others have more."""
    results = list(values.values())
    names = [str(value[0]) for value in results]
    later = [name in names[place + 1 :] for place, name in enumerate(names)]
    fits = [
        column.startswith(name + "_") if again else column == name
        for column, name, again in zip(columns, names, later, strict=False)
    ]
    if len(columns) != len(results) or not all(fits):
        raise BrokenError("columns", f"at {offset} there are {columns}, the oracle has {names}")
    return {column: value[1:] for column, value in zip(columns, results, strict=True)}


def _compare(batch: Batch, fields: dict[str, Field], i: int, name: str, numbers: list[Any]) -> None:
    inner = _IN_A_LIST.fullmatch(name)
    if inner and inner[1] in fields:
        field = fields[inner[1]]
        column = batch.columns[inner[1]][i]
        if int(inner[2]) >= len(column) or inner[3] not in (column.dtype.names or ()):
            return  # more elements than are in use
        got = column[int(inner[2])][inner[3]]
        field = next(part for part in field.fields if part.name == inner[3])
    elif name in fields and not fields[name].fields:
        field, got = fields[name], batch.columns[name][i]
    else:
        return
    if field.dtype == "ascii":
        return
    got = np.asarray(got)
    if field.column_major:
        got = got.swapaxes(0, 1)
    is_sent = field.scale == 1 or field.sent_unit  # columns of another unit than the page's stay as they were sent
    shown = np.asarray(numbers) if is_sent and not field.bias else np.asarray(numbers) * field.scale + field.bias
    if got.size > 1 and got.size < shown.size:
        shown = shown[: got.size]  # a list, as far as it is in use
    with np.errstate(all="ignore"):
        same = np.array_equal(got.ravel(), shown.astype(got.dtype), equal_nan=got.dtype.kind == "f")
        same = same or (got.dtype.kind == "f" and np.allclose(got.ravel(), shown, rtol=1e-6, atol=0, equal_nan=True))
    if not same:
        raise BrokenError(
            "columns", f"{name} is {got!s:.200} at {int(batch.offset[i])}, the oracle says {shown!s:.200}"
        )


# -- the oracles' values, by offset of the frame -----------------------------------------------------------------------


def _xbus(case: Case) -> Iterator[tuple[int, Values]]:
    for frame in xbus_oracle.scan(case.data, final=True).frames:
        if frame.mid == 0x36:
            every, _ = xbus_oracle.mtdata2_items(frame.payload)
            yield frame.offset, {str(place): [name, *content] for place, (name, content) in enumerate(every)}


def _isb(case: Case) -> Iterator[tuple[int, Values]]:
    packets = isb_oracle.scan(case.data, final=True).packets
    report = any(one.kind == 4 and one.did in (1, 93, 120) for one in packets)
    whole: dict[int, bytes] = {}
    for one in packets:
        if one.kind != 4:
            continue
        payload, part = one.payload, one.part or 0
        last = whole.get(one.did, b"")
        if part and (one.did not in whole or part + len(payload) > len(last)):
            continue  # a part of something never seen whole
        if part:
            payload = last[:part] + payload + last[part + len(payload) :]
        whole[one.did] = payload
        row = isb_vectors.FORMATS.get(str(one.did))
        if row and len(payload) == row["size"] and (isb_steady(one.did) or not report):
            yield one.offset, isb_oracle.values(row["fields"], payload)


def _mip(case: Case) -> Iterator[tuple[int, Values]]:
    for offset, packet in mip_oracle.scan(case.data)[0]:
        values = mip_oracle.values(packet)
        if values is not None:
            yield offset, values


def _idtp(case: Case) -> Iterator[tuple[int, Values]]:
    key = case.settings.get("key")
    least = case.settings.get("min_mode", idtp_oracle.LITE if key is None else idtp_oracle.SECURE)
    unverified = bool(case.settings.get("show_unverified"))
    for frame in idtp_oracle.scan(case.data, final=True, key=key, min_mode=least, unverified=unverified).frames:
        message = idtp_oracle.values(frame)
        if message is None:
            continue
        values: Values = {
            field: [message[name] for name in names] for field, names in WIRE.items() if names[0] in message
        }
        if "Quaternion" in values:
            norm = float(np.linalg.norm(np.asarray(values["Quaternion"], np.float64)))
            if not abs(norm - 1) <= 0.01:
                values["Quaternion"] = [float("nan")] * 4
        yield frame.offset, values
