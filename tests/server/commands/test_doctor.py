"""`imuscope doctor`: simulated machines with one problem each."""

import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from imuscope.server.commands import doctor
from imuscope.server.diagnostics import checks
from imuscope.server.diagnostics.checks import Finding, Machine, run_checks
from tests.support.each_row import each_row
from tests.support.server_process import ROOT, imuscope
from tests.support.timeouts import PATIENCE_S

NOW = 1_760_000_000.0


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """A machine without problems: an FTDI adapter that its user may open."""
    root = tmp_path / "root"
    port(root, "ttyUSB0", latency="1")
    put(root, "proc/meminfo", "MemTotal: 4000000 kB\nMemAvailable: 3000000 kB\n")
    put(root, "proc/loadavg", "0.10 0.20 0.30 1/200 4242\n")
    put(root, "proc/mounts", f"/dev/sda1 / ext4 rw 0 0\ntmpfs {tmp_path}/volatile tmpfs rw 0 0\n")
    put(root, "proc/1/comm", "systemd\n")
    put(root, "etc/group", f"root:x:0:\ndialout:x:{os.getgid()}:\n")
    put(root, "sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n")
    put(root, "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "schedutil\n")
    data = tmp_path / "data"
    data.mkdir()
    return Machine(
        data,
        root=root,
        uid=4242,
        groups=frozenset({os.getgid()}),
        name="pi",
        synchronised=lambda: True,
        wall=lambda: NOW,
        steady=lambda: 100.0,
        free=lambda folder: 10**12,
        sync=lambda folder: 1e-3,
    )


def put(root: Path, path: str, text: str = "") -> Path:
    file = root / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def port(root: Path, name: str, mode: int = 0o060, latency: str = "") -> None:
    (root / "sys/class/tty" / name).mkdir(parents=True)
    put(root, f"dev/{name}").chmod(mode)
    if latency:
        put(root, f"sys/bus/usb-serial/devices/{name}/latency_timer", latency + "\n")


def process(root: Path, number: int, name: str, *opened: str, command: str = "") -> None:
    put(root, f"proc/{number}/comm", name + "\n")
    put(root, f"proc/{number}/cmdline", (command or name).replace(" ", "\0"))
    for place, target in enumerate(opened):
        link = root / f"proc/{number}/fd/{place}"
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(target)


def wrong(machine: Machine) -> list[Finding]:
    return [one for one in run_checks(machine) if one.status != "ok"]


def only(machine: Machine, status: str, about: str) -> Finding:
    """The finding, if there is exactly one."""
    (one,) = wrong(machine)
    assert (one.status, one.about) == (status, about), one
    assert one.message.endswith(".")
    assert one.todo, "what is wrong comes with what to do"
    return one


def test_a_healthy_machine_has_no_findings(machine: Machine) -> None:
    assert wrong(machine) == []
    subjects = {one.about for one in run_checks(machine)}
    assert subjects >= {"/dev/ttyUSB0", "ModemManager", "data folder", "disk", "clock", "memory", "processor"}
    assert list(machine.data.iterdir()) == [], "a look leaves nothing behind"


def test_without_ports(machine: Machine) -> None:
    shutil.rmtree(machine.root / "dev")
    assert "dmesg" in only(machine, "warning", "serial ports").todo[0]
    put(machine.root, ".dockerenv")
    assert "--device" in only(machine, "warning", "serial ports").todo[0]


def test_a_port_of_a_group_named(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    """The result does not depend on the user: the port's permissions are taken from its stat."""
    put(machine.root, "etc/group", "dialout:x:20:\nuucp:x:14:\n")
    of_group(monkeypatch, machine.root / "dev/ttyUSB0", 20)
    one = only(machine, "problem", "/dev/ttyUSB0")
    assert one.todo == ("sudo usermod -aG dialout pi", "log out and in again (a service: restart it)")
    assert "dialout" in one.message
    assert wrong(replace(machine, groups=frozenset({20}))) == []
    assert wrong(replace(machine, uid=0)) == []


def of_group(monkeypatch: pytest.MonkeyPatch, place: Path, group: int) -> None:
    stat: Callable[..., os.stat_result] = Path.stat

    def report(self: Path, **how: bool) -> object:
        result = stat(self, **how)
        if self != place:
            return result
        return SimpleNamespace(st_mode=result.st_mode, st_uid=0, st_gid=group)

    monkeypatch.setattr(Path, "stat", report)


def test_a_port_that_only_root_may_open(machine: Machine) -> None:
    (machine.root / "dev/ttyUSB0").chmod(0o600)
    one = only(machine, "problem", "/dev/ttyUSB0")
    assert any("70-imuscope.rules" in step for step in one.todo)


def test_a_port_that_another_program_holds(machine: Machine) -> None:
    process(machine.root, 77, "minicom", "/dev/null", "/dev/ttyUSB0")
    one = only(machine, "problem", "/dev/ttyUSB0")
    assert "minicom (process 77)" in one.message
    assert any("imuscope serve /dev/ttyUSB0 --share /run/imuscope/imu0" in step for step in one.todo)
    assert "minicom" in one.todo[0]


@pytest.mark.parametrize(
    ("name", "setting"), [("xsens_mti_node", "scan_for_devices"), ("inertial_sense_", "parameter")]
)
def test_a_port_that_a_known_driver_holds(machine: Machine, name: str, setting: str) -> None:
    """The kernel keeps 15 characters of a name."""
    process(machine.root, 78, name, "/dev/ttyUSB0", command=f"/opt/ros/lib/{name}")
    one = only(machine, "problem", "/dev/ttyUSB0")
    assert setting in one.todo[-1]


def test_a_port_that_imuscope_itself_holds(machine: Machine) -> None:
    process(machine.root, 77, "python3", "/dev/ttyUSB0", command="python3 /opt/imuscope/bin/imuscope serve")
    assert wrong(machine) == []


def test_a_latency_timer_as_delivered(machine: Machine) -> None:
    put(machine.root, "sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n")
    one = only(machine, "warning", "/dev/ttyUSB0")
    assert "16 ms" in one.message
    assert one.todo[0] == "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"


def test_programs_that_open_every_port(machine: Machine) -> None:
    process(machine.root, 5, "ModemManager")
    assert "systemctl disable --now ModemManager" in only(machine, "warning", "ModemManager").todo[1]
    put(machine.root, f"etc/udev/rules.d/{checks.RULES}", doctor.udev_rule())
    assert wrong(machine) == []
    process(machine.root, 6, "brltty")
    only(machine, "warning", "brltty")


def test_a_data_folder_that_is_gone_after_a_restart(machine: Machine, tmp_path: Path) -> None:
    volatile = tmp_path / "volatile"
    volatile.mkdir()
    assert "tmpfs" in only(replace(machine, data=volatile / "not yet there"), "warning", "data folder").message


@pytest.mark.skipif(os.getuid() == 0, reason="root may write everywhere")
def test_a_data_folder_that_cannot_be_written(machine: Machine) -> None:
    machine.data.chmod(0o500)
    assert "sudo chown pi" in only(machine, "problem", "data folder").todo[0]


@each_row(("free", "status"), [(3_000_000_000, "warning"), (200_000_000, "problem")])
def test_a_disk_that_is_nearly_full(machine: Machine, free: int, status: str) -> None:
    full = replace(machine, free=lambda folder: free)
    assert "recordings_quota_gb" in only(full, status, "disk").todo[0]


def test_a_slow_disk(machine: Machine) -> None:
    assert "1500.0 ms" in only(replace(machine, sync=lambda folder: 1.5), "warning", "disk").message


def test_the_real_disk_is_measured_and_nothing_left_there(machine: Machine) -> None:
    here = Machine(machine.data, root=machine.root)
    assert 0.0 < here.sync(machine.data) < 60.0
    assert here.free(machine.data) > 0
    assert list(machine.data.iterdir()) == []


def test_an_unsynchronised_clock(machine: Machine) -> None:
    assert "timedatectl" in only(replace(machine, synchronised=lambda: False), "warning", "clock").todo[0]
    assert wrong(replace(machine, synchronised=lambda: None)) == []
    assert checks.kernel_clock() in (True, False, None)


def test_a_clock_that_was_never_set(machine: Machine) -> None:
    assert "1970-01-02" in only(replace(machine, wall=lambda: 100_000.0), "problem", "clock").message


def test_a_clock_that_steps(machine: Machine) -> None:
    walls = iter([NOW, NOW + 2.5])
    assert "+2.500 s" in only(replace(machine, wall=lambda: next(walls)), "warning", "clock").message


def test_an_overloaded_machine(machine: Machine) -> None:
    put(machine.root, "proc/meminfo", "MemAvailable: 300000 kB\n")
    only(machine, "warning", "memory")
    put(machine.root, "proc/meminfo", "MemAvailable: 3000000 kB\n")
    put(machine.root, "proc/loadavg", "900.0 1 1 1/2 3\n")
    only(machine, "warning", "processor")
    put(machine.root, "proc/loadavg", "0.0 0 0 1/2 3\n")
    put(machine.root, "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n")
    assert "performance" in only(machine, "warning", "processor").todo[0]
    put(machine.root, "sys/devices/system/cpu/cpu0/cpufreq/scaling_driver", "intel_pstate\n")
    assert wrong(machine) == [], "there it is not slow"
    put(machine.root, "sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n")
    only(machine, "warning", "clock")


def test_a_port_of_the_network_that_is_taken(machine: Machine) -> None:
    row = "  0: 0100007F:1F90 00000000:0000 0A 00000000:00000000 00:00000000 00000000 1000 0 31337 1\n"
    put(machine.root, "proc/net/tcp", f"sl local rem st\n{row}")
    process(machine.root, 9, "nginx", "socket:[31337]")
    expected = replace(machine, port=8080)
    assert "nginx listens" in only(expected, "warning", "port 8080").message
    assert wrong(replace(machine, port=8081)) == []


def test_a_numpy_on_the_python_path_is_named(tmp_path: Path) -> None:
    """A robot's environment had one for another Python: the start ended with a traceback."""
    (tmp_path / "numpy").mkdir()
    (tmp_path / "numpy" / "__init__.py").write_text('raise ImportError("numpy.core.multiarray failed to import")')
    for command in ("doctor", "serve"):
        words, environment = [sys.executable, "-m", "imuscope", command], os.environ | {"PYTHONPATH": str(tmp_path)}
        message = subprocess.run(words, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
        assert message.returncode == 1
        assert f"numpy of {tmp_path}, which PYTHONPATH names, cannot be used: numpy.core.multi" in message.stderr
        assert "Traceback" not in message.stderr
    own = str(Path(checks.find_spec("numpy").origin).parents[1])  # type: ignore[union-attr, arg-type]
    names = [one.about for one in checks.packages(own)]
    assert names == ["numpy", "pyarrow", "serial"]
    assert not list(checks.packages("/opt/ros/jazzy/lib/python3.12/site-packages"))


def test_what_is_printed_and_the_exit_status() -> None:
    findings = [
        Finding("ok", "disk", "23.1 GB free."),
        Finding("problem", "/dev/ttyUSB0", "It is open in minicom (process 7).", ("Close it.", "Now.")),
    ]
    out = io.StringIO()
    assert doctor.format_findings(findings, out) == 1
    lines = out.getvalue().splitlines()
    assert " ".join(lines[0].split()) == "problem /dev/ttyUSB0 It is open in minicom (process 7)."
    assert [line.strip() for line in lines[1:3]] == ["→ Close it.", "→ Now."]
    assert lines[3].startswith("ok ")
    assert doctor.format_findings(findings[:1], io.StringIO()) == 0
    out = io.StringIO()
    assert doctor.format_findings(findings, out, as_json=True) == 1
    assert [one["status"] for one in json.loads(out.getvalue())] == ["problem", "ok"]


def test_on_this_machine(tmp_path: Path) -> None:
    done = imuscope("doctor", "--json", "--data", str(tmp_path))
    document = json.loads(done.stdout)
    assert done.returncode == int(any(one["status"] == "problem" for one in document)), done.stderr
    assert all(set(one) == {"status", "about", "found", "todo"} for one in document)


def test_the_files_for_the_machine() -> None:
    """That systemd takes the unit is checked where there is one; what the server relies on stands in it."""
    unit = doctor.systemd_unit()
    for line in ("KillSignal=SIGTERM", "DynamicUser=yes", "SupplementaryGroups=dialout", "ProtectSystem=strict"):
        assert line in unit.splitlines()
    for limit in ("Nice", "CPUWeight", "MemoryHigh", "MemoryMax", "OOMPolicy", "LimitNOFILE", "TimeoutStopSec"):
        assert any(line.startswith(f"{limit}=") for line in unit.splitlines()), limit
    rule = doctor.udev_rule()
    for maker in ("2639", "0403", "0483"):
        assert f'idVendor}}=="{maker}"' in rule
    assert 'ATTR{latency_timer}="1"' in rule


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / "imuscope.service"
    unit.write_text(doctor.systemd_unit().replace("/opt/imuscope/bin/imuscope", "/bin/true"))
    _assert_systemd_takes(unit)


def guide_blocks(start: str) -> list[str]:
    """Blocks of the guide's page about robots that begin so."""
    page = (ROOT / "docs" / "guide" / "deployment.md").read_text(encoding="utf-8")
    return [
        block for block in re.findall(r"^```\w*\n(.*?)^```", page, re.DOTALL | re.MULTILINE) if block.startswith(start)
    ]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_takes_the_changes_of_the_guide(tmp_path: Path) -> None:
    """What the guide puts into `systemctl edit imuscope`, all at once."""
    unit = tmp_path / "imuscope.service"
    unit.write_text(doctor.systemd_unit().replace("/opt/imuscope/bin/imuscope", "/bin/true"))
    blocks = guide_blocks("[Unit]") + guide_blocks("[Service]")
    assert len(blocks) >= 2
    (tmp_path / "imuscope.service.d").mkdir()
    for number, block in enumerate(blocks):
        text = block.replace("/opt/imuscope/bin/imuscope", "/bin/true")
        (tmp_path / "imuscope.service.d" / f"{number}.conf").write_text(text)
    _assert_systemd_takes(unit)


def _assert_systemd_takes(unit: Path) -> None:
    command = ["systemd-analyze", "verify", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    about_it = [line for line in done.stderr.splitlines() if "imuscope" in line]
    assert about_it == []


def test_doctor_and_ports_list_the_same_ports(machine: Machine) -> None:
    """ttyS0 of a PC, and none of the places that its kernel keeps for more."""
    shutil.rmtree(machine.root / "sys/class/tty/ttyUSB0")
    for number, uart in ((0, "4"), (1, "0")):
        port(machine.root, f"ttyS{number}")
        put(machine.root, f"sys/class/tty/ttyS{number}/type", uart + "\n")
    places = {one.about for one in run_checks(machine) if "ttyS" in one.about}
    assert places == {"/dev/ttyS0"}
    assert not [one for one in run_checks(machine) if one.about == "serial ports"]
