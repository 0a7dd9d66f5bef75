"""Named constants of C headers, by compiling them.

    enumerations   `gcc -E` shows their members; a program that is compiled on the spot prints the value of each
    macros         `gcc -dM` names them; the same program prints those whose names match a pattern

The headers are read where they lie and nothing of them is kept but names and numbers.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

Constants = dict[str, dict[str, int]]
"""Enumeration → constant → value."""

_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_ENUM = re.compile(
    r"(typedef\s+)?enum\s*(?:class\s+)?(\w*)\s*(?::\s*[\w\s]+)?\{(.*?)\}\s*(\w*)",
    re.DOTALL,
)
_MEMBER = re.compile(r"^\s*(\w+)", re.MULTILINE)


def constants(
    headers: Sequence[str], folders: Sequence[Path], *, macros: str = "", language: str = "c++", extra: str = ""
) -> Constants:
    """Every enumeration of `headers`, and the macros whose names match `macros`, under the key "macros".

    Args:
        headers: as they are included.
        folders: where includes are searched for.
        extra: lines before the first include.

    Raises:
        subprocess.CalledProcessError: the headers do not compile; the compiler's words are on standard error.
    """
    compiler = ["gcc", "-x", language, "-w", *(f"-I{folder}" for folder in folders)]
    source = extra + "".join(f'#include "{header}"\n' for header in headers)
    text = _run([*compiler, "-E", "-"], source)
    own = _own_lines(text, headers)
    results = dict(_enumerations(own))
    if macros:
        defined = re.findall(r"^#define (\w+) .", _run([*compiler, "-E", "-dM", "-"], source), re.MULTILINE)
        results["macros"] = [name for name in defined if re.match(macros, name)]
    names = sorted({name for members in results.values() for name in members})
    body = "".join(f'std::printf("{name} %lld\\n", (long long)({name}));\n' for name in names)
    program = f"#include <cstdio>\n{source}int main() {{\n{body}}}\n"
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "constants"
        _run([*compiler, "-", "-o", str(target)], program)
        details = dict(line.split() for line in _run([str(target)], "").splitlines())
    return {enum: {name: int(details[name]) for name in members} for enum, members in results.items()}


def expressions(request: Mapping[str, str], headers: Sequence[str], folders: Sequence[Path]) -> dict[str, int]:
    """Values of integer expressions of C++, by a key of one's own: sizes and places of fields."""
    source = "#include <cstdio>\n" + "".join(f'#include "{header}"\n' for header in headers)
    body = "".join(f'std::printf("{key} %lld\\n", (long long)({text}));\n' for key, text in request.items())
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "expressions"
        compiler = ["gcc", "-x", "c++", "-w", *(f"-I{one}" for one in folders), "-", "-o", str(target)]
        _run(compiler, f"{source}int main() {{\n{body}}}\n")
        return {key: int(value) for key, value in (line.split() for line in _run([str(target)], "").splitlines())}


def _run(command: Sequence[str], source: str) -> str:
    done = subprocess.run(command, input=source, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[:2000])
    return done.stdout


def _own_lines(text: str, headers: Sequence[str]) -> str:
    """Preprocessed text of these headers, without their includes."""
    names = {Path(header).name for header in headers}
    stored, own = [], False
    for line in text.splitlines():
        mark = re.match(r'# \d+ "([^"]+)"', line)
        if mark:
            own = Path(mark.group(1)).name in names
        elif own:
            stored.append(line)
    return _COMMENT.sub("", "\n".join(stored))


def _enumerations(text: str) -> list[tuple[str, list[str]]]:
    results = []
    for number, match in enumerate(_ENUM.finditer(text)):
        _, tag, body, alias = match.groups()
        members = [entry.group(1) for part in _parts(body) if (entry := _MEMBER.match(part))]
        results.append((tag or alias or f"anonymous_{number}", members))
    return results


def _parts(body: str) -> list[str]:
    """Members: what commas outside of brackets part."""
    parts, depth, start = [], 0, 0
    for at, sign in enumerate(body):
        depth += (sign == "(") - (sign == ")")
        if sign == "," and not depth:
            parts.append(body[start:at])
            start = at + 1
    return [*parts, body[start:]]
