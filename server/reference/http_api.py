"""The HTTP API as a document, from its OpenAPI description."""

import re
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from imuscope.server.reference import typescript
from imuscope.server.reference.blocks import Block, Code, Heading, Items, Paragraph, TableBlock, anchor, parse

Schema = Mapping[str, Any]
METHODS = ("get", "put", "post", "patch", "delete")
SHAPE = "#/components/schemas/"

COMMON = ("401", "403", "411", "413", "415", "422", "429", "500")

INTRODUCTION = """
Everything that the page does goes through this API and through the [WebSocket](/docs/websocket). The machine-readable
description is at `/openapi.json` of every server.

On loopback no token is needed. Otherwise send `Authorization: Bearer TOKEN`: a view token can read, a control token
can also change things. Send bodies as `application/json` with a length; only uploads are `application/octet-stream`.

Every error has one shape, `{"kind": …, "message": …, "hint": …}`: `kind` is one word for programs, `message` one
sentence for the user, `hint` the next step, possibly empty. 401, 403, 411, 413, 415, 422, 429 and 500 are possible for
every request and are not listed again below. Times are unix seconds unless stated otherwise.
"""


def http_api(openapi: Schema) -> Iterator[Block]:
    """The blocks of the document.

    Args:
        openapi: as served at /openapi.json.
    """
    groups: dict[str, list[tuple[str, str, Schema]]] = {}
    for path, operations in openapi["paths"].items():
        for method in METHODS:
            if method in operations:
                operation = operations[method]
                groups.setdefault(operation.get("tags", ["other"])[0], []).append((method.upper(), path, operation))
    yield Heading(1, "HTTP API")
    yield from parse(INTRODUCTION.strip())
    for tag, operations in groups.items():
        yield Heading(2, f"Requests: {tag}")
        lines = [(f"`{method} {path}`", _first_sentence(operation)) for method, path, operation in operations]
        yield TableBlock(("request", "purpose"), tuple(lines))
        for method, path, operation in operations:
            yield from _operation(method, path, operation)
    yield Heading(2, "Shapes")
    yield Paragraph("The objects in requests and responses. A field without a default is required in a request.")
    comments = typescript.field_comments()
    for name, schema in sorted(openapi["components"]["schemas"].items()):
        if not name.startswith("HTTPValidation") and name != "ValidationError":
            yield from _shape(name, schema, comments.get(name, {}))


def _first_sentence(operation: Schema) -> str:
    text = " ".join(operation.get("description", "").split("\n\n")[0].split())
    head, dot, _ = text.partition(". ")
    return head + dot.strip() if dot else text


def _operation(method: str, path: str, operation: Schema) -> Iterator[Block]:
    yield Heading(3, f"{method} {path}")
    yield from parse(operation.get("description", operation.get("summary", "")), level=3)
    rows = [_parameter(parameter) for parameter in operation.get("parameters", ())]
    if rows := [row for row in rows if row[1] != "path" or row[-1]]:  # the others are in the address
        yield TableBlock(("parameter", "in", "type", "default", "meaning"), tuple(rows))
    for kind, content in operation.get("requestBody", {}).get("content", {}).items():
        yield Paragraph(f"Body: {_type(content.get('schema', {}))}, `{kind}`.")
    responses = operation.get("responses", {})
    answers = [_answer(status, answer) for status, answer in responses.items() if status.startswith(("2", "3"))]
    if errors := [status for status in responses if status >= "400" and status not in COMMON]:
        answers.append(f"Errors: {', '.join(errors)}")
    if answers:
        yield Items(tuple(answers))


def _parameter(parameter: Schema) -> tuple[str, ...]:
    schema = parameter.get("schema", {})
    default = "required" if parameter.get("required") else _default(schema)
    return (f"`{parameter['name']}`", parameter["in"], _type(schema), default, _meaning(schema, parameter))


def _answer(status: str, answer: Schema) -> str:
    contents = answer.get("content", {})
    if not contents:
        return f"{status}: {answer.get('description', '').lower() or 'no content'}"
    kinds = [_type(content.get("schema", {})) + f" (`{kind}`)" for kind, content in contents.items()]
    return f"{status}: {', or '.join(kinds)}"


def _shape(name: str, schema: Schema, comments: Mapping[str, str]) -> Iterator[Block]:
    yield Heading(3, name)
    about, _, arguments = schema.get("description", "").partition("\nArgs:\n")
    known = {**_arguments(arguments), **comments}
    yield from parse(about, level=3)
    if "enum" in schema:
        yield Paragraph(_type(schema))
    required = set(schema.get("required", ()))
    rows = [
        (
            f"`{field}`",
            _type(part),
            "required" if field in required else _default(part),
            _meaning(part) or known.get(field, ""),
        )
        for field, part in schema.get("properties", {}).items()
    ]
    if rows:
        yield TableBlock(("field", "type", "default", "meaning"), tuple(rows))
    elif "enum" not in schema:
        yield Code(_type(schema).replace("`", ""))


def _arguments(text: str) -> dict[str, str]:
    """Field → meaning, from the section Args of a docstring."""
    arguments: dict[str, str] = {}
    for entry in re.split(r"\n(?! )", textwrap.dedent(text).strip()):
        names, colon, meaning = entry.partition(": ")
        if colon:
            arguments |= dict.fromkeys(names.split(", "), " ".join(meaning.split()))
    return arguments


def _type(schema: Schema) -> str:
    """The type of a value in a few words; shapes are linked."""
    if "$ref" in schema:
        name = schema["$ref"].removeprefix(SHAPE)
        return f"[{name}](#{anchor(name)})"
    if "const" in schema:
        return f"`{_plain(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{_plain(value)}`" for value in schema["enum"])
    for word in ("anyOf", "oneOf"):
        if word in schema:
            return " or ".join(_type(part) for part in schema[word])
    match schema.get("type"):
        case "array":
            return f"list of {_type(schema.get('items', {}))}"
        case "object":
            inner = schema.get("additionalProperties")
            return f"map of {_type(inner)}" if isinstance(inner, Mapping) and inner else "object"
        case "string" if schema.get("format") == "binary":
            return "bytes"
        case None:
            return "any value"
        case kind:
            return str(kind)


def _plain(value: object) -> str:
    return '""' if value == "" else str(value)


def _default(schema: Schema) -> str:
    if "default" not in schema or schema["default"] is None:
        return ""
    value = schema["default"]
    text = {True: "true", False: "false"}.get(value, _plain(value)) if isinstance(value, bool) else _plain(value)
    return f"`{text}`"


def _meaning(schema: Schema, parameter: Schema | None = None) -> str:
    text = " ".join(((parameter or {}).get("description") or schema.get("description", "")).split())
    limits = [f"{word} {schema[key]}" for key, word in LIMITS.items() if key in schema]
    return "; ".join(filter(None, [text, ", ".join(limits)]))


LIMITS = {
    "minimum": "at least",
    "maximum": "at most",
    "exclusiveMinimum": "more than",
    "exclusiveMaximum": "less than",
    "minLength": "characters: at least",
    "maxLength": "characters: at most",
    "maxItems": "entries: at most",
}
