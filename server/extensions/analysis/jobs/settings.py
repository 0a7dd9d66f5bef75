"""Settings of analyses."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Interval, Unit

from imuscope.server.settings.extension_settings import ExtensionSettings

MIN_MB, MAX_MB = 64, 65_536


@dataclass(frozen=True, slots=True)
class AnalysisSettings(ExtensionSettings):
    """Settings of analyses.

    Args:
        analysis_s, analysis_mb: longest time and most memory of an analysis over HTTP (limits.py).
    """

    config_help: ClassVar[str] = (
        "  analysis_s, analysis_mb         limits of an analysis over HTTP (default 60 s, 1024 MB)\n"
    )
    analysis_s: Annotated[float, Interval(ge=1, le=86_400), Unit("s")] = 60.0
    analysis_mb: Annotated[int, Interval(ge=MIN_MB, le=MAX_MB), Unit("MB")] = 1024
