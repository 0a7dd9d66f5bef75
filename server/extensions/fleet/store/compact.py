"""Small files of a store joined into larger ones, while uploads and questions go on.

Every upload adds a file to each table. Rows and identifiers of uploads stay as they are. The files that were joined
stay too, for readers that opened them, until files are removed that no commit of the last week needs; those of an
upload that was cut off are among them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from deltalake import CommitProperties, PostCommitHookProperties

from imuscope.server.extensions.fleet.store.delta_dataset import check_readable
from imuscope.server.extensions.fleet.store.delta_tables import TARGET_BYTES, open_table, writer_properties
from imuscope.server.extensions.fleet.store.store import StoreLocation, storage_errors
from imuscope.server.extensions.fleet.store.tables import TABLES

KEPT_HOURS = 7 * 24
MAX_TASKS = 2  # at once: each holds the rows of a partition


@dataclass(frozen=True, slots=True)
class CompactedTable:
    """A table after its files were joined.

    Args:
        joined: number of files that were joined.
        into: number of files that they became.
        removed: number of files that were removed.
    """

    name: str
    joined: int
    into: int
    removed: int


def compact(store: StoreLocation, *, remove: bool) -> Iterator[CompactedTable]:
    """Join the files of each table of a store, one table after the other.

    Args:
        remove: whether files that nothing needs any more are removed.

    Raises:
        StoreError: the store cannot be written.
    """
    keeps_log = PostCommitHookProperties(cleanup_expired_logs=False)  # by it, uploads find what they wrote
    for name in TABLES:
        table = open_table(store, name)
        if table is None:
            continue
        check_readable(store, table)
        with storage_errors(store):
            done = table.optimize.compact(
                target_size=TARGET_BYTES,
                max_concurrent_tasks=MAX_TASKS,
                writer_properties=writer_properties(),
                commit_properties=CommitProperties(custom_metadata={"imuscope": "compact"}),
                post_commithook_properties=keeps_log,
            )
            if done["numFilesRemoved"]:
                table.create_checkpoint()
            removed = (
                table.vacuum(KEPT_HOURS, dry_run=False, full=True, post_commithook_properties=keeps_log)
                if remove
                else []
            )
        yield CompactedTable(name, done["numFilesRemoved"], done["numFilesAdded"], len(removed))
