"""TypeScript types of the wire and the forms, generated from the dataclasses.

    server/wire/                        ─> web/src/wire/types.ts              messages of the WebSocket
    server/wire/capabilities.py         ─> web/src/wire/capability-types.ts   capabilities of the server
    server/configuration/api_models.py  ─> web/src/wire/form-types.ts         HTTP API of the Configure page
    server/library/api_models.py        ─> web/src/wire/recording-types.ts        HTTP API of the Recordings page

Fields are added only there. This file reads their *source*, so that order, docstrings and the comments behind fields
are copied to the TypeScript. It converts

    X = Literal["a", "b"]              into   export type X = "a" | "b";
    X = A | B                          into   export type X = A | B;
    @dataclass class X: a: int | None  into   export interface X { readonly a: number | null }
    @dataclass class X(Y): a: int      into   export interface X extends Y { readonly a: number }

A type without a rule here is an error, not a guess. `python -m imuscope.server.generators` writes the files.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import EllipsisType, ModuleType

from imuscope.protocols.commands import rate_tables as editor_choices
from imuscope.server import wire
from imuscope.server.configuration import api_models as forms
from imuscope.server.library import api_models as recorded
from imuscope.server.wire import capabilities

PAGE = Path(__file__).resolve().parents[2] / "web" / "src"
IMPORTED = {"imuscope.server.wire": "./types", "imuscope.server.wire.capabilities": "./capability-types"}
BORROWED = ("imuscope.protocols.", "imuscope.recordings.")
SCALARS = {"str": "string", "int": "number", "float": "number", "bool": "boolean", "None": "null", "Any": "unknown"}


@dataclass(frozen=True, slots=True)
class Target:
    """One file of types.

    Args:
        module: the source.
        path: the file to write.
        about: subject of the types, for the file's comment.
        roots: names to include, with the types they consist of; (): every dataclass.
        parts: modules whose types this one imports, and which have no file of their own; those used by others first.
    """

    module: ModuleType
    path: Path
    about: str
    roots: tuple[str, ...] = ()
    parts: tuple[ModuleType, ...] = ()


def typescript_type(node: ast.expr) -> str:
    """The TypeScript of one annotation.

    Raises:
        ValueError: no rule for the annotation.
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
        case (
            ast.Subscript(value=ast.Name(id="list"), slice=item)
            | ast.Subscript(
                value=ast.Name(id="tuple"), slice=ast.Tuple(elts=[item, ast.Constant(value=EllipsisType())])
            )
        ):
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
    """A JSDoc comment of `text`, "" if it is empty."""
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
    for item, name, comment in _fields(node, lines):
        out.append(_doc(comment, "  ") + f"  readonly {name}: {typescript_type(item.annotation)};\n")
    out.append("}\n")
    return "".join(out)


def _fields(node: ast.ClassDef, lines: list[str]) -> Iterator[tuple[ast.AnnAssign, str, str]]:
    """The fields of a dataclass: node, name, and the comment behind it."""
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            line = lines[(item.end_lineno or item.lineno) - 1]
            _, _, comment = line.encode()[item.end_col_offset or 0 :].decode().partition("#")
            yield item, item.target.id, comment.strip()


def field_comments() -> dict[str, dict[str, str]]:
    """Class name → field → the comment behind it, for every dataclass of the wire and the HTTP API."""
    comments: dict[str, dict[str, str]] = {}
    for module in (module for target in TARGETS for module in (target.module, *target.parts)):
        source = Path(str(module.__file__)).read_text(encoding="utf-8")
        tree = ast.parse(source)
        own = ((node, source.splitlines()) for node in tree.body if isinstance(node, ast.ClassDef))
        for node, lines in (*_borrowed_records(tree), *own):
            comments[node.name] = {name: comment for _, name, comment in _fields(node, lines) if comment}
    return comments


def _is_alias(node: ast.Assign, known: set[str]) -> bool:
    names = {name.id for name in ast.walk(node.value) if isinstance(name, ast.Name)}
    return bool(names) and isinstance(node.value, ast.BinOp | ast.Subscript) and names <= known | {"Literal"}


def _reachable(nodes: dict[str, ast.stmt], roots: tuple[str, ...]) -> set[str]:
    """The names that `roots` refer to, directly or indirectly; the others are for Python only."""
    names: set[str] = set()
    todo = list(roots)
    while todo:
        name = todo.pop()
        if name in nodes and name not in names:
            names.add(name)
            todo += [part.id for part in ast.walk(nodes[name]) if isinstance(part, ast.Name)]
    return names


def _imports(tree: ast.Module) -> Iterator[str]:
    """Import lines of types from other generated files."""
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module in IMPORTED:
            names = ", ".join(alias.name for alias in node.names)
            yield f'import type {{ {names} }} from "{IMPORTED[node.module]}";\n'


def _borrowed(tree: ast.Module, declared: set[str]) -> Iterator[str]:
    for record, lines in _borrowed_records(tree):
        if record.name not in declared:
            yield _interface(record, lines)


def _borrowed_records(tree: ast.Module) -> Iterator[tuple[ast.ClassDef, list[str]]]:
    """Records of the packages below the server that are sent as they are, and the lines of their files."""
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(BORROWED):
            source = Path(str(import_module(str(node.module)).__file__)).read_text("utf-8")
            names = {alias.name for alias in node.names}
            for record in ast.parse(source).body:
                if isinstance(record, ast.ClassDef) and record.name in names:
                    yield record, source.splitlines()


def _declarations(source: str, roots: tuple[str, ...]) -> Iterator[str]:
    lines = source.splitlines()
    tree = ast.parse(source)
    yield from _imports(tree)
    yield from _borrowed(tree, {node.name for node in tree.body if isinstance(node, ast.ClassDef)})
    nodes: dict[str, ast.stmt] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and _is_dataclass(node):
            nodes[node.name] = node
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and _is_alias(node, set(nodes)):
            nodes[node.targets[0].id] = node
    reachable = _reachable(nodes, roots or tuple(nodes))
    for name, node in nodes.items():
        if name in reachable and isinstance(node, ast.ClassDef):
            yield _interface(node, lines)
        elif name in reachable and isinstance(node, ast.Assign):
            yield f"export type {name} = {typescript_type(node.value)};\n"


TARGETS = (
    Target(
        wire,
        PAGE / "wire" / "types.ts",
        "the wire",
        ("ServerText", "BrowserText"),
        (wire.channels, wire.devices, wire.events, wire.jobs, wire.recordings, wire.messages),
    ),
    Target(capabilities, PAGE / "wire" / "capability-types.ts", "what the server can do"),
    Target(forms, PAGE / "wire" / "form-types.ts", "the forms", parts=(editor_choices,)),
    Target(recorded, PAGE / "wire" / "recording-types.ts", "the recordings"),
)


def generate(target: Target) -> str:
    """The whole of one types.ts."""
    source = "\n".join(Path(str(one.__file__)).read_text(encoding="utf-8") for one in (*target.parts, target.module))
    path = target.module.__name__.removeprefix("imuscope.").replace(".", "/") + (
        "/" if hasattr(target.module, "__path__") else ".py"
    )
    origin = f"Generated from {path} by `python -m imuscope.server.generators`; do not edit."
    made = f"/** Types of {target.about}. {origin} */\n"
    return "\n".join([made, *_declarations(source, target.roots)])
