"""Shedding of load: the work left out, and its order, when more arrives than this computer can decode in time.

    decoding is behind by    left out
    PICTURES_S               pictures: third-party viewers get a fifth of their samples' messages, and recordings that
                             were never opened get no picture in the list
    PAGES_S                  rates of pages: samples are decoded and sent five times a second, in few large turns
    more                     decoding: bytes wait, up to MAX_HELD a device, and are then dropped and counted
                             (server/links/base.py)
    never                    recordings, shared ports: they take the bytes in the threads and processes that read them

Nothing of this loses a sample: a viewer gets the same samples later, in larger messages. Each step is taken back after
decoding has kept up for `CALM_S`.
"""

PICTURES_S = 0.3
PAGES_S = 0.5
KEEPS_UP_S = 0.25  # more than the longest interval between two turns without viewers
CALM_S = 3.0
PAGE_INTERVAL_S = 0.2
PICTURE_FACTOR = 5.0
PICTURES, PAGES = 1, 2


class Shedding:
    """Present step of shedding.

    Attributes:
        step: 0 nothing is left out; `PICTURES`; `PAGES`: both.
    """

    def __init__(self) -> None:
        self.step = 0
        self._calm_since: float | None = None

    def update(self, behind: float, now: float) -> None:
        """Note by how much the device that is most behind is behind in decoding, s, at `now`, s."""
        needed = PAGES if behind > PAGES_S else PICTURES if behind > PICTURES_S else 0
        if needed > self.step:
            self.step = needed
        if self.step == 0 or behind > KEEPS_UP_S + self.page_interval:
            self._calm_since = None
        elif self._calm_since is None:
            self._calm_since = now
        elif now - self._calm_since >= CALM_S:
            self.step -= 1
            self._calm_since = now

    @property
    def page_interval(self) -> float:
        """Shortest interval between samples for pages, s."""
        return PAGE_INTERVAL_S if self.step >= PAGES else 0.0

    @property
    def picture_factor(self) -> float:
        """Factor of the time that third-party viewers wait between two messages of samples."""
        return PICTURE_FACTOR if self.step >= PICTURES else 1.0

    @property
    def draws_pictures(self) -> bool:
        """Whether recordings are opened for their picture in the list."""
        return self.step < PICTURES
