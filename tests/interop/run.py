"""Third-party programs against imuscope's simulators, files and streams, one command each.

    python -m tests.interop.run mtdevice          ethzasl's mtdevice.py (Python)
    python -m tests.interop.run xda               Xsens' own library, by xda_host, which must be on PATH: xda_host.cpp,
                                                  compiled against xspublic of its ROS driver
    python -m tests.interop.run cltool            Inertial Sense SDK's CLTool 2.7.1, compiled with REMOTE_SOCAT_PORTS,
                                                  which must be on PATH; as root, for a port in /dev/remote
    python -m tests.interop.run xsens-go          the `xsens` command of einride/xsens-go, which must be on PATH
    python -m tests.interop.run cltool-tcp-shared         CLTool 2.7.1 as it is, at a share of TCP: it takes no path
    python -m tests.interop.run mtdevice-shared, xda-shared, cltool-shared, xsens-go-shared
                                                  the same programs on a port that a server holds and shares (--share),
                                                  records and configures meanwhile
    python -m tests.interop.run mtdevice-undisturbed, xda-undisturbed
                                                  the same on a shared port beside which recordings start and stop,
                                                  pages open and the server is killed: nobody else talks to the device
    python -m tests.interop.run mcap              pymcap-cli 0.34.0 (pip), on recordings and exports of ours
    python -m tests.interop.run rerun             the rerun command that is installed with imuscope, on an .rrd export
    python -m tests.interop.run pygnssutils       pygnssutils 1.3.1 (pip) as the NTRIP caster of a device
    python -m tests.interop.run hiroz             hiroz 0.2.1 (crates.io), a ROS 2 over Zenoh, by hiroz_host, which must
                                                  be on PATH: cargo build --release in tests/interop/hiroz_host
    python -m tests.interop.run hiroz-source      the same as a publisher, whose messages imuscope shows
    python -m tests.interop.run                   all of them

Each starts what of ours it is for, runs the program unchanged, and compares what it printed with what must come out.
Exit status 1 when one differs. mtdevice.py and what pip has are fetched into --folder, in a fixed version, if they do
not lie there already. The others are for whoever has them: one that is not there is told, with where it comes from, and
fails too. How it is built is in its own README (CLTool needs libudev-dev and libusb-1.0-0-dev). None of this is part of
the tests that everybody runs, and nothing of theirs is part of the project.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from tests.interop import files, hosts, ros2, ros2_source, shared_port, undisturbed
from tests.interop.running import ROOT, DiffersError

PROGRAMS: Mapping[str, Callable[[Path, Path], str]] = {
    "mtdevice": hosts.mtdevice,
    "xda": hosts.xda,
    "cltool": hosts.cltool,
    "xsens-go": hosts.xsens_go,
    "mtdevice-shared": shared_port.mtdevice_shared,
    "xda-shared": shared_port.xda_shared,
    "cltool-shared": shared_port.cltool_shared,
    "cltool-tcp-shared": shared_port.cltool_tcp_shared,
    "xsens-go-shared": shared_port.xsens_go_shared,
    "mtdevice-undisturbed": undisturbed.mtdevice_undisturbed,
    "xda-undisturbed": undisturbed.xda_undisturbed,
    "hiroz": ros2.hiroz,
    "hiroz-source": ros2_source.hiroz_source,
    "mcap": files.mcap,
    "rerun": files.rerun,
    "pygnssutils": files.pygnssutils,
}


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description="Run other people's programs against imuscope's simulators, files and streams."
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(PROGRAMS)} (all when left out)")
    parser.add_argument("--folder", type=Path, default=ROOT / "artifacts" / "interop", help="where they are fetched")
    options = parser.parse_args()
    if unknown := set(options.names) - set(PROGRAMS):
        parser.error(f"{', '.join(sorted(unknown))}: not one of {', '.join(PROGRAMS)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    failed = 0
    for name in options.names or PROGRAMS:
        with tempfile.TemporaryDirectory(prefix="imuscope-interop-") as scratch:
            try:
                print(f"ok     {name}: {PROGRAMS[name](options.folder.resolve(), Path(scratch))}", flush=True)
            except DiffersError as error:
                failed += 1
                print(f"FAILED {name}: {error}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
