"""Choices offered by the two list editors of a form; see schema.Setting.editor."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class OutputChoice:
    """One quantity available in an output configuration."""

    data_identifier: int  # with Float32 and ENU if selectable
    title: str
    group: str
    rates: list[int]  # allowed, Hz, fastest first; empty: with every message (0xFFFF)
    formats: list[int]  # available precision bits; empty: fixed
    frames: list[int]  # available coordinate bits; empty: fixed
    size: int  # bytes of its data at Float32
    unit: str = ""
    basic: bool = True
    doc: str = ""


@dataclass(slots=True)
class StreamChoice:
    """One data set that a device can stream."""

    did: int
    name: str
    title: str
    group: str
    size: int  # bytes of its data; −1: variable
    rmc_bit: int = -1  # bit of the RMC word; −1: by GET_DATA only
    source_ms: float = 0.0  # period of one, ms; 0: unknown until the device reports it
    basic: bool = True
    doc: str = ""
