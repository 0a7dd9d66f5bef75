"""`imuscope doctor`: check the machine (server/diagnostics/checks.py) and suggest fixes.

problem  /dev/ttyUSB0   pi may not open it: it belongs to the group dialout.
                        → sudo usermod -aG dialout pi
warning  /dev/ttyUSB0   Its adapter holds bytes back for up to 16 ms: samples come in bursts.
                        → echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer
ok       disk           23.1 GB free.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from importlib import resources
from typing import TextIO

from imuscope.recordings.optional_packages import installation_of
from imuscope.server.diagnostics.checks import RULES, Finding
from imuscope.server.services.extension import absent_extensions, attempt, extension_problems, extensions
from imuscope.server.settings.config import Config
from imuscope.server.text.printable import json_text, printable

UNIT = "imuscope.service"
_RANK = {"problem": 0, "warning": 1, "ok": 2}


def format_findings(findings: Sequence[Finding], out: TextIO, *, as_json: bool = False) -> int:
    """Print the findings, worst first. Returns the exit status: 1 if there is a problem."""
    ordered = sorted(findings, key=lambda one: _RANK[one.status])
    if as_json:
        out.write(json_text([_row(one) for one in ordered], indent=1) + "\n")
    else:
        width = max((len(one.about) for one in ordered), default=0)
        for one in ordered:
            out.write(printable(f"{one.status:<8} {one.about:<{width}}  {one.message}") + "\n")
            for step in one.todo:
                out.write(printable(f"{'':<8} {'':<{width}}  → {step}") + "\n")
    return int(any(one.status == "problem" for one in findings))


def _row(finding: Finding) -> dict[str, object]:
    """A finding in JSON; `found` is its sentence, as programs know it."""
    return {"status": finding.status, "about": finding.about, "found": finding.message, "todo": finding.todo}


def extension_findings(config: Config) -> Iterator[Finding]:
    """Extensions that cannot be used, and what the others find."""
    for one in extensions():
        yield from attempt(one, partial(one.diagnose, config)) or ()
    for problem in extension_problems():
        yield Finding("warning", "extension", problem)
    for one in absent_extensions():
        yield Finding("ok", "extension", f"{one.title} is not installed.", (installation_of(one.extra),))


def udev_rule() -> str:
    """The rule for /etc/udev/rules.d."""
    return resources.files("imuscope.server.packaging").joinpath(RULES).read_text(encoding="utf-8")


def systemd_unit() -> str:
    """The unit for /etc/systemd/system."""
    return resources.files("imuscope.server.packaging").joinpath(UNIT).read_text(encoding="utf-8")
