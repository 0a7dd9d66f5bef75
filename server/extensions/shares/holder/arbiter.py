"""One voice at a time towards the device.

A client that sends to the device has the voice until it has sent nothing for QUIET_S; the server also keeps it while it
carries out a transaction (`lock`), and a client while it configures the device (`configures`). The others wait: what
they send is not read from them, so their own buffers hold it.

    client:   configures ── its frames ── configured ──> the voice is free
                         ── silence, however long ──> it still configures: a user reads its dialog, or it sleeps
                         ── it leaves, or a user takes over (`forget`) ──> the voice is free
    talking without a pause for MOST_TURN_S while another one waits ──> `take_turn`, between two frames: others are next
"""

from __future__ import annotations

from imuscope.server.system.light_modules import INFINITY

SERVER = 0
"""Number of the server among the speakers; clients have numbers from 1 on."""
QUIET_S = 0.5  # longer than a device takes for an answer, so that a dialogue is not interrupted
CHANGED_QUIET_S = 2.0  # after a write of settings that has no end of its own: more are likely to follow
MOST_TURN_S = 5.0
BARRED_S = 1.0  # for whom a turn was taken from: twice what the others need to begin theirs


class Arbiter:
    """Decides who may send. Times are of a monotonic clock, s."""

    def __init__(self) -> None:
        self._speaker: int | None = None
        self._began = self._last = 0.0
        self._quiet_s = QUIET_S  # after the last byte, in which the speaker keeps the voice
        self._locked = False
        self._configuring: int | None = None
        self._barred: tuple[int, float] = (-1, 0.0)

    def speaker(self, now: float) -> int | None:
        """The speaker that has the voice; None: none."""
        if self._has_voice(now):
            return self._speaker
        return SERVER if self._locked else None

    def _has_voice(self, now: float) -> bool:
        return self._speaker is not None and now < self._last + self._quiet_s

    def configuring(self, now: float) -> int | None:
        """The client that is configuring the device; None: none."""
        return self._configuring if self._has_voice(now) and self._speaker == self._configuring else None

    def may_speak(self, who: int, now: float) -> bool:
        """Whether `who` may send now."""
        if who == self._barred[0] and now < self._barred[1]:
            return False
        return self.speaker(now) in (None, who)

    def spoke(self, who: int, now: float) -> None:
        """Note that `who` sends; call it only if it may."""
        if self._speaker != who or not self._has_voice(now):
            self._speaker, self._began, self._quiet_s = who, now, QUIET_S
            self._configuring = None
        self._last = now

    def configures(self, who: int, now: float, *, until_done: bool) -> None:
        """Note that what `who` has just sent configures the device.

        Args:
            until_done: `configured` follows, whenever that is.
        """
        if self._speaker != who:
            return
        self._configuring = who
        self._quiet_s = max(self._quiet_s, INFINITY if until_done else CHANGED_QUIET_S)
        self._last = now

    def configured(self, who: int, now: float) -> None:
        """Note that `who` has finished configuring the device."""
        if self._speaker == who:
            self._configuring, self._quiet_s = None, QUIET_S
            self._last = now

    def pause_s(self, now: float) -> float:
        """Seconds for which the speaker has sent nothing."""
        return now - self._last if self._has_voice(now) else now

    def take_turn(self, who: int, now: float) -> bool:
        """Release the write lock, which `who` has held for MOST_TURN_S, for waiting clients.

        Returns:
            False: it has not held the lock so long, or configures the device.
        """
        if self.speaker(now) != who or now - self._began < MOST_TURN_S or self.configuring(now) is not None:
            return False
        self._barred = who, now + BARRED_S
        self._speaker = None
        return True

    @property
    def is_locked(self) -> bool:
        """Whether the server carries out a transaction, or waits for its beginning."""
        return self._locked

    def lock(self) -> None:
        """Keep the voice for the server until `unlock`, from when a client that has it now is quiet."""
        self._locked = True

    def unlock(self) -> None:
        """End what `lock` began. Idempotent."""
        self._locked = False
        self.forget(SERVER)

    def forget(self, who: int) -> None:
        """Release the write lock if `who` holds it, also within a configuration."""
        if self._speaker == who:
            self._speaker = self._configuring = None
