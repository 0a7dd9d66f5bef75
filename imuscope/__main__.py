"""`python -m imuscope`: the command `imuscope`."""

from imuscope.server.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
