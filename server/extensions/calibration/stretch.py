"""Calibration of a stretch of samples as a job of another process (server/extensions/analysis/jobs/jobs.py)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imuscope.server.extensions.analysis.jobs.jobs import JSON, Content, SampleSource
from imuscope.server.extensions.analysis.signals.signals import SignalColumn
from imuscope.server.extensions.analysis.signals.triads import Samples, Triad, finite
from imuscope.server.extensions.calibration.kinds import METHODS, CalibrationOptions, evaluated


@dataclass(frozen=True, slots=True)
class CalibrationJob:
    """A calibration with all samples of a source.

    Args:
        kind: a key of METHODS.
        triads: its sensors.
    """

    kind: str
    triads: Mapping[str, Triad]
    options: CalibrationOptions
    source: SampleSource

    def content(self) -> Content:
        """The report, as `CalibrationReport`.

        Raises:
            DomainError: the samples do not determine it.
        """
        read = self.source.opened()
        samples: dict[str, Samples] = {}
        for key, triad in self.triads.items():
            columns = [read(SignalColumn(triad.info, at)) for at in triad.at]
            samples[key] = finite(columns[0][0], np.stack([values for _, values in columns], axis=1) * triad.factor)
        report = evaluated(METHODS[self.kind], self.triads, samples, self.options)
        return Content(JSON, report.model_dump_json().encode())
