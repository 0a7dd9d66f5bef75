"""Translation of kernels (protocols/native/kernels.py) to machine code, when a package is built.

expressions.py      typed expressions, and what operators are in C
translate.py   the text of a kernel, with types inferred from its signature
extension.py   the Python module around it: checks of arguments, results
build.py       the libraries, one per kind of processor, by the C compiler of the package `ziglang`
"""
