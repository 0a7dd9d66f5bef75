"""The Python module around translated kernels: arguments are checked and taken apart, results put together.

The module uses Python's stable ABI (3.11 and later) and reads NumPy's array structure directly, whose start has been
the same since NumPy 1.7; neither's header files are needed. Declarations here are those of the two documents:
"Stable Application Binary Interface" of Python and "Python types and C-structures" of NumPy.
"""

from collections.abc import Iterable

import numpy as np

from imuscope.protocols.native.compiler.expressions import c_type
from imuscope.protocols.native.compiler.translate import CSource
from imuscope.protocols.native.kernels import ArrayType, Kernel, Kind, NumberType

HEAD = """\
typedef long long i64;
typedef unsigned long long u64;
typedef double f64;
typedef _Bool bool;
typedef signed char int8_t;
typedef unsigned char uint8_t;
typedef short int16_t;
typedef unsigned short uint16_t;
typedef int int32_t;
typedef unsigned int uint32_t;
typedef i64 int64_t;
typedef u64 uint64_t;

extern void *malloc(unsigned long);
extern void free(void *);
extern void abort(void);

static bool divided_by_zero; /* tested with Python's lock held; a kernel that waits does not divide by a variable */

#ifdef CHECKED /* for tests: an index outside an array ends the process */
static inline i64 inside(i64 index, i64 size) {
    if ((u64)index >= (u64)size) abort();
    return index;
}
#define INSIDE(index, size) inside((i64)(index), size)
#else
#define INSIDE(index, size) (index)
#endif

static inline void *memory(i64 size) {
    void *place = malloc((unsigned long)size);
    if (!place) abort();
    return place;
}
static inline void give_back(void *place) { free(*(void **)place); }
static inline i64 quotient_i64(i64 a, i64 b) {
    if (b == 0) { divided_by_zero = 1; return 0; }
    if (b == -1) return (i64)(0 - (u64)a);
    i64 q = a / b;
    return q - ((a % b != 0) & ((a < 0) != (b < 0)));
}
static inline i64 modulo_i64(i64 a, i64 b) {
    if (b == 0) { divided_by_zero = 1; return 0; }
    if (b == -1) return 0;
    i64 r = a % b;
    return r != 0 && ((r < 0) != (b < 0)) ? r + b : r;
}
static inline u64 quotient_u64(u64 a, u64 b) {
    if (b == 0) { divided_by_zero = 1; return 0; }
    return a / b;
}
static inline u64 modulo_u64(u64 a, u64 b) {
    if (b == 0) { divided_by_zero = 1; return 0; }
    return a % b;
}
static inline f64 divide(f64 a, f64 b) {
    if (b == 0) { divided_by_zero = 1; return 0; }
    return a / b;
}
static inline f64 float_of(i64 bits) {
    union { i64 bits; f64 number; } both = {bits};
    return both.number;
}
"""

PYTHON = """\
typedef struct { i64 references; void *type; } PyObject;
typedef struct { PyObject head; PyObject *(*init)(void); i64 index; PyObject *copy; } PyModuleDef_Base;
typedef struct { const char *name; void *function; int flags; const char *doc; } PyMethodDef;
typedef struct {
    PyModuleDef_Base base;
    const char *name, *doc;
    i64 size;
    PyMethodDef *methods;
    void *slots, *traverse, *clear, *free;
} PyModuleDef;
enum { METH_FASTCALL = 0x80, ABI = 1013 };

extern PyObject *PyExc_TypeError, *PyExc_ZeroDivisionError, _Py_NoneStruct;
extern PyObject *PyErr_Format(PyObject *, const char *, ...);
extern void *PyErr_Occurred(void);
extern i64 PyLong_AsLongLong(PyObject *);
extern PyObject *PyLong_FromLongLong(i64);
extern PyObject *PyLong_FromUnsignedLongLong(u64);
extern f64 PyFloat_AsDouble(PyObject *);
extern PyObject *PyFloat_FromDouble(f64);
extern int PyObject_IsTrue(PyObject *);
extern PyObject *PyBool_FromLong(long);
extern i64 PyTuple_Size(PyObject *);
extern PyObject *PyTuple_GetItem(PyObject *, i64);
extern PyObject *PyTuple_New(i64);
extern int PyTuple_SetItem(PyObject *, i64, PyObject *);
extern int PyType_IsSubtype(void *, void *);
extern PyObject *PyUnicode_FromString(const char *);
extern PyObject *PyImport_GetModule(PyObject *);
extern void Py_DecRef(PyObject *);
extern PyObject *PyObject_GetAttrString(PyObject *, const char *);
extern PyObject *PyModule_Create2(PyModuleDef *, int);
extern void *PyEval_SaveThread(void);
extern void PyEval_RestoreThread(void *);
extern void Py_IncRef(PyObject *);

/* The start of NumPy's PyArrayObject and PyArray_Descr */
typedef struct { PyObject head; void *type; char kind, letter, order, flags; int number; } Descr;
typedef struct {
    PyObject head;
    char *data;
    int dimensions;
    i64 *shape, *steps;
    PyObject *base;
    Descr *descr;
    int flags;
} ArrayObject;
enum { CONTIGUOUS = 1, ALIGNED = 0x100, WRITABLE = 0x400 };
static PyObject *array_type;

static bool check_array(PyObject *value, const char *name, int at, char kind, int number, int other, int dimensions,
                        int flags) {
    ArrayObject *array = (ArrayObject *)value;
    if (!array_type || (value->type != array_type && !PyType_IsSubtype(value->type, array_type))) {
        PyErr_Format(PyExc_TypeError, "%s: argument %d is not an array", name, at);
        return 0;
    }
    if ((array->descr->number != number && array->descr->number != other) || array->descr->order == '>') {
        PyErr_Format(PyExc_TypeError, "%s: argument %d is an array of other numbers than %c%d", name, at, kind, number);
        return 0;
    }
    if (array->dimensions != dimensions || (array->flags & flags) != flags) {
        PyErr_Format(PyExc_TypeError, "%s: argument %d must have %d dimensions%s%s", name, at, dimensions,
                     flags & CONTIGUOUS ? ", be contiguous" : "", flags & WRITABLE ? " and be writable" : "");
        return 0;
    }
    return 1;
}
static bool check_count(const char *name, i64 count, i64 expected) {
    if (count == expected) return 1;
    PyErr_Format(PyExc_TypeError, "%s takes %d arguments, not %d", name, (int)expected, (int)count);
    return 0;
}
static bool check_tuple(PyObject *value, const char *name, int at, i64 size) {
    if (PyTuple_Size(value) == size) return 1;
    PyErr_Format(PyExc_TypeError, "%s: argument %d must be a tuple of %d", name, at, (int)size);
    return 0;
}
"""
_SECOND_NUMBER = {"int64": np.dtype("longlong").num, "uint64": np.dtype("ulonglong").num}


def text_of(kernels: Iterable[Kernel]) -> str:
    """The C text of a module with these kernels.

    Raises:
        TranslateError: one of them has something that is not translated.
    """
    source = CSource()
    wrappers, methods = [], []
    for kernel in kernels:
        if kernel.signature is None:
            continue
        function = source.function(kernel, kernel.signature[1:])
        wrappers.append(_wrapper(source, kernel, function))
        methods.append(f'    {{"{kernel.name}", (void *)call_{function}, METH_FASTCALL, "{kernel.fingerprint()}"}},')
    table = "\n".join(methods)
    module = f"""\
static PyMethodDef methods[] = {{
{table}
    {{0, 0, 0, 0}},
}};
static PyModuleDef module = {{{{{{1, 0}}, 0, 0, 0}}, "kernels", 0, -1, methods, 0, 0, 0, 0}};
__attribute__((visibility("default"))) PyObject *PyInit_kernels(void) {{
    PyObject *name = PyUnicode_FromString("numpy");
    if (!name) return 0;
    PyObject *numpy = PyImport_GetModule(name); /* a process without it passes no arrays */
    Py_DecRef(name);
    if (!numpy && PyErr_Occurred()) return 0;
    if (numpy) {{
        array_type = PyObject_GetAttrString(numpy, "ndarray");
        Py_DecRef(numpy);
        if (!array_type) return 0;
    }}
    return PyModule_Create2(&module, ABI);
}}
"""
    return "\n".join((HEAD, source.text(), PYTHON, *wrappers, module))


def _wrapper(source: CSource, kernel: Kernel, function: str) -> str:
    """The function that Python calls."""
    assert kernel.signature is not None
    result, *kinds = kernel.signature
    lines = [f"static PyObject *call_{function}(PyObject *self, PyObject *const *arguments, i64 count) {{"]
    name = kernel.name.removeprefix("imuscope.")
    lines.append(f'    if (!check_count("{name}", count, {len(kinds)})) return 0;')
    for k, kind in enumerate(kinds):
        lines += _argument(source, name, k, kind)
    call = f"{function}({', '.join(f'a{k}' for k in range(len(kinds)))});"
    if kernel.waits:
        lines.append("    void *state = PyEval_SaveThread();")
    lines.append(f"    {call}" if result == NumberType("void") else f"    {c_type(result)} result = {call}")
    if kernel.waits:
        lines.append("    PyEval_RestoreThread(state);")
    lines.append("    if (divided_by_zero) {")
    lines.append("        divided_by_zero = 0;")
    lines.append(f'        return PyErr_Format(PyExc_ZeroDivisionError, "{name}: division by zero");')
    lines.append("    }")
    lines += _result(result)
    return "\n".join((*lines, "}", ""))


def _argument(source: CSource, name: str, k: int, kind: Kind) -> list[str]:
    where, into = f"arguments[{k}]", f"a{k}"
    source.use(kind)
    if isinstance(kind, NumberType):
        return _number(into, where, kind)
    if not isinstance(kind, ArrayType):
        lines = [f'    if (!check_tuple({where}, "{name}", {k + 1}, {len(kind.kinds)})) return 0;']
        for m, one in enumerate(kind.kinds):
            if not isinstance(one, NumberType):
                raise TypeError(f"{name}: a tuple of numbers may be an argument, no other one")
            lines += _number(f"{into}_{m}", f"PyTuple_GetItem({where}, {m})", one)
        members = ", ".join(f"{into}_{m}" for m in range(len(kind.kinds)))
        return [*lines, f"    {c_type(kind)} {into} = {{{members}}};"]
    number = np.dtype(kind.item)
    flags = [*(["CONTIGUOUS"] if kind.contiguous else []), "ALIGNED", *([] if kind.readonly else ["WRITABLE"])]
    check = f"\"{name}\", {k + 1}, '{number.kind}', {number.num}, {_SECOND_NUMBER.get(kind.item, number.num)}"
    object_ = f"((ArrayObject *){where})"
    shape = ", ".join(f"{object_}->shape[{d}]" for d in range(kind.dimensions))
    steps = "" if kind.contiguous else ", {" + ", ".join(f"{object_}->steps[{d}]" for d in range(kind.dimensions)) + "}"
    return [
        f"    if (!check_array({where}, {check}, {kind.dimensions}, {' | '.join(flags)})) return 0;",
        f"    {c_type(kind)} {into} = {{(void *){object_}->data, {{{shape}}}{steps}}};",
    ]


def _number(into: str, where: str, kind: NumberType) -> list[str]:
    if kind.name == "bool":
        return [f"    int {into} = PyObject_IsTrue({where});", f"    if ({into} < 0) return 0;"]
    function = "PyFloat_AsDouble" if kind.name == "float64" else "PyLong_AsLongLong"
    return [
        f"    {c_type(kind)} {into} = {function}({where});",
        f"    if ({into} == -1 && PyErr_Occurred()) return 0;",
    ]


def _result(kind: Kind) -> list[str]:
    if kind == NumberType("void"):
        return ["    Py_IncRef(&_Py_NoneStruct);", "    return &_Py_NoneStruct;"]
    lines: list[str] = []
    made = _made(kind, "result", lines)
    return [*lines, f"    return {made};"]


def _made(kind: Kind, text: str, lines: list[str]) -> str:
    """A Python object of a result; what has to be done before is added to `lines`."""
    if isinstance(kind, NumberType):
        makers = {"bool": "PyBool_FromLong", "float64": "PyFloat_FromDouble", "uint64": "PyLong_FromUnsignedLongLong"}
        return f"{makers.get(kind.name, 'PyLong_FromLongLong')}({text})"
    if isinstance(kind, ArrayType):
        raise TypeError("a kernel returns numbers; arrays are passed to it to be written")
    made = text.replace(".", "_") + "_tuple"
    lines.append(f"    PyObject *{made} = PyTuple_New({len(kind.kinds)});")
    lines.append(f"    if (!{made}) return 0;")
    for m, one in enumerate(kind.kinds):
        lines.append(f"    PyTuple_SetItem({made}, {m}, {_made(one, f'{text}.m{m}', lines)});")
    return made
