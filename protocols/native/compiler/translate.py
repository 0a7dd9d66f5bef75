"""A kernel's Python as C: types inferred from its signature, statement by statement.

Translated are numbers, arrays of one or two dimensions and their elements, rows and slices that are set to a
number, tuples, `if`, `while`, `for … in range(…)`, calls of other kernels and of `len`, `min`, `max`, `abs`, `int`,
`float`, `range` and numpy's `empty`, `zeros`, `full`. Anything else is a TranslateError with its line.

A function without a signature (`inlined`) is translated once for each combination of types that it is called with.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from imuscope.protocols.native.compiler import expressions as values
from imuscope.protocols.native.compiler.expressions import (
    FLAG,
    FLOAT,
    INT,
    UNSIGNED,
    TranslateError,
    Value,
    c_type,
    cast,
)
from imuscope.protocols.native.kernels import (
    ArrayType,
    Kernel,
    Kind,
    LibraryFunction,
    NumberType,
    TupleType,
    kernel_of,
)

_PASSES = 8
"""Types of variables are settled after two or three passes over a function."""
_ON_STACK = 1 << 16
"""Bytes: an array of a size that is known, and no larger, lies on the stack."""
_STACK_ITEMS = 256
"""An array of a size that is not known lies on the stack if it has at most so many elements."""
VOID = NumberType("void")


@dataclass
class CSource:
    """The C text of several kernels, with what they share."""

    types: dict[str, str] = field(default_factory=dict)
    constants: dict[str, str] = field(default_factory=dict)
    externals: dict[str, str] = field(default_factory=dict)
    functions: dict[str, str] = field(default_factory=dict)
    results: dict[str, Kind] = field(default_factory=dict)
    """Of functions, by their names in C."""

    def text(self) -> str:
        """The whole, in an order that C accepts."""
        parts = (self.types, self.constants, self.externals, self.functions)
        return "\n".join(text for part in parts for text in part.values())

    def use(self, kind: Kind) -> str:
        """A type's name in C, defined if it needs to be."""
        if isinstance(kind, TupleType):
            for one in kind.kinds:
                self.use(one)
        if not isinstance(kind, NumberType):
            self.types.setdefault(c_type(kind), values.type_definition(kind))
        return c_type(kind)

    def constant(self, array: np.ndarray[Any, Any]) -> Value:
        """A table of a module, as constant data."""
        kind = ArrayType(array.dtype.name, array.ndim, readonly=True)
        self.use(kind)
        data = np.ascontiguousarray(array)
        name = f"table_{len(self.constants)}"
        text = ", ".join(str(item) for item in data.ravel().tolist())
        for known, value in self.constants.items():
            if value.endswith(f"{{{text}}};"):
                name = known
        self.constants[name] = f"static const {values.ITEMS[kind.item]} {name}[] = {{{text}}};"
        shape = ", ".join(f"{size}ll" for size in array.shape)
        return Value(kind, f"(({c_type(kind)}){{({values.ITEMS[kind.item]} *){name}, {{{shape}}}}})")

    def function(self, kernel: Kernel, arguments: tuple[Kind, ...]) -> str:
        """Name in C of a kernel for these types, translated if it is not yet."""
        inline = kernel.signature is None
        name = kernel.name.replace(".", "_") + ("".join(f"__{c_type(one)}" for one in arguments) if inline else "")
        if name not in self.results:
            _Translation(self, kernel, arguments, name).translate()
        return name


class _Translation:
    """One function being translated."""

    def __init__(self, source: CSource, kernel: Kernel, arguments: tuple[Kind, ...], name: str) -> None:
        self.source = source
        self.kernel = kernel
        self.name = name
        [tree] = ast.parse(textwrap.dedent(inspect.getsource(kernel.function))).body
        assert isinstance(tree, ast.FunctionDef)
        self.tree = tree
        self.parameters = [one.arg for one in tree.args.args]
        if len(self.parameters) != len(arguments):
            raise TranslateError(f"{kernel.name}: {len(self.parameters)} arguments, {len(arguments)} types")
        self.arguments = arguments
        self.variables: dict[str, Kind] = dict(zip(self.parameters, arguments, strict=True))
        self.memory: dict[str, str] = {}
        """Declarations of the memory of local arrays."""
        self.result: Kind | None = None if kernel.signature is None else kernel.signature[0]
        self.lines: list[str] = []
        self.depth = 1
        self.names = 0

    def translate(self) -> None:
        for _ in range(_PASSES):
            before = (dict(self.variables), self.result)
            self.lines, self.names = [], 0
            try:
                self._block(self.tree.body)
            except TranslateError as error:
                raise TranslateError(f"{self.kernel.name}: {error}") from None
            if before == (self.variables, self.result):
                break
        result = self.result or VOID
        pairs = zip(self.parameters, self.arguments, strict=True)
        used = ", ".join(f"{self.source.use(kind)} {_c_name(name)}" for name, kind in pairs)
        local = [
            f"    {self.source.use(kind)} {_c_name(name)} = {{0}};"
            for name, kind in self.variables.items()
            if name not in self.parameters
        ]
        how = "static inline __attribute__((always_inline))" if self.kernel.signature is None else "static"
        body = "\n".join((*local, *self.memory.values(), *self.lines))
        self.source.results[self.name] = result
        self.source.functions[self.name] = f"{how} {self.source.use(result)} {self.name}({used}) {{\n{body}\n}}\n"

    # statements

    def _put(self, line: str) -> None:
        self.lines.append("    " * self.depth + line)

    def _block(self, body: list[ast.stmt]) -> None:
        for statement in body:
            handle: Callable[[Any], None] | None = getattr(self, f"_do_{type(statement).__name__.lower()}", None)
            try:
                if handle is None:
                    raise TranslateError(type(statement).__name__)
                handle(statement)
            except TranslateError as error:
                if str(error).startswith("line "):
                    raise
                raise TranslateError(f"line {statement.lineno} ({ast.unparse(statement)[:70]}): {error}") from None

    def _inner(self, head: str, body: list[ast.stmt]) -> None:
        self._put(f"{head} {{")
        self.depth += 1
        self._block(body)
        self.depth -= 1
        self._put("}")

    def _do_expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self._put(f"{self._value(node.value).text};")

    def _do_pass(self, _: ast.Pass) -> None: ...

    def _do_break(self, _: ast.Break) -> None:
        self._put("break;")

    def _do_continue(self, _: ast.Continue) -> None:
        self._put("continue;")

    def _do_return(self, node: ast.Return) -> None:
        if node.value is None:
            self._put("return;")
            return
        value = self._value(node.value, self.result)
        if self.result is None or self.kernel.signature is None:
            self.result = value.kind if self.result is None else values.common(self.result, value.kind)
        self._put(f"return {cast(value, self.result).text};")

    def _do_if(self, node: ast.If) -> None:
        self._inner(f"if ({values.truth(self._value(node.test))})", node.body)
        if node.orelse:
            self._inner("else", node.orelse)

    def _do_while(self, node: ast.While) -> None:
        self._inner(f"while ({values.truth(self._value(node.test))})", node.body)

    def _do_for(self, node: ast.For) -> None:
        call = node.iter
        if not (isinstance(call, ast.Call) and isinstance(node.target, ast.Name) and not node.orelse):
            raise TranslateError("only for … in range(…)")
        if self._global(call.func) is not range:
            raise TranslateError("only for … in range(…)")
        bounds = [self._value(one) for one in call.args]
        start, stop = (values.number(0), bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = bounds[2].number if len(bounds) == 3 else 1
        if step not in (1, -1):
            raise TranslateError("a step of 1 or −1")
        kind = UNSIGNED if UNSIGNED in (start.kind, stop.kind) else INT
        here, end = self._fresh("at"), self._fresh("end")
        self._declare(node.target.id, kind)
        name, compare = c_type(kind), "<" if step == 1 else ">"
        self._put(f"{name} {end} = {cast(stop, kind).text};")
        self._put(f"for ({name} {here} = {cast(start, kind).text}; {here} {compare} {end}; {here} += {step}) {{")
        self.depth += 1
        target = self._variable(node.target.id)
        self._put(f"{target.text} = {cast(Value(kind, here), target.kind).text};")
        self._block(node.body)
        self.depth -= 1
        self._put("}")

    def _do_annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._assign([node.target], node.value)

    def _do_assign(self, node: ast.Assign) -> None:
        self._assign(node.targets, node.value)

    def _do_augassign(self, node: ast.AugAssign) -> None:
        value = values.binary(node.op, self._value(node.target), self._value(node.value))
        self._store(node.target, value)

    def _assign(self, targets: list[ast.expr], source: ast.expr) -> None:
        if len(targets) == 1 and isinstance(targets[0], ast.Name) and self._allocates(source):
            assert isinstance(source, ast.Call)
            self._allocate(targets[0].id, source)
            return
        if len(targets) == 1 and isinstance(targets[0], ast.Tuple) and isinstance(source, ast.Tuple):
            parts = [self._held(self._value(one)) for one in source.elts]
            for target, value in zip(targets[0].elts, parts, strict=True):
                self._store(target, value)
            return
        known = self.variables.get(targets[0].id) if isinstance(targets[0], ast.Name) else None
        value = self._value(source, known if isinstance(known, TupleType) else None)
        if len(targets) > 1 or isinstance(targets[0], ast.Tuple):
            value = self._held(value)
        for target in targets:
            self._store(target, value)

    def _held(self, value: Value) -> Value:
        """The value, computed once."""
        if value.number is not None:
            return value
        name = self._fresh("held")
        self._put(f"{self.source.use(value.kind)} {name} = {value.text};")
        return Value(value.kind, name)

    def _store(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self._declare(target.id, value if isinstance(value.kind, NumberType) else value.kind)
            variable = self._variable(target.id)
            self._put(f"{variable.text} = {cast(value, variable.kind).text};")
        elif isinstance(target, ast.Tuple):
            if not isinstance(value.kind, TupleType) or len(value.kind.kinds) != len(target.elts):
                raise TranslateError("another number of values")
            for k, one in enumerate(target.elts):
                self._store(one, Value(value.kind.kinds[k], f"{value.text}.m{k}"))
        elif isinstance(target, ast.Subscript):
            array = self._value(target.value)
            indices = target.slice.elts if isinstance(target.slice, ast.Tuple) else [target.slice]
            if any(isinstance(one, ast.Slice) for one in indices):
                self._fill(array, indices, value)
                return
            place = values.element(array, [self._value(one) for one in indices])
            assert isinstance(array.kind, ArrayType)
            wide = FLOAT if array.kind.item.startswith("float") else INT
            wide = UNSIGNED if value.kind == UNSIGNED and wide == INT else wide
            self._put(f"{place} = ({values.ITEMS[array.kind.item]}){cast(value, wide).text};")
        else:
            raise TranslateError("not something to assign to")

    def _fill(self, array: Value, indices: list[ast.expr], value: Value) -> None:
        """`array[a:b, c:] = number`."""
        places: list[Value] = []
        value = self._held(cast(value, INT))
        opened = 0
        for k, one in enumerate(indices):
            if not isinstance(one, ast.Slice):
                places.append(self._value(one))
                continue
            lower = cast(self._value(one.lower), INT).text if one.lower else "0"
            upper = cast(self._value(one.upper), INT).text if one.upper else f"{array.text}.shape[{k}]"
            here = self._fresh("at")
            self._put(f"for (i64 {here} = {lower}; {here} < {upper}; {here}++) {{")
            places.append(Value(INT, here))
            opened += 1
        assert isinstance(array.kind, ArrayType)
        self._put(f"{values.element(array, places)} = ({values.ITEMS[array.kind.item]}){value.text};")
        self._put("}" * opened)

    def _allocates(self, source: ast.expr) -> bool:
        return isinstance(source, ast.Call) and self._global(source.func) in (np.empty, np.zeros, np.full)

    def _allocate(self, name: str, call: ast.Call) -> None:
        """A local array: on the stack if it is small, else released when the function returns."""
        made = self._global(call.func)
        lengths = call.args[0].elts if isinstance(call.args[0], ast.Tuple) else call.args[:1]
        shape = [self._value(one) for one in lengths]
        item = np.dtype(self._global(call.args[-1])).name
        kind = ArrayType(item, len(shape))
        self._declare(name, kind)
        place, c_item = f"{_c_name(name)}_memory", values.ITEMS[item]
        sizes = [one.number for one in shape]
        count = " * ".join(cast(one, INT).text for one in shape)
        known = all(size is not None for size in sizes)
        if known and np.prod([int(size or 0) for size in sizes]) * np.dtype(item).itemsize <= _ON_STACK:
            self.memory[name] = f"    {c_item} {place}[{count}];"
            data = place
        else:
            few, size = f"{place}_few", f"({count}) * sizeof({c_item})"
            self.memory[name] = (
                f"    {c_item} {few}[{_STACK_ITEMS}];\n    void *{place} __attribute__((cleanup(give_back))) = 0;"
            )
            data = f"({count}) <= {_STACK_ITEMS} ? {few} : ({c_item} *)({place} = memory({size}))"
        each = ", ".join(cast(one, INT).text for one in shape)
        self._put(f"{_c_name(name)} = ({self.source.use(kind)}){{{data}, {{{each}}}}};")
        if made is not np.empty:
            value = self._value(call.args[1]) if made is np.full else values.number(0)
            here = self._fresh("at")
            self._put(f"for (i64 {here} = 0; {here} < {count}; {here}++)")
            self._put(f"    {_c_name(name)}.data[{here}] = {value.text};")

    # names

    def _fresh(self, word: str) -> str:
        self.names += 1
        return f"{word}_{self.names}"

    def _declare(self, name: str, value: Value | Kind) -> None:
        """Note that a variable receives such a value."""
        kind = value.kind if isinstance(value, Value) else value
        known = self.variables.get(name)
        if name in self.parameters and isinstance(known, NumberType):
            return
        self.variables[name] = kind if known is None else values.common(known, value)

    def _variable(self, name: str) -> Value:
        return Value(self.variables[name], _c_name(name))

    def _global(self, node: ast.expr) -> Any:
        """The value of a dotted name of the module; None if it is not one."""
        if isinstance(node, ast.Attribute):
            return getattr(self._global(node.value), node.attr, None)
        if not isinstance(node, ast.Name) or node.id in self.variables:
            return None
        space = self.kernel.function.__globals__
        builtin = {"range": range, "len": len, "int": int, "float": float, "min": min, "max": max, "abs": abs}
        return space.get(node.id, builtin.get(node.id))

    # expressions

    def _value(self, node: ast.expr, expected: Kind | None = None) -> Value:
        handle: Callable[..., Value] | None = getattr(self, f"_value_{type(node).__name__.lower()}", None)
        if handle is None:
            raise TranslateError(type(node).__name__)
        return handle(node, expected)

    def _value_constant(self, node: ast.Constant, _: Kind | None) -> Value:
        if isinstance(node.value, bool | int | float):
            return values.number(node.value)
        raise TranslateError(f"{node.value!r} is not a number")

    def _value_name(self, node: ast.Name, _: Kind | None) -> Value:
        if node.id in self.variables:
            return self._variable(node.id)
        constant = self.kernel.function.__globals__.get(node.id)
        if isinstance(constant, np.ndarray):
            return self.source.constant(constant)
        if isinstance(constant, np.unsignedinteger):
            return Value(UNSIGNED, f"{int(constant)}ull", int(constant))
        if isinstance(constant, np.generic):
            constant = constant.item()
        if isinstance(constant, bool | int | float):
            return values.number(constant)
        raise TranslateError(f"{node.id} is not a number that is known")

    def _value_unaryop(self, node: ast.UnaryOp, _: Kind | None) -> Value:
        value = self._value(node.operand)
        if isinstance(node.op, ast.Not):
            return Value(FLAG, f"(!{values.truth(value)})")
        if isinstance(node.op, ast.USub):
            if value.number is not None:
                return values.number(-value.number)
            kind = FLOAT if value.kind == FLOAT else INT
            return Value(kind, f"(-{cast(value, kind).text})")
        raise TranslateError(type(node.op).__name__)

    def _value_binop(self, node: ast.BinOp, _: Kind | None) -> Value:
        return values.binary(node.op, self._value(node.left), self._value(node.right))

    def _value_boolop(self, node: ast.BoolOp, _: Kind | None) -> Value:
        sign = " && " if isinstance(node.op, ast.And) else " || "
        return Value(FLAG, f"({sign.join(values.truth(self._value(one)) for one in node.values)})")

    def _value_compare(self, node: ast.Compare, _: Kind | None) -> Value:
        parts, left = [], self._value(node.left)
        for operator, right in zip(node.ops, node.comparators, strict=True):
            if isinstance(operator, ast.In | ast.NotIn):
                if not isinstance(right, ast.Tuple):
                    raise TranslateError("in … of a tuple that is written there")
                each = [values.compare(ast.Eq(), left, self._value(one)).text for one in right.elts]
                parts.append(f"{'!' if isinstance(operator, ast.NotIn) else ''}({' || '.join(each)})")
                continue
            value = self._value(right)
            parts.append(values.compare(operator, left, value).text)
            left = value
        return Value(FLAG, f"({' && '.join(parts)})")

    def _value_ifexp(self, node: ast.IfExp, _: Kind | None) -> Value:
        a, b = self._value(node.body), self._value(node.orelse)
        kind = values.common(a, b)
        return Value(kind, f"({values.truth(self._value(node.test))} ? {cast(a, kind).text} : {cast(b, kind).text})")

    def _value_tuple(self, node: ast.Tuple, expected: Kind | None) -> Value:
        kinds: Sequence[Kind | None] = expected.kinds if isinstance(expected, TupleType) else [None] * len(node.elts)
        each = [self._value(one, kinds[k]) for k, one in enumerate(node.elts)]
        kind = expected if isinstance(expected, TupleType) else TupleType(tuple(one.kind for one in each))
        texts = ", ".join(cast(one, kind.kinds[k]).text for k, one in enumerate(each))
        return Value(kind, f"(({self.source.use(kind)}){{{texts}}})")

    def _value_attribute(self, node: ast.Attribute, _: Kind | None) -> Value:
        if node.attr == "data" and isinstance(node.value, ast.Attribute) and node.value.attr == "ctypes":
            return Value(INT, f"((i64){self._value(node.value.value).text}.data)")
        raise TranslateError(f".{node.attr}")

    def _value_subscript(self, node: ast.Subscript, _: Kind | None) -> Value:
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            if not isinstance(node.slice, ast.Constant) or not isinstance(node.slice.value, int):
                raise TranslateError("a dimension is a number")
            return Value(INT, f"{self._value(node.value.value).text}.shape[{node.slice.value}]")
        whole = self._value(node.value)
        if isinstance(whole.kind, TupleType):
            if not isinstance(node.slice, ast.Constant) or not isinstance(node.slice.value, int):
                raise TranslateError("an index of a tuple is a number")
            return Value(whole.kind.kinds[node.slice.value], f"{whole.text}.m{node.slice.value}")
        if not isinstance(whole.kind, ArrayType):
            raise TranslateError("neither an array nor a tuple")
        indices = [self._value(one) for one in (node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice])]
        if len(indices) < whole.kind.dimensions:
            one = values.row_of(whole, indices[0])
            self.source.use(one.kind)
            return one
        return values.load(whole, indices)

    def _value_call(self, node: ast.Call, _: Kind | None) -> Value:
        if isinstance(node.func, ast.Attribute) and node.func.attr == "view":
            if self._global(node.args[0]) is not np.float64:
                raise TranslateError("a view as another type than float64")
            return Value(FLOAT, f"float_of({cast(self._value(node.func.value), INT).text})")
        called = self._global(node.func)
        arguments = [self._value(one) for one in node.args]
        kernel = kernel_of(called)
        if isinstance(kernel, Kernel):
            return self._call(kernel, arguments)
        if isinstance(kernel, LibraryFunction):
            return self._call_library(kernel, arguments)
        return values.builtin_call(called, arguments, ast.unparse(node.func))

    def _call(self, kernel: Kernel, arguments: list[Value]) -> Value:
        if kernel.signature is not None:
            kinds = kernel.signature[1:]
            if len(kinds) != len(arguments):
                raise TranslateError(f"{kernel.name} takes {len(kinds)} arguments")
            arguments = [
                Value(kind, one.text) if _fits(one.kind, kind) else cast(one, kind)
                for one, kind in zip(arguments, kinds, strict=True)
            ]
        name = self.source.function(kernel, tuple(one.kind for one in arguments))
        return Value(self.source.results[name], f"{name}({', '.join(one.text for one in arguments)})")

    def _call_library(self, function: LibraryFunction, arguments: list[Value]) -> Value:
        result, *kinds = function.types
        types, name = ", ".join(f"{one}_t" for one in kinds), function.__name__
        self.source.externals[name] = f'extern {result}_t library_{name}({types}) __asm__("{name}");'
        texts = ", ".join(f"({kind}_t){one.text}" for one, kind in zip(arguments, kinds, strict=True))
        return Value(INT, f"((i64)library_{name}({texts}))")


def _fits(value: Kind, expected: Kind) -> bool:
    """Whether an array may be passed as it is: the layout is that of its type in C."""
    return isinstance(value, ArrayType) and isinstance(expected, ArrayType) and c_type(value) == c_type(expected)


def _c_name(name: str) -> str:
    """A variable's name in C, where some of Python's names are words."""
    return f"v_{name}"
