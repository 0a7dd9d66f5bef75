"""Commands on a store of recordings, run with their options: `upload`, `query`, `compact`."""

import argparse
import contextlib
import sys
from collections.abc import Iterator
from dataclasses import asdict

from imuscope.protocols.schema.plural import counted
from imuscope.server.commands.common import file_to_decode, seekable
from imuscope.server.errors import UsageError
from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS
from imuscope.server.extensions.fleet.store.store import MISSING, PACKAGES, location
from imuscope.server.text.printable import json_text


@contextlib.contextmanager
def _packages() -> Iterator[None]:
    """Raise UsageError where the packages of a store are not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name not in PACKAGES:
            raise
        raise UsageError(MISSING) from None


def upload(options: argparse.Namespace) -> None:
    """Run `imuscope upload FILE --store URL --robot NAME`.

    Raises:
        UsageError, StoreError, RecordingError, DomainError: the file cannot be read, or the store cannot be used.
    """
    file, decode_options = file_to_decode(options)
    from imuscope.server.commands.decode import Bar

    bar = Bar(sys.stderr)
    try:
        with seekable(file) as path:
            store = location(options.store)
            with _packages():
                from imuscope.server.extensions.fleet.upload.upload import upload as upload_file

                made = upload_file(path, store, options.robot, decode_options, bar.show)
    except OSError as error:
        raise UsageError(f"{options.file}: {(error.strerror or 'it cannot be read').lower()}") from None
    finally:
        bar.clear()
    url = f"{store.url.rstrip('/')}/{made.key}"
    if options.format == "json":
        print(json_text({"file": str(options.file), "object": url, "is_new": made.is_new}))
        return
    print(f"{options.file} {'uploaded' if made.is_new else 'was uploaded before'}: {url}")


def query(options: argparse.Namespace) -> None:
    """Run `imuscope query --store URL "SELECT …"`.

    Raises:
        UsageError, StoreError: the question is not valid, or the store cannot be read.
    """
    if options.question and options.sql:
        raise UsageError("give SQL, or --question with the name of a prepared one, not both")
    sql = QUESTIONS[options.question].sql if options.question else options.sql
    if options.show:
        print(sql)
        return
    sql = sys.stdin.read() if sql == "-" else sql
    if not 0 <= options.timeout <= 1e6:
        raise UsageError(f"--timeout {options.timeout:g} is not a time in seconds; 0 means no limit")
    if not 64 <= options.memory <= 1 << 24:
        raise UsageError(f"--memory {options.memory} is outside 64 … {1 << 24} MB")
    with _packages():
        from imuscope.server.extensions.fleet.query.query import QueryLimits, run_query
        from imuscope.server.extensions.fleet.query.results import write_arrow, write_csv, write_json, write_table
    store = location(options.store)
    if store.folder is not None and not store.folder.is_dir():
        raise UsageError(f"{store.folder} does not exist; give the folder of a store")
    with run_query(store, sql, QueryLimits(options.memory, options.timeout)) as reader:
        match options.format:
            case "arrow":
                write_arrow(reader, sys.stdout.buffer)
            case "json":
                write_json(reader, sys.stdout)
            case "csv":
                write_csv(reader, sys.stdout)
            case _:
                write_table(reader, sys.stdout)


def compact(options: argparse.Namespace) -> None:
    """Run `imuscope compact --store URL`; a line, or a line of JSON, for each table.

    Raises:
        UsageError, StoreError: the store cannot be used.
    """
    with _packages():
        from imuscope.server.extensions.fleet.store.compact import compact as compact_store
    for one in compact_store(location(options.store), remove=options.remove_unused):
        words = f"{counted(one.joined, 'file')} joined into {one.into}" if one.joined else "nothing to join"
        if options.format == "json":
            print(json_text(asdict(one)), flush=True)
            continue
        more = f", {counted(one.removed, 'file')} removed" if options.remove_unused else ""
        print(f"{one.name}: {words}{more}", flush=True)
