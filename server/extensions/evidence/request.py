"""Request for evidence: POST /api/recordings/{recording}/evidence. Times are unix seconds."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

Text = Annotated[str, Field(max_length=1000)]
Colour = Literal["axis-x", "axis-y", "axis-z", "axis-n"]

MAX_PLOTS = 60
MAX_SERIES = 24  # of one plot


@dataclass(slots=True)
class EvidenceSeries:
    """One curve: a signal as `POST /api/analysis/{name}` names it, shown as `factor` · value + `offset`."""

    signal: Text  # "Acceleration.x", "DEVICE/Acceleration.x", or an expression
    part: Annotated[int, Field(ge=0, le=1000)] = 0  # which column, if the signal has several
    factor: float = 1.0
    offset: float = 0.0
    label: Text = ""
    colour: Colour | Literal[""] = ""
    dash: Annotated[list[float], Field(max_length=6)] = field(default_factory=list)
    decimals: Annotated[int, Field(ge=-1, le=12)] = -1  # of its values; -1: as many as needed
    period: Annotated[float, Field(ge=0)] = 0.0  # an angle wraps at this value; 0: as the device says


@dataclass(slots=True)
class EvidencePlot:
    """Curves that share one plot and its axes."""

    title: Text
    unit: Text
    series: Annotated[list[EvidenceSeries], Field(max_length=MAX_SERIES)]
    low: float | None = None  # fixed ends of its y axis; null: from the data
    high: float | None = None
    log: bool = False  # a logarithmic y axis, as long as every value is positive


@dataclass(slots=True)
class EvidenceRequest:
    """Choice of what the file shows; everything may be left out."""

    t0: float | None = None  # null: from the beginning
    t1: float | None = None
    base: Literal["device", "arrival"] = "device"
    plots: Annotated[list[EvidencePlot], Field(max_length=MAX_PLOTS)] | None = None  # null: all quantities
    cursor_a: float | None = None
    cursor_b: float | None = None
    with_position: bool = True  # false: leave out everything that reveals where it was recorded


request_of = TypeAdapter(EvidenceRequest).validate_python
