"""Programs that have a file open, from /proc: those of other users are visible to root only."""

import os
import re
from collections.abc import Callable

from imuscope.server.system.light_modules import NamedTuple

OWN = "imuscope"
ROOT = "/"
MOST_COMM = 15  # characters of a program's name that the kernel keeps
SHARED_PATH = "/run/imuscope/imu0"  # an example
MODULE = re.compile(r" -m imuscope(\.server\.(cli|[\w.]+\.holder))?( |$)")


class Program(NamedTuple):
    """A running program; `name` is "imuscope" for each part of it."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})"


def file_text(folder: str | os.PathLike[str], name: str) -> str:
    """The text of a file of a folder. OSError: it cannot be read."""
    with open(os.path.join(folder, name), errors="replace") as file:
        return file.read()


def descriptors(folder: os.DirEntry[str]) -> list[os.DirEntry[str]]:
    """Links to the files that a process has open. OSError: it has ended, or is another user's."""
    with os.scandir(f"{folder.path}/fd") as links:
        return list(links)


def program_of(folder: str | os.PathLike[str]) -> Program:
    """The program of a folder of /proc."""
    try:
        line = file_text(folder, "cmdline").replace("\0", " ")
        name = file_text(folder, "comm").strip()
    except OSError:
        line, name = "", "another program"
    words = line.split()
    started = {os.path.basename(word).rstrip(":") for word in words[:2]}  # others may run from a folder of that name
    is_own = OWN in started or MODULE.search(line) is not None
    return Program(int(os.path.basename(folder)), OWN if is_own else name)


def process_folders(root: str | os.PathLike[str] = ROOT) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(os.path.join(root, "proc")) as entries:
            return [one for one in entries if one.name.isdecimal()]
    except OSError:
        return []


def open_files(is_wanted: Callable[[str], bool], root: str | os.PathLike[str] = ROOT) -> dict[str, list[Program]]:
    """Programs by the wanted file that they have open, in the order of their processes."""
    programs: dict[str, list[Program]] = {}
    for folder in sorted(process_folders(root), key=lambda one: int(one.name)):
        try:
            links = descriptors(folder)
        except OSError:
            continue
        places = set()
        for link in links:
            try:
                places.add(os.readlink(link))
            except OSError:
                continue
        for place in filter(is_wanted, places):
            programs.setdefault(place, []).append(program_of(folder))
    return programs


def readers_of(path: str) -> list[Program]:
    """Other programs that read a serial port or a terminal: what one of them reads, the others do not get.

    Left out are what only writes to it, the device's side of a pseudo-terminal, and imuscope, which locks its ports.
    """
    place = os.path.realpath(path)
    if not os.path.exists(place):
        return []
    parent, _, name = place.rpartition("/")
    index = name if parent == "/dev/pts" else ""
    readers = []
    for folder in process_folders():
        reads = is_device = False
        try:
            for link in descriptors(folder):
                target = os.readlink(link)
                if target == place:
                    flags = descriptor_field(folder, link.name, "flags")
                    reads = reads or int(flags or "0", 8) & os.O_ACCMODE != os.O_WRONLY
                elif index and target.endswith("/ptmx"):
                    is_device = is_device or descriptor_field(folder, link.name, "tty-index") == index
        except OSError:
            continue  # it has ended, or is another user's
        if reads and not is_device and int(folder.name) != os.getpid():
            program = program_of(folder)
            readers += [program] if program.name != OWN else []
    return readers


def descriptor_field(folder: os.PathLike[str], fd: str, name: str) -> str:
    """A field of a descriptor, see proc_piddescriptor_field(5); "" if it has none."""
    lines = file_text(folder, f"fdinfo/{fd}").splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(name)), "")


def session_on(path: str) -> Program | None:
    """The program whose session a terminal controls, a login prompt or a shell; None if there is none.

    Source: proc_pid_stat(5), fields 6 and 7.
    """
    try:
        terminal = os.stat(path).st_rdev
    except OSError:
        return None
    for folder in process_folders():
        try:
            fields = file_text(folder, "stat").rpartition(")")[2].split()
        except OSError:
            continue
        session, number = int(fields[3]), int(fields[4]) & 0xFFFFFFFF
        if number and os.makedev(number >> 8 & 0xFFF, number >> 12 & 0xFFF00 | number & 0xFF) == terminal:
            leader = f"/proc/{session}"
            return program_of(leader if os.path.exists(leader) else folder)
    return None


def unblock_steps(place: str, name: str) -> tuple[str, ...]:
    """Instructions for viewing a port that another program holds open: the program keeps it, through a share.

    Args:
        name: of the program.
    """
    from imuscope.protocols.registry.families import PROTOCOLS  # imported on first use, because it loads compiled code

    path = SHARED_PATH
    known = [(head, words) for one in PROTOCOLS.values() for head, words in one.device.host_drivers.items()]
    setting = next((words for head, words in known if name.startswith(head[:MOST_COMM])), "its setting of the port")
    return (
        f"Stop {name}.",
        f"Share the port: `imuscope serve {place} --share {path}`, or Share port on the page.",
        f"Start {name} with {path} in place of {place} ({setting}): both work then.",
    )


def programs_with(path: str, root: str | os.PathLike[str] = ROOT) -> list[Program]:
    """The programs that have a file open."""
    place = os.path.realpath(path)
    return open_files(lambda one: one == place, root).get(place, [])
