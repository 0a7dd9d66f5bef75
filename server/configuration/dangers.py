"""What could be lost by writing a setting? One answer for every door: page, API, command line, profile, snapshot.

    the setting's own caution        a row of the family's table
    Driver.line_change               how the line could be cut
    Driver.harm                      what single fields cost
    a restart                        of what takes effect after one

Flash that wears a little with each write is told in the form and not asked about.
"""

from __future__ import annotations

from dataclasses import dataclass

from protocols.layouts import EncodeError
from protocols.schema import Setting
from protocols.transactions import DeviceContext, DeviceDriver, Values

UNASKED = ("", "wears-flash")
RESTARTS = "The device restarts so that this takes effect; it sends nothing for about two seconds."


@dataclass(frozen=True, slots=True)
class Risk:
    """What something could cost."""

    caution: str
    consequence: str


def dangers_of_write(
    driver: DeviceDriver,
    row: Setting,
    old: Values | None,
    values: Values,
    known: DeviceContext,
    *,
    restarts: bool = True,
) -> list[Risk]:
    """What writing these values of a setting could cost; nothing where the device has them already.

    Args:
        old: what it has, where that is known.
        restarts: the device is restarted afterwards, where that is what makes the setting take effect.
    """
    new = dict(values) if row.partial or old is None else {**old, **values}
    if old is not None and not driver.same(row.name, {name: old.get(name) for name in new}, new):
        return []
    found = []
    if row.caution not in UNASKED:
        found.append(Risk(row.caution, row.consequence))
    try:
        line = driver.line_change(row.name, old, new, known)
    except (KeyError, EncodeError):
        line = None  # of values that are not whole; the job asks again when it has read the rest
    if line is not None:
        found.append(Risk("cuts-line", line.words))
    found += [Risk(one.caution, one.consequence) for one in driver.harm(row.name, old, new, known)]
    if restarts and row.after == "reset" and not any(one.caution == "restarts" for one in found):
        found.append(Risk("restarts", RESTARTS))
    return found
