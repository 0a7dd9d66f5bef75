"""pytest plugin: notes how long each file of tests took, for the order of the next run and for `--quick`."""

from collections import defaultdict

import pytest

from tests.checking.affected import note_durations


class Durations:
    """Sums the seconds of each file."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = defaultdict(float)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[report.nodeid.partition("::")[0]] += report.duration

    def pytest_sessionfinish(self) -> None:
        note_durations({name: round(seconds, 2) for name, seconds in self._seconds.items()})


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Durations(), "durations_of_files")
