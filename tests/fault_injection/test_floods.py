"""During every flood the server answers within a second, and the recording of another device is complete.

One server with one device that streams all the while, and is recorded; then one flood after the other
(tests/fault_injection/floods.py), each for a quarter of a second here, for as long as one likes in
tests/bench/floods.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.each_row import each_row
from tests.fault_injection.beside import Beside, Watched, watched
from tests.fault_injection.floods import FLOODS

SECONDS = 0.25


@pytest.fixture(scope="module")
def there(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    folder: Path = tmp_path_factory.mktemp("flooded")
    with watched(folder, SECONDS) as found:
        yield found


@each_row("name", FLOODS)
def test_beside_a_flood_the_server_answers_and_another_recording_is_whole(name: str, there: Watched) -> None:
    with Beside(there.place.url) as beside:
        FLOODS[name](there.place)
    assert beside.worst_s <= beside.limit_s, f"{beside.worst_s:.2f} s, where a second is {beside.limit_s:.2f} s"
    assert there.is_whole()
