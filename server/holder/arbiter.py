"""One voice at a time towards the device.

Whoever sends to the device has the voice until it has sent nothing for QUIET_S; the server also keeps it while it
carries out a transaction (`lock`). The others wait: what they send is not read from them, so their own buffers hold it.
"""

from __future__ import annotations

SERVER = 0
"""Number of the server among the speakers; clients have numbers from 1 on."""
QUIET_S = 0.5  # longer than a device takes for an answer, so that a dialogue is not interrupted


class Arbiter:
    """Decides who may send. Times are of a monotonic clock, s."""

    def __init__(self) -> None:
        self._speaker: int | None = None
        self._until = 0.0
        self._locked = False

    def speaker(self, now: float) -> int | None:
        """The speaker that has the voice; None: nobody."""
        if now < self._until:
            return self._speaker
        return SERVER if self._locked else None

    def may_speak(self, who: int, now: float) -> bool:
        """Whether `who` may send now."""
        return self.speaker(now) in (None, who)

    def spoke(self, who: int, now: float) -> None:
        """Note that `who` sends; call it only if it may."""
        self._speaker, self._until = who, now + QUIET_S

    def lock(self) -> None:
        """Keep the voice for the server until `unlock`, from when a client that has it now is quiet."""
        self._locked = True

    def unlock(self) -> None:
        """End what `lock` began. Idempotent."""
        self._locked = False
        self.forget(SERVER)

    def forget(self, who: int) -> None:
        """Free the voice, if `who` has it."""
        if self._speaker == who:
            self._until = 0.0
