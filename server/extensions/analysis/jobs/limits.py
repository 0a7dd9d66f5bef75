"""Limits of one analysis: memory and time of its process, and samples that it computes."""

from dataclasses import dataclass

from imuscope.server.errors import DomainError

MEMORY_MB = 1024
TIME_S = 60.0
LESS = "Request a shorter range or fewer signals."


@dataclass(frozen=True, slots=True)
class AnalysisLimits:
    """Limits of an analysis over HTTP: memory besides its libraries, MB, and time without waiting, s."""

    memory_mb: int = MEMORY_MB
    time_s: float = TIME_S

    @classmethod
    def of(cls, words: list[str]) -> "AnalysisLimits":
        """Limits from the words of a command line."""
        memory_mb, time_s = words
        return cls(int(memory_mb), float(time_s))

    @property
    def words(self) -> tuple[str, str]:
        """As words of a command line."""
        return str(self.memory_mb), f"{self.time_s:g}"

    def too_much_memory(self) -> DomainError:
        return DomainError("too-many", f"The analysis takes more memory than {self.memory_mb} MB.", LESS)

    def too_long(self) -> DomainError:
        """The error of an analysis that exceeds the time."""
        return DomainError("too-many", f"The analysis takes longer than {self.time_s:g} s.", LESS)
