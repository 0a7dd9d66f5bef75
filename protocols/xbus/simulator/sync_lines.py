"""Sync functions of the simulated MTi, and the lines on which each is accepted.

Transcribed from the document a second time, apart from product_options.py, which validates what a user enters: a slip
in one of the two shows as a refusal in a test. Rows of Table 11, columns of Table 12, with the footnotes of both.

Source: MT0101P 2020.A, 5.3.4, Tables 11 and 12.
"""

from __future__ import annotations

from collections.abc import Mapping

from imuscope.protocols.xbus.products import Model

_SEND_LATEST, _GNSS_PULSE = 8, 14
_FUNCTIONS: Mapping[str, tuple[tuple[int, ...], tuple[int, ...]]] = {  # Table 11, by column: sync in, sync out
    "MTi-1s": ((8,), ()),
    "MTi-7": ((8, 9), (14,)),
    "MTi-10s/100s": ((3, 8, 9, 11), (4,)),
    "MTi-G-710": ((3, 8, 9, 11), (4, 14)),
    "MTi-610/620/630": ((3, 8, 9, 11), (4,)),
    "MTi-670/680G": ((3, 8, 9, 11), (4, 14)),
}
_INPUTS: Mapping[str, tuple[int, ...]] = {  # Table 12
    "MTi-1s": (2, 0),
    "MTi-7": (2, 1),
    "MTi-10s/100s": (2, 0),
    "MTi-G-710": (2, 0, 1, 5),
    "MTi-610/620/630": (2, 9),
    "MTi-670/680G": (2, 9),
}
_OUTPUT: Mapping[str, int] = {"MTi-10s/100s": 4, "MTi-G-710": 4, "MTi-610/620/630": 7, "MTi-670/680G": 7}
_PULSE: Mapping[int, tuple[int, ...]] = {
    7: (8,),
    710: (4,),
    670: (2, 9, 7),  # footnote 5: on In1 or In2 the time pulse comes with it
    680: (10, 7),  # footnotes 1 and 6: In3 is the internal line of the pulse
}
SOFTWARE = 6


def accepts(model: Model, function: int, line: int) -> bool:
    """Whether a product performs a function on a line."""
    column = _column(model)
    inputs, outputs = _FUNCTIONS[column]
    if function in inputs:
        return line in _INPUTS[column] or (line == SOFTWARE and function == _SEND_LATEST)
    if function not in outputs:
        return False
    return line in _PULSE[model.number] if function == _GNSS_PULSE else line == _OUTPUT[column]


def is_sync_out(function: int) -> bool:
    """Whether a function generates a pulse."""
    return any(function in outputs for _, outputs in _FUNCTIONS.values())


def _column(model: Model) -> str:
    if model.series == 1:
        return "MTi-7" if model.number == 7 else "MTi-1s"
    if model.series == 600:
        return "MTi-670/680G" if model.number >= 670 else "MTi-610/620/630"
    return "MTi-G-710" if model.number == 710 else "MTi-10s/100s"
