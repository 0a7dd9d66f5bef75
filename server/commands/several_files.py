"""Commands that take one file or several: one run for each, in the order given, with the same options and output.

imuscope decode a.bin b.bin -o {name}.csv          a.csv and b.csv
imuscope analyse a.bin b.bin statistics --json     a line of JSON for each
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from imuscope.server.errors import UsageError
from imuscope.server.text.printable import printable

NAME = "{name}"  # in OUT: the name of the file without its suffix


def run_each(run: Callable[[argparse.Namespace], int | None], options: argparse.Namespace) -> int:
    """Run a command for each of its files until one fails; returns the exit status.

    Raises:
        UsageError: several files would be written to one.
    """
    files: Sequence[str | Path] = getattr(options, "files", ())
    if not files:
        return run(options) or 0
    outputs = _outputs(files, getattr(options, "output", None))
    for file, output in zip(files, outputs, strict=True):
        options.file, options.output = file, output
        if len(files) > 1 and options.has_titles and options.format in ("table", "text", None) and output is None:
            print(printable(f"{file}:"), flush=True)
        if status := run(options) or 0:
            return status
    return 0


def _outputs(files: Sequence[str | Path], output: Path | None) -> list[Path | None]:
    if output is None:
        return [None] * len(files)
    names = ["stdin" if str(file) == "-" else Path(file).stem for file in files]
    outputs = [Path(str(output).replace(NAME, name)) for name in names]
    same, count = Counter(outputs).most_common(1)[0]
    if count > 1:
        hint = "two of the files have one name" if NAME in str(output) else f"write {NAME} in OUT: -o {NAME}.csv"
        raise UsageError(f"{count} files would be written to {same}; {hint}")
    return [*outputs]
