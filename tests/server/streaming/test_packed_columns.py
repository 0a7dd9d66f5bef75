"""Packed columns are the same again, bit by bit, and clocks take little memory."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.streaming.packed_columns import packed, unpack


@given(st.sampled_from(["f8", "f4", "i8", "u8", "i4", "u4", "i2", "u2", "i1", "u1"]), st.binary(max_size=4096))
def test_any_bits_are_kept(name: str, data: bytes) -> None:
    """Also those of what is not a number, and of the most negative one."""
    dtype = np.dtype("<" + name)
    column = np.frombuffer(data[: len(data) // dtype.itemsize * dtype.itemsize], dtype)
    out = np.empty_like(column)
    unpack(packed(column), out)
    assert out.tobytes() == column.tobytes()


def test_packed_columns_take_less_memory() -> None:
    noise = np.random.default_rng(1)
    n = 2048
    time = 1.8e9 + np.arange(n) / 400
    for column, share in (
        (time, 0.05),
        (time + noise.exponential(1e-4, n), 0.3),
        (np.cos(np.arange(n) / 400).astype("f4"), 0.5),
        ((9.8 + 0.02 * noise.standard_normal(n)).astype("f4"), 0.8),
    ):
        assert len(packed(column)) < share * column.nbytes
