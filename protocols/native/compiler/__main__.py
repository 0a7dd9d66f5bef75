"""`python -m imuscope.protocols.native.compiler [PACKAGE]`: build machine code of a package's kernels."""

import sys
from pathlib import Path

from imuscope.protocols.native.compiler.build import BuildError, build
from imuscope.protocols.native.compiler.expressions import TranslateError
from imuscope.protocols.native.kernels import library_folder


def main(arguments: list[str]) -> int:
    """The command line."""
    package = arguments[0] if arguments else "imuscope"
    try:
        folder = library_folder(package)
        if folder is None:
            raise BuildError(f"There is no package {package}.")
        built = build(package, Path(folder))
    except (BuildError, TranslateError) as error:
        print(f"imuscope: {error}", file=sys.stderr)
        return 1
    sizes = ", ".join(f"{path.name} {path.stat().st_size // 1000} kB" for path in sorted(folder.glob("*.so")))
    print(f"{folder.parent.name}/native: {'built' if built else 'fresh'}: {sizes}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
