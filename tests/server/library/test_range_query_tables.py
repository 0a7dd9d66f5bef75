"""Requested tables and exported files: in order, one at a time, with distinct names."""

import numpy as np
import pytest
from starlette.requests import Request

from imuscope.protocols.clocks.unix_time import NO_TIME
from imuscope.recordings.columns.rows import ExactRows
from imuscope.server.api.recording_data import _only_one
from imuscope.server.errors import DomainError
from imuscope.server.library.export_jobs import file_stem
from imuscope.server.library.range_query import QueryResult, ordered
from imuscope.server.wire import ChannelInfo


def test_rows_of_a_query_go_by_their_time() -> None:
    """A late solution is inserted in order; a row without a clock is ordered by arrival."""
    info = ChannelInfo(1, "1", "M", "M", "M", "scalar", "", "", [])
    rows = ExactRows(np.array([10, 20, 30, 40]), np.array([9, 19, 12, NO_TIME]), [np.array([1, 2, 3, 4])])
    got = ordered(QueryResult(info, rows, (0,))).rows
    assert isinstance(got, ExactRows)
    assert got.columns[0].tolist() == [1, 3, 2, 4]
    assert got.arrival_ns.tolist() == [10, 30, 20, 40]


def test_a_channel_named_twice_is_refused() -> None:
    def request(query: bytes) -> Request:
        return Request({"type": "http", "query_string": query, "headers": []})

    _only_one(request(b"channel=A&width=3"))
    with pytest.raises(DomainError):
        _only_one(request(b"channel=A&channel=B"))


def test_the_name_of_an_export_contains_its_range() -> None:
    assert file_stem("Drive 1", None, None) == "Drive-1"
    assert file_stem("Drive", 1.76e9, None) == "Drive-20251009T085320Z-end"
    assert file_stem("Drive", 1.76e9, 1.76e9 + 5) == "Drive-20251009T085320Z-20251009T085325Z"
