"""Commands of the fleet, run with their options: `upload`, `query`, `compact`, `fleet`."""

from __future__ import annotations

import argparse
import sys

from imuscope.server.commands.common import (
    UsageError,
    checked_protocol,
    decode_options_of,
    readable,
    seekable,
    size_of,
    warn_if_interpreted,
)


def upload(options: argparse.Namespace) -> None:
    """Run `imuscope upload`."""
    file = readable(options.file)
    decode_options = decode_options_of(options)
    warn_if_interpreted(size_of(file))
    from imuscope.server.extensions.fleet.upload_command import UploadError, UploadRequest, upload_file

    decode_options = checked_protocol(decode_options)
    try:
        with seekable(file) as path:
            request = UploadRequest(options.store, options.robot)
            print(upload_file(path, options.file, decode_options, request, sys.stderr))
    except UploadError as error:
        raise UsageError(str(error)) from None


def query(options: argparse.Namespace) -> None:
    """Run `imuscope query`."""
    from imuscope.server.extensions.fleet.query_command import QueryCommandError, QueryRequest, answer, question_of

    try:
        sql = question_of(options.sql, options.question or "")
        if options.show:
            print(sql)
            return
        sql = sys.stdin.read() if sql == "-" else sql
        request = QueryRequest(options.store, sql, options.format, options.memory, options.timeout)
        answer(request, sys.stdout, sys.stdout.buffer)
    except QueryCommandError as error:
        raise UsageError(str(error)) from None


def compact(options: argparse.Namespace) -> None:
    """Run `imuscope compact`."""
    from imuscope.server.extensions.fleet.compact_command import CompactError, compact_store

    try:
        compact_store(options.store, options.remove_unused, sys.stdout)
    except CompactError as error:
        raise UsageError(str(error)) from None


def fleet(options: argparse.Namespace) -> None:
    """Run `imuscope fleet`."""
    from imuscope.server.extensions.fleet.fleet_command import serve_fleet

    serve_fleet(options)
