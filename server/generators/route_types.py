"""TypeScript types of the HTTP API, from its OpenAPI document: web/src/wire/routes.ts.

    /openapi.json, paths               an entry of `Routes` each, "GET /api/devices/{device}/forms": input, answer
    /openapi.json, components/schemas  an interface each, except those of types.ts, which have comments there

A client names a route, and its parameters, body and answer are type-checked (web/src/requests/http.ts). In a body,
fields with a default may be left out. A body or an answer that is not JSON is a Blob, text is a string, no content is
undefined. `python -m imuscope.server.generators` writes the file. A schema without a rule here is an error,
not a guess.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from imuscope.server.generators.files import document

Schema = Mapping[str, Any]
Sources = Mapping[str, str]
"""Name of a type → module of the page that contains it."""

PROBLEM = "ProblemBody"
"""Body of every error response."""
REFERENCE = "#/components/schemas/"
SCALARS = {"string": "string", "integer": "number", "number": "number", "boolean": "boolean", "null": "null"}
DEFAULTED = """/** Of `T`, the fields that the server has defaults for may be left out. */
export type Defaulted<T, K extends keyof T> = Omit<T, K> & { readonly [P in K]?: T[P] };
"""


def typescript_type(schema: Schema) -> str:
    """The TypeScript of one JSON schema.

    Raises:
        ValueError: no rule for the schema.
    """
    match schema:
        case {"$ref": reference}:
            return str(reference).removeprefix(REFERENCE)
        case {"const": value}:
            return json.dumps(value)
        case {"enum": values}:
            return " | ".join(map(json.dumps, values))
        case {"anyOf": choices} | {"oneOf": choices}:
            return " | ".join(dict.fromkeys(map(typescript_type, choices)))
        case {"type": "array", "items": items}:
            inner = typescript_type(items)
            is_compound = " | " in inner or inner.startswith("readonly ")
            return f"readonly ({inner})[]" if is_compound else f"readonly {inner}[]"
        case {"type": "object", "additionalProperties": dict() as values}:
            return f"Readonly<Record<string, {typescript_type(values)}>>"
        case {"type": "object"}:
            return "Readonly<Record<string, unknown>>"
        case {"type": "string", "format": "binary"}:
            return "Blob"
        case {"type": str() as name}:
            return SCALARS[name]
    if not set(schema) - {"title", "description", "default"}:
        return "unknown"
    raise ValueError(f"no TypeScript for {schema!r}")


def _doc(text: str, indent: str = "") -> str:
    """A JSDoc comment of the first paragraph of `text`, "" if it is empty."""
    words = " ".join(text.split("\n\n")[0].split())
    return f"{indent}/** {words} */\n" if words else ""


def _interface(name: str, schema: Schema, *, is_body: bool) -> str:
    lines = [_doc(schema.get("description", "")) + f"export interface {name} {{\n"]
    for field, of_field in schema.get("properties", {}).items():
        mark = "?" if is_body and field not in schema.get("required", ()) else ""
        lines.append(_doc(of_field.get("description", ""), "  "))
        lines.append(f"  readonly {field}{mark}: {typescript_type(of_field)};\n")
    return "".join([*lines, "}\n"])


def _references(schema: object) -> Iterator[str]:
    """Names of the components that a schema refers to."""
    if isinstance(schema, Mapping):
        if isinstance(reference := schema.get("$ref"), str):
            yield reference.removeprefix(REFERENCE)
        for part in schema.values():
            yield from _references(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from _references(part)


def _record(parameters: list[Schema]) -> str:
    fields = [
        f"readonly {one['name']}{'' if one.get('required') else '?'}: {typescript_type(one['schema'])}"
        + ("" if one.get("required") else " | undefined")
        for one in parameters
    ]
    return f"{{ {'; '.join(fields)} }}"


class _Writer:
    """The parts of one routes.ts."""

    def __init__(self, openapi: Schema, sources: Sources) -> None:
        self._paths: Mapping[str, Mapping[str, Schema]] = openapi["paths"]
        self._components: Mapping[str, Schema] = openapi["components"]["schemas"]
        self._sources = sources
        self._bodies: set[str] = set()
        self._used = {PROBLEM}

    def text(self) -> str:
        routes = "".join(self._routes())
        needed = self._needed()
        own = [name for name in self._components if name in needed and name not in self._sources]
        interfaces = [_interface(name, self._components[name], is_body=name in self._bodies) for name in own]
        return "\n".join([*self._imports(needed), DEFAULTED, *interfaces, f"export interface Routes {{\n{routes}}}\n"])

    def _imports(self, needed: set[str]) -> Iterator[str]:
        """Types imported from another file."""
        named = {name for name in needed if name in self._sources}
        lines = []
        for module in dict.fromkeys(self._sources.values()):
            names = sorted(name for name in named if self._sources[name] == module)
            if names:
                lines.append(f'import type {{ {", ".join(names)} }} from "{module}";\n')
        yield "".join(lines)

    def _needed(self) -> set[str]:
        """The components that the routes use, and those that components of this file refer to."""
        names: set[str] = set()
        todo = list(self._used)
        while todo:
            name = todo.pop()
            if name not in names:
                names.add(name)
                if name not in self._sources:
                    todo += _references(self._components[name])
        return names

    def _routes(self) -> Iterator[str]:
        for path, ways in self._paths.items():
            for method, operation in ways.items():
                yield _doc(operation.get("description", ""), "  ")
                fields = [f"{key}: {kind};" for key, kind in self._route(operation).items()]
                inside = f" {fields[0]} " if len(fields) == 1 else "".join(f"\n    {one}" for one in fields) + "\n  "
                yield f'  "{method.upper()} {path}": {{{inside}}};\n'

    def _route(self, operation: Schema) -> dict[str, str]:
        """Parameters, body and response of a route. Optional ones have a question mark behind the key."""
        fields: dict[str, str] = {}
        for place in ("path", "query"):
            parameters = [one for one in operation.get("parameters", []) if one["in"] == place]
            if parameters:
                mark = "" if any(one.get("required") for one in parameters) else "?"
                fields[f"readonly {place}{mark}"] = _record(parameters)
        if body := operation.get("requestBody"):
            content = body["content"]
            schema = content["application/json"]["schema"] if "application/json" in content else _only(content)
            mark = "" if body.get("required") else "?"
            fields[f"readonly body{mark}"] = self._body(schema)
        fields["readonly answer"] = self._answer(operation["responses"])
        return fields

    def _body(self, schema: Schema) -> str:
        self._used |= set(_references(schema))
        if "anyOf" in schema:
            return " | ".join(map(self._body, schema["anyOf"]))
        name = typescript_type(schema)
        if name not in self._components:
            return name
        self._bodies.add(name)
        of_body = self._components[name]
        optional = [field for field in of_body.get("properties", {}) if field not in of_body.get("required", ())]
        if name not in self._sources or not optional:
            return name
        return f"Defaulted<{name}, {' | '.join(map(json.dumps, optional))}>"

    def _answer(self, responses: Schema) -> str:
        kinds: dict[str, None] = {}
        for status, response in responses.items():
            if not status.startswith("2"):
                continue
            for content in response.get("content", {}).values() or [None]:
                schema = (content or {}).get("schema")
                self._used |= set(_references(schema))
                kinds["undefined" if content is None else typescript_type(schema or {})] = None
        return " | ".join(kinds)


def _only(content: Mapping[str, Schema]) -> Schema:
    (one,) = content.values()
    schema: Schema = one["schema"]
    return schema


def generate(sources: Sources) -> str:
    """The whole of routes.ts.

    Args:
        sources: types that other files export.
    """
    about = "Routes of the HTTP API. Generated from its OpenAPI document by `python -m imuscope.server.generators`"
    return f"/** {about}; do not edit. */\n\n" + _Writer(document(), sources).text()
