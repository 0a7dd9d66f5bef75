"""During every flood the server answers, and the recording of another device is complete.

One server with one device that streams all the while, and is recorded; then one flood after the other
(tests/fault_injection/floods.py), each until the server has answered beside it; in tests/bench/floods.py for as long as
one likes.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fault_injection.beside import ANSWERS, Beside, Watched, watched
from tests.fault_injection.floods import FLOODS
from tests.support.each_row import each_row

MOST_S = 6.0  # of the server's processor time until an answer, with all that it does beside; it takes up to 1.7 s


@pytest.fixture(scope="module")
def there(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    folder: Path = tmp_path_factory.mktemp("flooded")
    with watched(folder) as result:
        yield result


@each_row("name", FLOODS)
def test_beside_a_flood_the_server_answers_and_another_recording_is_whole(name: str, there: Watched) -> None:
    with Beside(there) as beside:
        there.place.lasts = beside.some_answers
        FLOODS[name](there.place)
    assert not beside.failed
    assert beside.answers >= ANSWERS
    assert beside.most_s <= MOST_S
    assert there.is_whole()
