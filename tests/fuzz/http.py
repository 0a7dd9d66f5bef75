"""Fuzzing of the HTTP API against /openapi.json.

    /openapi.json ──> schemathesis: a request of each operation, right or nearly
                          │  ids of what is there · values drawn from the forms of the devices
                          v
                      the server, a process with simulators and a folder of its own
                          │
                          v   never 500, never silent for `PATIENCE_S`, a status that is declared, a body of its
                              schema, errors as {kind, message, hint}; nothing in the log, memory within bounds

What schemathesis draws is right for the schema, but of devices that are not there and of settings that no device has:
it ends at the first question of a route. So identifiers are mostly replaced by ones that exist, and the values of
`preview`, `apply`, `run`, `fit-rates` are drawn from the forms that the server itself gives, with hostile ones among
them.

The same seed draws the same requests; answers depend on what was there before, so a finding is kept as the request
alone, and replayed against a fresh server: findings/http/*.json. Nothing here can shrink it: requests are small.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import requests
import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.errors import HypothesisException
from schemathesis import GenerationMode
from schemathesis.checks import CHECKS, load_all_checks

from tests.fuzz.cases import BrokenError, write_json
from tests.support.processes import resident_mb
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S  # a longer time counts as no answer
from tests.support.waiting import block_until

MAX_GROWN_MB = 400.0  # growth of the server's memory over all requests
SIMULATORS = tuple(
    f"sim:{family}?rate=10" for family in ("xbus", "isb", "idtp")
)  # slow ones: they only have to be there
TIDY_EVERY = 40
MAX_DEVICES = 6
SLOW = {"/api/ports/scan"}  # listens for seconds, as it should
PROMISES = ("status_code_conformance", "content_type_conformance", "response_schema_conformance")
FORMED = re.compile(r"/api/devices/\{device\}/(preview|apply|run|fit)\Z")

ODD: list[Any] = [
    None, True, -1, 0, 1, 255, 256, 65_536, 2**31, 2**32, 2**53 + 1, 2**63, 2**64, -(2**63) - 1, 10**400, 1.5, -0.0,
    1e308, float("nan"), float("inf"), "", "0", "1e3", "x" * 300, "\ud800", "\x00", "∞", [], {}, [[[]]], {"": None},
    [None], ["x"], [1, 2, 3], {"x": 2**70},
]  # fmt: skip
"""What a field is told that was made for something else."""


@dataclass(frozen=True)
class HttpRequest:
    """A request as it went out, and how it is kept.

    Args:
        body: of a JSON body the text; None: no body.
    """

    method: str
    path: str
    body: str | None = None
    headers: dict[str, str] = field(default_factory=dict)

    def write(self, name: str, showed: str) -> Path:
        """Keep it."""
        return write_json("http", name, showed, asdict(self))

    @staticmethod
    def read(path: Path) -> HttpRequest:
        """One that was kept."""
        document = json.loads(path.read_text())
        return HttpRequest(document["method"], document["path"], document["body"], document["headers"])


class FuzzedServer:
    """The tested server: three simulators and one recording named R, restored after changes.

    Raises:
        BrokenError: from `check`: it ended, logged an error or its memory grew.
    """

    def __init__(self, data: Path) -> None:
        self.process = ServerProcess(*SIMULATORS, data=data, timeout_s=300)  # the first start ever compiles
        self.url = self.process.url
        self.session = requests.Session()
        self._since = resident_mb(self.process.process.pid)
        self._logged = 0

    def __enter__(self) -> FuzzedServer:
        self.get_ready()
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()
        self.process.stop()

    def get_ready(self) -> None:
        """A recording that can be opened, and simulators that have been recognised."""
        rows = "".join(f"{1760000000 + i / 100:.2f},{i % 7},{i % 5}\n" for i in range(400))
        table = f"time (s),Acceleration.x (m/s²),Acceleration.y (m/s²)\n{rows}"
        self.session.put(
            f"{self.url}/api/recordings/upload?name=R.csv",
            data=table.encode(),
            headers={"content-type": "application/octet-stream"},
            timeout=PATIENCE_S,
        ).raise_for_status()

        def recognised() -> Any:
            devices = self.read("/api/devices")
            return len(devices) == len(SIMULATORS) and all(device["protocol"] for device in devices) and devices

        devices = block_until(recognised, "the simulators are recognised")
        self.forms = [self.read(f"/api/devices/{device['id']}/forms") for device in devices]
        self.read_names()

    def read(self, path: str) -> Any:
        """Answer of a path."""
        return self.session.get(self.url + path, timeout=PATIENCE_S).json()

    def read_names(self) -> None:
        """Path parameters: identifiers that currently exist."""
        devices = [device["id"] for device in self.read("/api/devices")]
        recordings = [one["id"] for one in self.read("/api/recordings")]
        jobs = [str(one["id"]) for one in self.read("/api/recordings/exports")]
        self.names = {"device": devices or ["1"], "recording": recordings or ["R"], "job": jobs or ["1"]}

    def tidy(self) -> None:
        """Simulators there again, the rest away."""
        devices = self.read("/api/devices")
        there = {device["source"] for device in devices}
        for device in devices:
            if device["source"] not in SIMULATORS and len(devices) > MAX_DEVICES:
                self.session.delete(f"{self.url}/api/devices/{device['id']}", timeout=PATIENCE_S)
        for simulator in SIMULATORS:
            if simulator not in there:
                self.session.post(f"{self.url}/api/devices", json={"source": simulator}, timeout=PATIENCE_S)
        self.session.post(f"{self.url}/api/recordings/stop", timeout=PATIENCE_S)
        for job in self.read("/api/recordings/exports")[4:]:
            self.session.delete(f"{self.url}/api/recordings/exports/{job['id']}", timeout=PATIENCE_S)
        self.read_names()

    def request(self, question: HttpRequest, again: bool = True) -> requests.Response:
        """Send a request.

        Raises:
            BrokenError: no answer. A kept connection may end just when it is used again: then it is asked once more.
        """
        body = None if question.body is None else question.body.encode("utf-8", "surrogatepass")
        try:
            return self.session.request(
                question.method,
                self.url + question.path,
                data=body,
                headers=question.headers,
                timeout=PATIENCE_S,
                allow_redirects=False,
            )
        except requests.Timeout:
            raise BrokenError("hang", f"no answer for {PATIENCE_S:g} s") from None
        except requests.ConnectionError as error:
            if again:
                return self.request(question, again=False)
            raise BrokenError("cut", f"the connection ended: {error!s:.200}") from None

    def check(self) -> None:
        """Is it well?"""
        if self.process.process.poll() is not None:
            raise BrokenError("ended", self.process.log[-2000:])
        log = self.process.log
        fresh, self._logged = log[self._logged :], len(log)
        if "Traceback" in fresh:
            raise BrokenError("traceback", fresh[-3000:])
        grown = resident_mb(self.process.process.pid) - self._since
        if grown > MAX_GROWN_MB:
            raise BrokenError("memory", f"it has grown by {grown:.0f} MB")


def check_error(response: requests.Response) -> None:
    """Has an error the one shape?

    Raises:
        BrokenError: it has not.
    """
    if response.status_code == 500:
        raise BrokenError("500", response.text[:400])
    if response.status_code < 400:
        return
    try:
        body = response.json()
    except ValueError:
        raise BrokenError("shape", f"{response.status_code} is not JSON: {response.text[:200]!r}") from None
    if set(body) != {"kind", "message", "hint"} or not all(isinstance(value, str) for value in body.values()):
        raise BrokenError("shape", f"{body!s:.300}")
    if not re.fullmatch(r"[a-z]+(-[a-z]+)*", body["kind"]):
        raise BrokenError("shape", f"kind {body['kind']!r:.80}")
    if not body["message"].strip() or body["message"][-1] not in ".?!…":
        raise BrokenError("shape", f"message {body['message']!r:.300}")


# -- what is drawn -----------------------------------------------------------------------------------------------------


def _leaf(form: dict[str, Any]) -> st.SearchStrategy[Any]:
    """A value of a field: valid, at a limit, or of another type."""
    odd = st.sampled_from(ODD)
    if form["fields"]:
        record = st.fixed_dictionaries({}, optional={part["name"]: _leaf(part) for part in form["fields"]})
        return st.one_of(record, st.lists(record, max_size=40) if form["editor"] == "list" else record, odd)
    known = [int(key) for key in form["choices"]] + ([] if form["default"] is None else [form["default"]])
    edges = [value for value in (form["low"], form["high"]) if value is not None]
    edges += [round(value) for value in edges] + [value + 1 for value in edges] + [value - 1 for value in edges]
    fits = st.sampled_from(known + edges) if known or edges else st.integers(0, 3) | st.text(max_size=8)
    if form["editor"] == "vector" or form["length"]:
        fits = fits | st.lists(st.floats(-2, 2) | odd, max_size=10)
    if form["editor"] == "hex":
        fits = fits | st.binary(max_size=40).map(bytes.hex)
    return st.one_of(fits, fits, fits, odd)


def _values(fields: list[dict[str, Any]]) -> st.SearchStrategy[dict[str, Any]]:
    some = st.fixed_dictionaries({}, optional={form["name"]: _leaf(form) for form in fields})
    all_of = st.fixed_dictionaries({form["name"]: _leaf(form) for form in fields})
    return some | all_of


@st.composite
def formed(draw: st.DrawFn, route: str, forms: list[dict[str, Any]]) -> dict[str, Any]:
    """A body of `preview`, `apply`, `run` or `fit-rates` with settings and commands that devices have."""
    form = draw(st.sampled_from([form for form in forms if form["settings"] or form["commands"]]))
    setting = draw(st.sampled_from(form["settings"])) if form["settings"] else None
    command = draw(st.sampled_from(form["commands"])) if form["commands"] else None
    if route == "apply" and setting:
        changes = {setting["name"]: draw(_values(setting["fields"]))}
        return {"changes": changes, "confirmed": draw(st.booleans()), "reason": "drawn"}
    if (route == "run" or (route == "preview" and draw(st.booleans()))) and command:
        body = {"command": command["name"], "values": draw(_values(command["arguments"]))}
        return {**body, "confirmed": draw(st.booleans())} if route == "run" else body
    name = setting["name"] if setting else "Nothing"
    body = {"setting": name, "values": draw(_values(setting["fields"])) if setting else {}}
    return (
        {**body, "baud": draw(st.sampled_from([None, 9600, 0, -1, 2**40, 921_600]))} if route == "fit-rates" else body
    )


@st.composite
def requests_of(draw: st.DrawFn, operation: Any, mode: GenerationMode, server: FuzzedServer) -> tuple[Any, HttpRequest]:
    """A request of an operation, as schemathesis' case and as it is sent."""
    case = draw(operation.as_strategy(generation_mode=mode))
    names = server.names
    for name in case.path_parameters or {}:
        if name in names and draw(st.integers(0, 9)):
            case.path_parameters[name] = draw(st.sampled_from(names[name]))
    if not all(str(value) for value in (case.path_parameters or {}).values()):
        case.path_parameters = {name: str(value) or "0" for name, value in case.path_parameters.items()}
    hit = FORMED.match(operation.path)
    own = None
    if hit and draw(st.integers(0, 3)):
        own = draw(formed(hit[1], server.forms))
    sent = case.as_transport_kwargs(base_url=server.url)
    if own is not None:
        sent = {**sent, "json": own}
        sent.pop("data", None)
    return case, _request_of(sent, server.url)


def _request_of(sent: dict[str, Any], url: str) -> HttpRequest:
    prepared = requests.Request(sent["method"], sent["url"], params=sent.get("params")).prepare()
    assert prepared.url is not None
    headers = {name: str(value) for name, value in dict(sent.get("headers") or {}).items()}
    headers = {name: value for name, value in headers.items() if name.lower() in ("content-type", "accept")}
    body: str | None = None
    if "json" in sent:
        body = json.dumps(sent["json"])
        headers["Content-Type"] = "application/json"
    elif isinstance(data := sent.get("data"), bytes | str) and data:
        body = data.decode("utf-8", "replace") if isinstance(data, bytes) else data
    return HttpRequest(sent["method"], prepared.url.removeprefix(url), body, headers)


# -- the run -----------------------------------------------------------------------------------------------------------


class RequestSearch:
    """Requests of every operation in rounds.

    Args:
        server: the tested server.
        first: the seed.
    """

    def __init__(self, server: FuzzedServer, first: int) -> None:
        load_all_checks()
        self.server = server
        self.cases = 0
        self.statuses: dict[int, int] = {}
        self.round = 0
        self._nothing: set[tuple[int, GenerationMode]] = set()
        self._first = first
        self._checks = CHECKS.get_by_names(list(PROMISES))
        schema = schemathesis.openapi.from_dict(server.read("/openapi.json"))
        self.operations = [result.ok() for result in schema.get_all_operations()]

    def step(
        self, examples: int, *, slow: bool = False, quick: bool = False
    ) -> Iterator[tuple[HttpRequest, BrokenError]]:
        """One round: so many requests of every operation, right ones and wrong ones; gives what broke.

        Args:
            slow: also what takes seconds.
            quick: only of every third operation, and of these right and wrong ones in turn.
        """
        self.round += 1
        for number, operation in enumerate(self.operations):
            if operation.path in SLOW and not slow:
                continue
            for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
                left_out = quick and number % 6 != (0 if mode is GenerationMode.POSITIVE else 3)
                if left_out or (number, mode) in self._nothing:
                    continue
                yield from self._some(number, mode, examples)

    def _some(self, number: int, mode: GenerationMode, examples: int) -> list[tuple[HttpRequest, BrokenError]]:
        broken: list[tuple[HttpRequest, BrokenError]] = []

        @seed(self._first + 1000 * self.round + number)
        @settings(
            max_examples=examples,
            phases=(Phase.generate,),
            database=None,
            deadline=None,
            derandomize=False,
            suppress_health_check=[check for check in HealthCheck if check is not HealthCheck.filter_too_much],
        )
        @given(requests_of(self.operations[number], mode, self.server))
        def one(drawn: tuple[Any, HttpRequest]) -> None:
            case, request = drawn
            try:
                self._judge(case, request)
            except BrokenError as error:
                broken.append((request, error))

        try:
            one()
        except (HypothesisException, schemathesis.errors.SchemathesisError):
            self._nothing.add((number, mode))  # an operation without parameters has no wrong input
        return broken

    def _judge(self, case: Any, request: HttpRequest) -> None:
        self.cases += 1
        if self.cases % TIDY_EVERY == 0:
            self.server.tidy()
        response = self.server.request(request)
        self.statuses[response.status_code] = self.statuses.get(response.status_code, 0) + 1
        check_error(response)
        self.server.check()
        try:
            case.validate_response(response, checks=self._checks)
        except AssertionError as error:
            raise BrokenError("promise", f"{error!s:.1500}") from None
        except schemathesis.errors.SchemathesisError as error:
            raise BrokenError("promise", f"{type(error).__name__} {error!s:.1500}") from None
        except BaseExceptionGroup as errors:
            raise BrokenError("promise", " | ".join(f"{error!s:.700}" for error in errors.exceptions)) from None
