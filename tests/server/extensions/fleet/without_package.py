"""`imuscope` where a package is not installed.

python -m tests.server.extensions.fleet.without_package PACKAGE upload FILE …
"""

import sys


def main() -> int:
    """Run the command as if nothing that needs the package had been imported; returns its exit status."""
    package, *words = sys.argv[1:]
    for name in list(sys.modules):
        if name.endswith("settings"):
            continue  # the configuration has their classes
        if name.partition(".")[0] == package or name.startswith(
            ("imuscope.server.extensions.fleet", "imuscope.server.commands", "imuscope.server.cli")
        ):
            del sys.modules[name]
    sys.modules[package] = None  # type: ignore[assignment]
    from imuscope.server.cli import main as imuscope

    return imuscope(words)


if __name__ == "__main__":
    sys.exit(main())
