"""`python -m server.generate_ts_types`: the types of the wire and the forms for TypeScript.

    server/wire.py   ─> web/src/wire/types.ts    what the WebSocket carries
    server/configuration/api_models.py  ─> web/src/forms/types.ts   what the HTTP API of the Configure page carries
    server/library/api_models.py ─> web/src/recordings/types.ts   and that of the Recordings page

These are the only places where a field is added. This file reads their *source*, so that what a reader sees there
(the order, the docstrings, the comment behind a field) is what stands in the TypeScript, and turns

    X = Literal["a", "b"]              into   export type X = "a" | "b";
    X = A | B                          into   export type X = A | B;
    @dataclass class X: a: int | None  into   export interface X { readonly a: number | null }
    @dataclass class X(Y): a: int      into   export interface X extends Y { readonly a: number }

The binary header becomes constants: the offset of each field, the size of each dtype. Anything that this small table of
types does not know is an error here rather than a guess there.

    python -m server.generate_ts_types            write the files
    python -m server.generate_ts_types --check    exit status 1 when one is stale
"""

from __future__ import annotations

import ast
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from server import wire
from server.configuration import api_models as forms
from server.library import api_models as recorded

_PAGE = Path(__file__).resolve().parent.parent / "web" / "src"
SCALARS = {"str": "string", "int": "number", "float": "number", "bool": "boolean", "None": "null", "Any": "unknown"}


@dataclass(frozen=True, slots=True)
class Target:
    """One file of types.

    Args:
        module: the source.
        path: what is written.
        about: what the types are of.
        roots: names that are wanted with all that they are made of; (): every dataclass.
        constants: stands before the types.
    """

    module: ModuleType
    path: Path
    about: str
    roots: tuple[str, ...] = ()
    constants: str = ""


def typescript_type(node: ast.expr) -> str:
    """The TypeScript of one annotation.

    Raises:
        ValueError: a construct that this file has no rule for.
    """
    match node:
        case ast.Constant(value=None):
            return "null"
        case ast.Name(id=name):
            return SCALARS.get(name, name)
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            return f"{typescript_type(left)} | {typescript_type(right)}"
        case ast.Subscript(value=ast.Name(id="Literal"), slice=values):
            return " | ".join(_literal(value) for value in _elements(values))
        case ast.Subscript(value=ast.Name(id="list"), slice=item):
            inner = typescript_type(item)
            compound = " | " in inner or inner.startswith("readonly ")
            return f"readonly ({inner})[]" if compound else f"readonly {inner}[]"
        case ast.Subscript(value=ast.Name(id="dict"), slice=ast.Tuple(elts=[key, value])):
            return f"Readonly<Record<{typescript_type(key)}, {typescript_type(value)}>>"
    raise ValueError(f"no TypeScript for {ast.unparse(node)!r}")


def _elements(node: ast.expr) -> list[ast.expr]:
    return list(node.elts) if isinstance(node, ast.Tuple) else [node]


def _literal(node: ast.expr) -> str:
    if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
        raise ValueError(f"only strings may be literals on the wire, not {ast.unparse(node)!r}")
    return f'"{node.value}"'


def _doc(text: str, indent: str = "") -> str:
    """A JSDoc comment of `text`, "" when there is none."""
    lines = text.strip().splitlines()
    if not lines:
        return ""
    if len(lines) == 1:
        return f"{indent}/** {lines[0]} */\n"
    body = "".join(f"{indent} * {line.strip()}".rstrip() + "\n" for line in lines)
    return f"{indent}/**\n{body}{indent} */\n"


def _is_dataclass(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)


def _interface(node: ast.ClassDef, lines: list[str]) -> str:
    """One dataclass as an interface; the comment behind a field becomes its doc comment."""
    bases = f" extends {', '.join(map(typescript_type, node.bases))}" if node.bases else ""
    out = [_doc(ast.get_docstring(node) or "") + f"export interface {node.name}{bases} {{\n"]
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            line = lines[(item.end_lineno or item.lineno) - 1]
            _, _, comment = line.encode()[item.end_col_offset or 0 :].decode().partition("#")
            out.append(_doc(comment, "  ") + f"  readonly {item.target.id}: {typescript_type(item.annotation)};\n")
    out.append("}\n")
    return "".join(out)


def _is_alias(node: ast.Assign, known: set[str]) -> bool:
    names = {name.id for name in ast.walk(node.value) if isinstance(name, ast.Name)}
    return bool(names) and isinstance(node.value, ast.BinOp | ast.Subscript) and names <= known | {"Literal"}


def _reachable(nodes: dict[str, ast.stmt], roots: tuple[str, ...]) -> set[str]:
    """The names that `roots` are made of; the rest is for Python only."""
    found: set[str] = set()
    todo = list(roots)
    while todo:
        name = todo.pop()
        if name in nodes and name not in found:
            found.add(name)
            todo += [part.id for part in ast.walk(nodes[name]) if isinstance(part, ast.Name)]
    return found


def _imports(tree: ast.Module) -> Iterator[str]:
    """What one file of types takes from the other."""
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module == "server.wire":
            names = ", ".join(alias.name for alias in node.names)
            yield f'import type {{ {names} }} from "../wire/types";\n'


def _declarations(source: str, roots: tuple[str, ...]) -> Iterator[str]:
    lines = source.splitlines()
    tree = ast.parse(source)
    yield from _imports(tree)
    nodes: dict[str, ast.stmt] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and _is_dataclass(node):
            nodes[node.name] = node
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and _is_alias(node, set(nodes)):
            nodes[node.targets[0].id] = node
    wanted = _reachable(nodes, roots or tuple(nodes))
    for name, node in nodes.items():
        if name in wanted and isinstance(node, ast.ClassDef):
            yield _interface(node, lines)
        elif name in wanted and isinstance(node, ast.Assign):
            yield f"export type {name} = {typescript_type(node.value)};\n"


def _constants() -> str:
    """The binary header as numbers: offsets from the start of a frame, in bytes."""
    codes = wire.HEADER.format.lstrip("<")
    offsets = [struct.calcsize("<" + codes[:i]) for i in range(len(codes))]
    fields = "".join(
        f"  {name}: {at},\n" for name, at in zip(wire.HEADER_FIELDS, offsets, strict=True) if name != "reserved"
    )
    sizes = "".join(f"  {dtype}: {int(dtype[1:])},\n" for dtype in wire.Dtype.__args__)  # type: ignore[attr-defined]
    return (
        f'export const SUBPROTOCOL = "{wire.SUBPROTOCOL}";\n'
        f"export const OPCODE_SAMPLES = {wire.OPCODE_SAMPLES};\n"
        "/** Bit of `flags`: history. Prepend it; the newest block comes first, live frames may come between. */\n"
        f"export const FLAG_HISTORY = {wire.FLAG_HISTORY};\n"
        "/** Size of a sample frame's header in bytes; the columns follow. */\n"
        f"export const HEADER_SIZE = {wire.HEADER.size};\n"
        "/** Where each header field stands in a frame, in bytes (u8, u8, u16, u32, u32, u32, u64, u32, f64). */\n"
        f"export const HEADER = {{\n{fields}}} as const;\n"
        "/** Bytes of one value of each dtype. */\n"
        f"export const DTYPE_SIZE = {{\n{sizes}}} as const;\n"
    )


TARGETS = (
    Target(wire, _PAGE / "wire" / "types.ts", "the wire", ("ServerText", "BrowserText"), _constants()),
    Target(forms, _PAGE / "forms" / "types.ts", "the forms"),
    Target(recorded, _PAGE / "recordings" / "types.ts", "the recordings"),
)


def generate(target: Target) -> str:
    """The whole of one types.ts."""
    source = Path(str(target.module.__file__)).read_text(encoding="utf-8")
    name = target.module.__name__.replace(".", "/")
    origin = f"Generated from {name}.py by `python -m server.generate_ts_types`; do not edit."
    made = f"/** Types of {target.about}. {origin} */\n"
    return "\n".join([made, *([target.constants] if target.constants else []), *_declarations(source, target.roots)])


def main(arguments: list[str]) -> int:
    stale = 0
    for target in TARGETS:
        text = generate(target)
        if "--check" not in arguments:
            target.path.parent.mkdir(parents=True, exist_ok=True)
            target.path.write_text(text, encoding="utf-8")
            print(target.path)
        elif not target.path.exists() or target.path.read_text(encoding="utf-8") != text:
            print(f"{target.path} is stale: run python -m server.generate_ts_types", file=sys.stderr)
            stale = 1
    return stale


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
