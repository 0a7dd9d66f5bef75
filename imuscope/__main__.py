"""`imuscope`, and `python -m imuscope`: the version at once, all else by the command line."""

import sys


def main() -> int:
    """Run the command; returns the exit status."""
    if sys.argv[1:] in (["--version"], ["-V"]):  # the command line takes half a second to import
        from imuscope.server.version import described

        print(described())
        return 0
    from imuscope.server import cli

    return cli.main()


if __name__ == "__main__":
    raise SystemExit(main())
