"""Mistakes with the Python library: whatever a public function is given, it returns or raises ImuscopeError."""

import inspect
import io
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosedError, InvalidHandshake

import imuscope
from imuscope import Calibration, ImuscopeError, Recording, Server, Signal

ODD = (None, 7, -1, math.nan, 1e300, "", "nope", "\0", b"x", ["nope"], {1: 2}, object(), np.arange(3), slice(1, 2, 3))
"""Each in place of each argument."""
EXAMPLES = {
    **{"name": "gyr", "analysis": "statistics", "kind": "gyroscope", "out": "x.csv", "address": "http://127.0.0.1:9"},
    **{"unit": "°/s", "units": "SI", "begin": 0, "end": 1, "rows": slice(0, 2)},
}


class Connection:
    """A connection to a server without devices, which ends after what it sends."""

    def __init__(self, *more: dict[str, Any]) -> None:
        self._messages = [{"op": "hello", "version": "1"}, {"op": "devices", "devices": []}, *more]

    def recv(self, _: float | None) -> str:
        if not self._messages:
            raise ConnectionClosedError(None, None)
        return json.dumps(self._messages.pop(0))

    def send(self, _: str) -> None:
        if not self._messages:
            raise ConnectionClosedError(None, None)

    def close(self) -> None:
        pass


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)  # some exports succeed
    path = tmp_path / "walk.csv"
    rows = (f"{1.5e9 + k / 100:.2f},{k / 7},{k},0" for k in range(60))
    path.write_text("\n".join(["time (s),gyr_x (rad/s),gyr_y (rad/s),gyr_z (rad/s)", *rows]))
    return path


def public_calls(recording: Recording) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Every public function, and every method of an object of every public class that has some."""
    signal = recording["gyr"]
    zeros, ones = np.zeros(3), np.eye(3)
    calibration = Calibration("gyroscope", "", "gyr", "rad/s", zeros, zeros, ones, 0.0, "", {}, ())
    objects = (recording, signal, calibration, Server(cast(Any, Connection()), "shown"))
    for name in imuscope.__all__:
        made = getattr(imuscope, name)
        if not inspect.isclass(made):
            yield name, made
            continue
        methods = [key for key, value in vars(made).items() if inspect.isfunction(value) and not key.startswith("_")]
        methods += ["__getitem__"] if made in (Recording, Signal) else []
        of = next((one for one in objects if type(one) is made), None)
        assert of is not None or not methods, f"{name} needs an object here"
        yield from ((f"{name}.{key}", getattr(of, key)) for key in methods if key not in ("close", "keys"))


def arguments_with(
    call: Callable[..., Any], odd: inspect.Parameter, value: Any, usual: dict[str, Any]
) -> tuple[list[Any], dict[str, Any]]:
    """The usual arguments of a function, but one."""
    words: list[Any] = []
    options: dict[str, Any] = {}
    for one in inspect.signature(call).parameters.values():
        if one.kind is one.VAR_POSITIONAL:
            words += [value] if one == odd else []
        elif one.kind is one.VAR_KEYWORD:
            options |= {"nope": value} if one == odd else {}
        elif one == odd or one.default is one.empty:
            argument = value if one == odd else usual[one.name]
            (options.__setitem__(one.name, argument) if one.kind is one.KEYWORD_ONLY else words.append(argument))
    return words, options


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_wrong_arguments_raise_nothing_else(table: Path) -> None:
    wrong = []
    with imuscope.open(table) as recording:
        usual = {**EXAMPLES, "path": table, "other": recording, "signal": recording["gyr"]}
        for name, call in public_calls(recording):
            for parameter in inspect.signature(call).parameters.values():
                for value in ODD:
                    words, options = arguments_with(call, parameter, value, usual)
                    try:
                        made = call(*words, **options)
                    except ImuscopeError:
                        continue
                    except Exception as error:
                        wrong.append(f"{name}({parameter.name}={value!r:.20}): {type(error).__name__}: {error}")
                    else:
                        if isinstance(made, Recording):
                            made.close()
            with pytest.raises(ImuscopeError):
                call(nope=1)
    assert not wrong, "\n".join(wrong)


def test_the_cause_of_a_wrong_argument_is_named(table: Path) -> None:
    with (
        imuscope.open(table) as recording,
        pytest.raises(ImuscopeError, match=r"export\(out='x.csv', begin_s='now'\)") as raised,
    ):
        recording.export("x.csv", begin_s=cast(Any, "now"))
    assert isinstance(raised.value.__cause__, TypeError)  # a defect of ours stays visible


def test_an_open_file_is_a_recording(table: Path) -> None:
    with imuscope.open(table) as recording:
        expected = recording["gyr"].values
    with table.open("rb") as file, imuscope.open(file) as recording:
        assert recording.path.name == "walk.csv"
        np.testing.assert_array_equal(recording["gyr"].values, expected)
        copy = recording.path
    assert not copy.exists()
    with imuscope.open(io.BytesIO(table.read_bytes())) as recording:
        np.testing.assert_array_equal(recording["gyr"].values, expected)
        assert recording.export("all.csv")
    with pytest.raises(ImuscopeError, match="bytes-like"):
        imuscope.open(cast(Any, io.StringIO("time,x")))


def test_a_closed_recording_raises_nothing_else(table: Path) -> None:
    recording = imuscope.open(table)
    recording.close()
    with pytest.raises(ImuscopeError):
        recording["nope"]
    assert len(recording["gyr"].values) == 60


def test_a_choice_that_the_file_leaves_open_is_named(table: Path) -> None:
    with imuscope.open(table) as recording:
        with pytest.raises(ImuscopeError, match="no samples; name signals that have some"):
            recording.to_pandas(recording["gyr"][0:0])
        recording.signals *= 2  # as of two messages
        with pytest.raises(ImuscopeError, match=r"several signals 'gyr': from walk of walk, .*Use `signals`"):
            recording["gyr"]


def test_the_end_of_a_connection_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    refusal = {"op": "error", "message": "Too many clients.", "hint": "Close one."}
    for more, words in (((refusal,), "Too many clients. Close one."), (({"op": "x"},), "The connection has ended")):
        with pytest.raises(ImuscopeError, match=words):
            next(Server(cast(Any, Connection(*more)), "shown").stream())
    with pytest.raises(ImuscopeError, match="The connection is closed: connect again"):
        next(Server(cast(Any, Connection()), "shown").stream())

    def refuse(*_: object, **__: object) -> None:
        raise InvalidHandshake("HTTP 401")

    monkeypatch.setattr("websockets.sync.client.connect", refuse)
    with pytest.raises(ImuscopeError, match=r"or refuses: HTTP 401\. Give its token: connect\(…, token=…\)"):
        imuscope.connect("http://robot.local")
