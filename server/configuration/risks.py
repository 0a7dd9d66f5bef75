"""Risks of writing a setting, the same for every origin: page, API, command line, profile, snapshot.

    the setting's own caution        a row of the family's table
    Driver.line_change               how the line could be cut
    Driver.risks                     risks of single fields
    a restart                        for settings that take effect after one

A write of a setting itself is requested; its wear of the flash memory is mentioned in the form.
"""

from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver, Risk, Values
from imuscope.protocols.schema.fields import Setting
from imuscope.protocols.schema.layouts import EncodeError


def dangers_of_write(
    driver: DeviceDriver,
    row: Setting,
    old: Values | None,
    values: Values,
    known: DeviceContext,
    *,
    restarts: bool = True,
) -> list[Risk]:
    """Risks of writing these values of a setting; empty if the device already has them.

    Args:
        old: present values, if known.
        restarts: the device is restarted afterwards if the setting takes effect only then.
    """
    new = dict(values) if row.partial or old is None else {**old, **values}
    if old is not None and not driver.same(row.name, {name: old.get(name) for name in new}, new):
        return []
    risks = []
    if row.caution:
        risks.append(Risk(row.caution, row.consequence))
    try:
        line = driver.line_change(row.name, old, new, known)
    except (KeyError, EncodeError):
        line = None  # incomplete values; the job checks again when it has read the rest
    if line is not None:
        risks.append(Risk("cuts-line", line.words))
    risks += driver.risks(row.name, old, new, known)
    if restarts and row.after == "reset" and not any(one.caution == "restarts" for one in risks):
        risks.append(Risk("restarts", driver.restart_words))
    return risks
