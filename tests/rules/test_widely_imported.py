"""Widely imported names: what more than 20 modules of other folders import stands in a file of that subject.

`RecordingError` was in `mcap_writer.py` once, and whoever read a file of any kind imported the writer. Such a name is a
word of the whole house. It belongs into a file that is about it, where it is listed here: a new one is moved there, or
what needs it so often is looked at.
"""

from collections import defaultdict
from collections.abc import Mapping, Set

from tests.rules.rooms import HOUSES
from tests.support.source_files import ROOT, facts_of, python_files

MAX_IMPORTERS = 20  # modules of other folders
STILL_MANY = 10  # with fewer, a name leaves the list
LISTED: Mapping[str, tuple[str, str]] = {
    "protocols/arrays.py": ("Array Bytes Floats Ints", "types of arrays"),
    "protocols/commands/transactions.py": ("DeviceContext Values", "what a driver is asked to do, and of which device"),
    "protocols/events.py": ("Batch Event Reply", "what decoders give"),
    "protocols/native/kernels.py": ("INT INTS compiled", "declaration of a function that is compiled"),
    "protocols/registry/families.py": ("PROTOCOLS", "the families by name"),
    "protocols/schema/fields.py": ("Field Message", "rows of the tables"),
    "protocols/schema/plural.py": ("counted", "a number with its noun"),
    "recordings/columns/store.py": ("ColumnStore", "the columns of a recording"),
    "recordings/errors.py": ("RecordingError", "errors of files"),
    "recordings/system/regular_file.py": ("open_regular", "opening a file that cannot block"),
    "server/concurrency/tasks.py": ("end_tasks", "the end of tasks"),
    "server/devices/decode/decode_options.py": ("DecodeOptions", "how the bytes of a source are read"),
    "server/errors.py": ("DomainError UsageError", "errors of requests and commands"),
    "server/links/base.py": ("LinkError", "what every kind of link has"),
    "server/services/services.py": ("Services", "the parts of a running server"),
    "server/settings/config.py": ("Config", "the settings of a server"),
    "server/wire/__init__.py": ("ChannelInfo", "messages of the wire"),
}
"""File: its names that are imported so often, and the subject of the file."""


def importers() -> Mapping[tuple[str, str], Set[str]]:
    """Files that import a name, by the file it stands in and the name; those of the same folder are left out."""
    files = python_files(*HOUSES)
    modules = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in files}
    result: dict[tuple[str, str], set[str]] = defaultdict(set)
    for path in files:
        for _, imported in facts_of(path).imports:
            module, _, name = imported.rpartition(".")
            home = modules.get(module)
            if home is not None and imported not in modules and home.parent != path.parent:
                result[home.relative_to(ROOT).as_posix(), name].add(path.relative_to(ROOT).as_posix())
    return result


def test_a_widely_imported_name_stands_where_its_subject_is() -> None:
    results = importers()
    listed = {(file, name) for file, (names, _) in LISTED.items() for name in names.split()}
    wrong = [
        f"{name} of {file}: {len(files)} modules import it"
        for (file, name), files in results.items()
        if len(files) > MAX_IMPORTERS and (file, name) not in listed
    ]
    assert not wrong, "\n".join([*wrong, "Move it to a file of that subject, and list it there."])
    gone = [f"{name} of {file}" for file, name in listed if len(results.get((file, name), ())) <= STILL_MANY]
    assert not gone, f"no longer needed in the list: {', '.join(sorted(gone))}"
