"""Checks of the host for `imuscope doctor`: everything known to lose or delay samples.

    ports      present? permission to open them? open in another program? does an FTDI adapter hold bytes back?
    programs   ModemManager and brltty take a new port for a modem or a braille display, and write to it
    disk       is the data folder writable, how much is free, how long does a sync to disk take?
    clock      synchronised (NTP)? stepping? a fast clock source of the kernel?
    machine    memory, load, a governor that slows the processor; is there compiled code; is the page built?
    packages   of another place (PYTHONPATH) in place of those that were installed with imuscope

Each finding states a fact and, if necessary, a remedy: commands that can be pasted. Nothing is changed, and no port is
opened, so that devices in use are not disturbed.

Everything is read below `Machine.root`, so that a test can simulate any machine.

Source: Linux Documentation/ABI (sysfs-bus-usb, sysfs-devices-system-cpu), proc(5), adjtimex(2); ModemManager and brltty
udev rules.
"""

import ctypes
import os
import re
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Literal

from imuscope.server.system.open_files import (
    OWN,
    Program,
    descriptors,
    file_text,
    open_files,
    process_folders,
    program_of,
    unblock_steps,
)

Status = Literal["ok", "warning", "problem"]

PORTS = re.compile(r"tty(USB|ACM|AMA|THS|mxc|O|SC|HS|PS|LP|S)\d+\Z")  # as server/links/ports.py
RULES = "70-imuscope.rules"
UDEV = f"imuscope doctor --udev-rule | sudo tee /etc/udev/rules.d/{RULES}"
RELOAD = "sudo udevadm control --reload && sudo udevadm trigger --action=add"
LITTLE_FREE, SOME_FREE = 500e6, 5e9  # bytes; an hour of a 2 kHz device is 500 MB
SLOW_SYNC_S, MEASURED_SYNCS = 0.2, 5  # the recorder forces its file once a second
LITTLE_MEMORY = 700e6  # bytes: history (256 MB), the server itself, an export beside it
STEP_S = 0.05
CLOCK_SET_S = 1_700_000_000  # unix s; a clock before that was never set
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies", "pit")
VOLATILE = ("tmpfs", "ramfs", "overlay")


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check.

    Args:
        about: subject: "/dev/ttyUSB0", "data folder".
        message: one sentence.
        todo: remedies: commands, or sentences.
    """

    status: Status
    about: str
    message: str
    todo: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Machine:
    """State of the host.

    Args:
        data: the server's data folder.
        port: port on which it will listen; 0: not checked.
        root: replacement for /.
        uid, groups, name: of the user.
        synchronised: whether the kernel reports a synchronised clock; None if unknown.
        wall, steady: clocks, s.
        free: bytes left on the disk of a folder.
        sync: median time that a sync to it takes, s.
    """

    data: Path
    port: int = 0
    root: Path = Path("/")
    uid: int = field(default_factory=os.getuid)
    groups: frozenset[int] = field(default_factory=lambda: frozenset({os.getegid(), *os.getgroups()}))
    name: str = field(default_factory=lambda: _name_of(os.getuid()))
    synchronised: Callable[[], bool | None] = lambda: kernel_clock()
    wall: Callable[[], float] = time.time
    steady: Callable[[], float] = time.monotonic
    free: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free
    sync: Callable[[Path], float] = lambda folder: _sync_time(folder)

    def path(self, path: str) -> Path:
        return self.root / path.lstrip("/")

    def text(self, path: str) -> str:
        """Content of a file; "" if it cannot be read."""
        try:
            return self.path(path).read_text(errors="replace").strip()
        except OSError:
            return ""


def run_checks(machine: Machine) -> list[Finding]:
    """All findings, in the order listed at the top of this file."""
    offset = machine.wall() - machine.steady()
    findings = [*ports(machine), *programs(machine), *disk(machine)]
    findings += [*clock(machine, offset), *memory(machine), *processor(machine), *program(machine)]
    return [*findings, *packages()]


# ── ports ────────────────────────────────────────────────────────────────────────────────────────────────────────────


def ports(machine: Machine) -> Iterator[Finding]:
    """Every serial port."""
    try:
        names = sorted(one.name for one in machine.path("/sys/class/tty").iterdir() if PORTS.match(one.name))
    except OSError:
        names = []
    names = [name for name in names if machine.path(f"/dev/{name}").exists() and not _is_empty(machine, name)]
    if not names:
        todo = ("Plug the sensor in, then check `sudo dmesg | tail`. A network sensor needs no port.",)
        if machine.path("/.dockerenv").exists():
            todo = ("Pass it to the container: --device /dev/ttyUSB0 (see the top of the Dockerfile).",)
        yield Finding("warning", "serial ports", "None found.", todo)
    holders = open_files(lambda place: place.startswith("/dev/tty"), machine.root) if names else {}
    for name in names:
        yield from _port(machine, name, holders)


def _is_empty(machine: Machine, name: str) -> bool:
    """Whether a name reserved by the kernel (ttyS1 … ttyS31) has no UART."""
    return machine.text(f"/sys/class/tty/{name}/type") == "0"


def _port(machine: Machine, name: str, holders: dict[str, list[Program]]) -> Iterator[Finding]:
    place = f"/dev/{name}"
    try:
        about = machine.path(place).stat()
    except OSError as error:
        yield Finding("problem", place, f"It cannot be checked: {error.strerror}.")
        return
    needed = stat.S_IRUSR | stat.S_IWUSR
    mode = about.st_mode
    mine = mode if about.st_uid == machine.uid else mode << 3 if about.st_gid in machine.groups else mode << 6
    group = _group(machine, about.st_gid)
    if machine.uid == 0 or mine & needed == needed:
        yield Finding("ok", place, f"{machine.name} may open it.")
    elif about.st_gid and (mode << 3) & needed == needed:
        words = f"{machine.name} may not open it: it belongs to the group {group}."
        relogin = "log out and in again (a service: restart it)"
        yield Finding("problem", place, words, (f"sudo usermod -aG {group} {machine.name}", relogin))
    else:
        yield Finding("problem", place, f"Only its owner may open it; its group is {group}.", (UDEV, RELOAD))
    if place in holders:
        yield _in_use(place, holders[place])
    timer = machine.text(f"/sys/bus/usb-serial/devices/{name}/latency_timer")
    if timer.isdecimal() and int(timer) > 1:
        now = f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer"
        words = f"Its adapter holds bytes back for up to {timer} ms: samples come in bursts."
        yield Finding("warning", place, words, (now, f"permanently: {UDEV}"))
    elif timer.isdecimal():
        yield Finding("ok", place, f"Its adapter's latency timer is {timer} ms.")


def _in_use(place: str, programs: list[Program]) -> Finding:
    """The programs that have a port, and how to use it beside them."""
    words = f"It is open in {', '.join(map(str, programs))}."
    others = [one for one in programs if one.name != OWN]
    if not others:
        return Finding("ok", place, words)
    return Finding("problem", place, words, unblock_steps(place, others[0].name))


def _group(machine: Machine, number: int) -> str:
    for line in machine.text("/etc/group").splitlines():
        parts = line.split(":")
        if len(parts) > 2 and parts[2] == str(number):
            return parts[0]
    return str(number)


def programs(machine: Machine) -> Iterator[Finding]:
    """Programs that open ports of other programs."""
    running = set()
    for folder in process_folders(machine.root):
        try:
            running.add(file_text(folder, "comm").strip())
        except OSError:
            continue
    if "ModemManager" in running:
        ignored = any(
            "ID_MM_" in machine.text(f"/{place}/{RULES}") for place in ("etc/udev/rules.d", "lib/udev/rules.d")
        )
        words = "It is running, and probes each newly connected sensor as a modem."
        todo = (f"{UDEV} && {RELOAD}", "or, without a modem: sudo systemctl disable --now ModemManager")
        if ignored:
            yield Finding("ok", "ModemManager", "It is running, and configured to ignore sensors.")
        else:
            yield Finding("warning", "ModemManager", words, todo)
    else:
        yield Finding("ok", "ModemManager", "It is not running.")
    if "brltty" in running:
        todo = ("sudo systemctl disable --now brltty-udev brltty", "or: sudo apt remove brltty")
        yield Finding("warning", "brltty", "It is running, and mistakes some adapters for a braille display.", todo)


# ── disk ─────────────────────────────────────────────────────────────────────────────────────────────────────────────


def disk(machine: Machine) -> Iterator[Finding]:
    """The data folder, or where it will be."""
    data = machine.data
    place = next((one for one in (data, *data.parents) if one.is_dir()), data)
    if not os.access(place, os.W_OK | os.X_OK):
        words = f"{place} cannot be written by {machine.name}."
        other = "or give another folder: imuscope serve --data DIR"
        yield Finding("problem", "data folder", words, (f"sudo chown {machine.name} {place}", other))
        return
    kind = _file_system(machine, place)
    if kind in VOLATILE:
        words = f"{data} is on {kind}: recordings are gone after a restart."
        yield Finding("warning", "data folder", words, ("imuscope serve --data DIR, on a disk",))
    else:
        yield Finding("ok", "data folder", f"{data} can be written{f' ({kind})' if kind else ''}.")
    try:
        free, sync_s = machine.free(place), machine.sync(place)
    except OSError as error:
        yield Finding("problem", "disk", f"It cannot be written: {error.strerror}.", ("Free some space.",))
        return
    todo: tuple[str, ...]
    words = f"{free / 1e9:.1f} GB free."
    if free < SOME_FREE:
        status: Status = "problem" if free < LITTLE_FREE else "warning"
        todo = ("Delete recordings, or have the oldest deleted: recordings_quota_gb in the configuration file.",)
        yield Finding(status, "disk", f"Only {words}", todo)
    else:
        yield Finding("ok", "disk", words)
    words = f"A sync of 64 kB takes {sync_s * 1e3:.1f} ms."
    if sync_s > SLOW_SYNC_S:
        todo = ("A power cut would lose more of a recording; use a faster card or disk with --data.",)
        yield Finding("warning", "disk", words, todo)
    else:
        yield Finding("ok", "disk", words)


def _sync_time(folder: Path) -> float:
    """Median of several attempts, s."""
    import tempfile

    times = []
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".imuscope-doctor-") as file:
        for _ in range(MEASURED_SYNCS):
            began = time.monotonic()
            file.write(bytes(65_536))
            file.flush()
            os.fsync(file.fileno())
            times.append(time.monotonic() - began)
    return median(times)


def _file_system(machine: Machine, place: Path) -> str:
    best, kind = "", ""
    for line in machine.text("/proc/mounts").splitlines():
        parts = line.split()
        if len(parts) > 2 and len(parts[1]) >= len(best) and f"{place}/".startswith(parts[1].rstrip("/") + "/"):
            best, kind = parts[1], parts[2]
    return kind


# ── clock ────────────────────────────────────────────────────────────────────────────────────────────────────────────


def clock(machine: Machine, offset: float) -> Iterator[Finding]:
    """The wall clock.

    Args:
        offset: wall minus steady clock, some time ago, s.
    """
    now = machine.wall()
    if now < CLOCK_SET_S:
        todo = ("sudo timedatectl set-ntp true", "without a network: sudo date -s '2026-11-21 08:30:00'")
        yield Finding("problem", "clock", f"It says {time.strftime('%Y-%m-%d', time.gmtime(now))}: never set.", todo)
        return
    is_synchronised = machine.synchronised()
    if is_synchronised:
        yield Finding("ok", "clock", "It is synchronised.")
    elif is_synchronised is not None:
        words = "It is not synchronised: the times of recordings of several machines will differ."
        yield Finding("warning", "clock", words, ("sudo timedatectl set-ntp true", "or: sudo apt install chrony"))
    step = now - machine.steady() - offset
    if abs(step) > STEP_S:
        words = f"It stepped by {step:+.3f} s during the check."
        yield Finding("warning", "clock", words, ("Let one program set it (timedatectl status, chronyc tracking).",))
    source = machine.text("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source in SLOW_CLOCKS:
        there = machine.text("/sys/devices/system/clocksource/clocksource0/available_clocksource")
        words = f"The kernel reads it from {source}, which is slow; available: {there}."
        yield Finding("warning", "clock", words, ("Check `sudo dmesg | grep -i tsc` for the reason.",))


def kernel_clock() -> bool | None:
    """Whether the kernel reports a synchronised clock; uses adjtimex(2) without changing anything."""
    if sys.platform != "linux":
        return None
    about = (ctypes.c_byte * 512)()  # struct timex, modes 0: only read
    try:
        state = ctypes.CDLL(None).adjtimex(about)
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != 5  # TIME_ERROR


# ── machine ──────────────────────────────────────────────────────────────────────────────────────────────────────────


def memory(machine: Machine) -> Iterator[Finding]:
    """Warn when little memory is free."""
    match = re.search(r"^MemAvailable:\s+(\d+) kB", machine.text("/proc/meminfo"), re.MULTILINE)
    if match is None:
        return
    free = int(match[1]) * 1024
    words = f"{free / 1e9:.1f} GB of memory available."
    if free < LITTLE_MEMORY:
        todo = ("Reduce the sample history: memory_mb = 64 in the configuration file.",)
        yield Finding("warning", "memory", f"Only {words}", todo)
    else:
        yield Finding("ok", "memory", words)


def processor(machine: Machine) -> Iterator[Finding]:
    """Load of the processor, and whether its frequency is limited."""
    cores = os.cpu_count() or 1
    load = machine.text("/proc/loadavg").split()
    if load and float(load[0]) > cores:
        words = f"Load {load[0]} on {cores} cores: samples may be delayed."
        yield Finding("warning", "processor", words, ("Find the cause with `top`.",))
    elif load:
        yield Finding("ok", "processor", f"Load {load[0]} on {cores} cores.")
    folder = machine.path("/sys/devices/system/cpu")
    governors = {
        machine.text(str(Path("/sys/devices/system/cpu", one.parent.parent.name, "cpufreq/scaling_governor")))
        for one in folder.glob("cpu[0-9]*/cpufreq/scaling_governor")
    }
    driver = machine.text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_driver")
    if "powersave" in governors and not re.match(r"intel_pstate|amd[-_]pstate", driver):
        todo = ("echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",)
        yield Finding("warning", "processor", "Its governor, powersave, keeps it at its lowest frequency.", todo)


def program(machine: Machine) -> Iterator[Finding]:
    """Imuscope itself."""
    from imuscope.protocols.native.kernels import is_complete
    from imuscope.protocols.registry import families as registry

    if is_complete():
        yield Finding("ok", "machine code", f"The decoders of {len(registry.PROTOCOLS)} protocols run as machine code.")
    else:
        words = (
            "The decoders run as plain Python, about 100 times slower: none was built for this source and processor."
        )
        yield Finding(
            "warning", "machine code", words, ("python -m imuscope.protocols.native.compiler, or install it again.",)
        )
    page = Path(__file__).parents[1] / "page" / "index.html"
    if not page.is_file():
        yield Finding("problem", "page", "It is not built.", ("python web/build.py, or install imuscope from a wheel",))
    if machine.port and (who := _listener(machine)):
        todo = ("Give another with --port, or stop it.",) if who != "imuscope" else ()
        yield Finding("ok" if who == "imuscope" else "warning", f"port {machine.port}", f"{who} listens there.", todo)


def packages(path: str | None = None) -> Iterator[Finding]:
    """Packages that PYTHONPATH puts before those of imuscope."""
    for name in ("numpy", "pyarrow", "serial"):
        spec = find_spec(name)
        file = spec.origin if spec is not None else None
        if place := _on_python_path(file or "", path):
            words = f"It comes from {place}, which PYTHONPATH names, and not from imuscope's own installation."
            yield Finding("warning", name, words, ("Start imuscope without it: env -u PYTHONPATH imuscope …",))


def foreign_import(error: ImportError, path: str | None = None) -> str:
    """Why a package that PYTHONPATH names cannot be imported: cause and remedy; "" if it was another one."""
    at, place, file = error.__traceback__, "", ""
    while at is not None:
        if folder := _on_python_path(at.tb_frame.f_code.co_filename, path):
            place, file = folder, at.tb_frame.f_code.co_filename
        at = at.tb_next
    if not place:
        return ""
    name = Path(file).relative_to(place).parts[0].removesuffix(".py")
    return f"{name} of {place}, which PYTHONPATH names, cannot be used: {error}. Start without it: env -u PYTHONPATH …"


def _on_python_path(file: str, path: str | None) -> str:
    """The folder of PYTHONPATH that has a file; "" for none."""
    folders = (os.environ.get("PYTHONPATH", "") if path is None else path).split(os.pathsep)
    own = str(Path(__file__).absolute().parents[2])
    return next((one for one in folders if one and one != own and file.startswith(f"{one.rstrip('/')}/")), "")


def _listener(machine: Machine) -> str:
    """Program that listens on the server's port; "" for none."""
    inodes = set()
    for name in ("tcp", "tcp6"):
        for line in machine.text(f"/proc/net/{name}").splitlines()[1:]:
            parts = line.split()
            if len(parts) > 9 and parts[3] == "0A" and int(parts[1].rpartition(":")[2], 16) == machine.port:
                inodes.add(f"socket:[{parts[9]}]")
    if not inodes:
        return ""
    for folder in process_folders(machine.root):
        try:
            if any(os.readlink(link) in inodes for link in descriptors(folder)):
                return program_of(folder).name
        except OSError:
            continue
    return "Another program"


def _name_of(uid: int) -> str:
    import pwd

    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)
