"""Names of programs, from their command lines."""

from pathlib import Path

from imuscope.server.system.open_files import program_of
from tests.support.each_row import each_row


@each_row(
    ("line", "name"),
    [
        (b"/opt/imuscope/.venv/bin/python\0-c\0read()", "python"),  # a driver that runs from a folder of that name
        (b"minicom\0-D\0/run/imuscope", "python"),
        (b"/a/.venv/bin/python\0/a/.venv/bin/imuscope\0serve", "imuscope"),
        (b"imuscope serve /dev/ttyUSB0", "imuscope"),  # as its title has it
        (b"python\0-m\0imuscope.server.extensions.shares.holder\0/dev/ttyUSB0", "imuscope"),
        (b"python\0-m\0imuscope\0serve", "imuscope"),
        (b"python\0-m\0imuscope_of_others", "python"),
    ],
)
def test_a_program_is_ours_by_what_was_started(tmp_path: Path, line: bytes, name: str) -> None:
    folder = tmp_path / "12"
    folder.mkdir()
    (folder / "cmdline").write_bytes(line)
    (folder / "comm").write_text("python\n")
    assert str(program_of(folder)) == f"{name} (process 12)"
