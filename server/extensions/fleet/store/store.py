"""Location of a store, and its errors as text.

    /data/store, file:///data/store     a folder
    s3://bucket/prefix                  anything that speaks S3: AWS_ENDPOINT_URL, AWS_ACCESS_KEY_ID, AWS_REGION, …
    az://container/prefix, gs://bucket/prefix    AZURE_STORAGE_ACCOUNT_NAME, GOOGLE_SERVICE_ACCOUNT, …

Credentials come from the environment, or from the machine's role, never from the URL: it is printed and logged.

Requests that time out or are answered by 5xx are repeated with growing pauses by the libraries, for RETRY_S at most.
"""

import importlib.util
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from imuscope.recordings.errors import ExplainedError
from imuscope.server.extensions.fleet.model.settings import STORE_FORMS, FleetTables
from imuscope.server.extensions.fleet.tunnel.bandwidth_proxy import LimitedLine
from imuscope.server.settings.config import Config

RETRY_S = 60
MAX_RETRIES = 8
CONNECT_S = 10
REQUEST_S = 60
CLOUDS = {"s3": "AWS", "s3a": "AWS", "az": "AZURE", "abfs": "AZURE", "abfss": "AZURE", "gs": "GOOGLE"}
IN_FLIGHT = 64 << 20  # bytes that requests of one upload may have to send at once
MISSING = "a store needs further packages; install them with: pip install 'imuscope[fleet]'"
PACKAGES = ("deltalake", "obstore", "duckdb")


_NOT_IN_A_PATH = re.compile(r"[\[\]^|\\]|%[0-9A-Fa-f]{2}")
"""In the path of a folder: delta-rs reads it as a URL, in which these have no place or mean another character."""


class StoreError(ExplainedError):
    """A store that cannot be used: one sentence without a full stop, and what to do."""

    @property
    def text(self) -> str:
        return f"{self.message.rstrip('.')}. {self.hint}".strip()


@dataclass(frozen=True, slots=True)
class StoreLocation:
    """A store's place.

    Args:
        url: for people and for the libraries; of a folder its absolute path.
        folder: None in a cloud.
        rate: bytes/s that are sent; 0 for no limit.
        proxy: that keeps this rate.
    """

    url: str
    folder: Path | None
    rate: float = 0.0
    proxy: str = ""

    @property
    def _request_s(self) -> int:
        return REQUEST_S + (round(IN_FLIGHT / self.rate) if self.rate else 0)

    def table(self, name: str) -> str:
        """Address of a Delta table of the store."""
        return f"{self.url.rstrip('/')}/tables/{name}"

    @property
    def options(self) -> dict[str, str]:
        """Options of the libraries, besides those of the environment."""
        if self.folder is not None:
            return {}
        options = {
            "timeout": f"{self._request_s}s",
            "connect_timeout": f"{CONNECT_S}s",
            "max_retries": str(MAX_RETRIES),
            "retry_timeout": f"{max(RETRY_S, self._request_s)}s",
        }
        if self.proxy:
            options["proxy_url"] = self.proxy
        if _is_plain_http():
            options["allow_http"] = "true"
        return options

    def objects(self) -> Any:
        """The store of the files (obstore).

        Raises:
            StoreError: the URL or the environment is not valid.
        """
        from obstore import store

        with storage_errors(self):
            if self.folder is not None:
                return store.LocalStore(self.folder, mkdir=True)
            seconds = {"timeout": timedelta(seconds=self._request_s), "connect_timeout": timedelta(seconds=CONNECT_S)}
            longest = timedelta(seconds=max(RETRY_S, self._request_s))
            retry = {"max_retries": MAX_RETRIES, "retry_timeout": longest}
            more = {"proxy_url": self.proxy} if self.proxy else {}
            client = {**seconds, **more, **({"allow_http": True} if _is_plain_http() else {})}
            open_url: Any = store.from_url  # its overloads want the scheme to be known
            return open_url(self.url, client_options=client, retry_config=retry)


@contextmanager
def limited(store: StoreLocation, rate: float) -> Iterator[StoreLocation]:
    """The same store, at a rate.

    Args:
        rate: bytes/s; 0 for no limit.

    Raises:
        StoreError: the environment has a proxy already.
    """
    if not rate or store.folder is not None:
        yield replace(store, rate=rate)
        return
    for name in ("HTTPS_PROXY", "HTTP_PROXY", "ALL_PROXY"):
        if os.environ.get(name) or os.environ.get(name.lower()):
            hint = f"Unset {name}, or set upload_kb_s = 0 and limit the rate in that proxy."
            raise StoreError(f"store.upload_kb_s cannot limit a line that goes through the proxy of {name}", hint)
    with LimitedLine(rate) as line:
        yield replace(store, rate=rate, proxy=line.url)


def is_installed() -> bool:
    """Whether the packages of a store are."""
    return all(importlib.util.find_spec(name) is not None for name in PACKAGES)


def _is_plain_http() -> bool:
    """True if the configured endpoint is plain HTTP."""
    names = ("AWS_ENDPOINT_URL", "AWS_ENDPOINT", "AWS_ENDPOINT_URL_S3", "AZURE_STORAGE_ENDPOINT")
    return any(os.environ.get(name, "").startswith("http://") for name in names)


def location(text: str) -> StoreLocation:
    """The store of a URL or a path.

    Raises:
        StoreError: it is neither.
    """
    scheme, separator, _ = text.partition("://")
    if not text.strip():
        raise StoreError("--store is empty", f"Give {STORE_FORMS}.")
    if not separator:
        return _folder(Path(text).expanduser())
    parts = urlsplit(text)
    if scheme.lower() == "file":
        if parts.netloc not in ("", "localhost") or not parts.path:
            raise StoreError(
                f"{text:.200} names no folder of this machine", "Write file:///folder, with three slashes."
            )
        return _folder(Path(unquote(parts.path)))
    if scheme.lower() not in CLOUDS:
        raise StoreError(f"{scheme:.40}:// is not a kind of store", f"Give {STORE_FORMS}.")
    if not parts.netloc:
        raise StoreError(f"{text:.200} names no bucket", f"Write {scheme.lower()}://BUCKET/PREFIX.")
    if parts.username is not None and scheme.lower() not in ("abfs", "abfss"):
        raise StoreError("credentials do not belong into the URL of a store", "Set them in the environment.")
    if parts.query or parts.fragment:
        raise StoreError(f"{text:.200} has options", "Set them in the environment; the URL is bucket and prefix.")
    return StoreLocation(f"{scheme.lower()}://{parts.netloc}{parts.path.rstrip('/')}", None)


def _folder(path: Path) -> StoreLocation:
    path = path.absolute()
    if match := _NOT_IN_A_PATH.search(str(path)):
        hint = "Rename the folder, or give another: without [ ] ^ | \\, and without % before two digits."
        raise StoreError(f"the path of a store cannot have {match[0]!r}: {str(path)!r:.200}", hint)
    for one in (path, *path.parents):
        if one.exists():
            if not one.is_dir():
                raise StoreError(f"{one} is a file", "Give a folder, or one that does not exist yet.")
            break
    return StoreLocation(str(path), path)


@contextmanager
def storage_errors(store: StoreLocation) -> Iterator[None]:
    """Convert storage exceptions to StoreError.

    Raises:
        StoreError: for every error of the libraries and of the disk.
    """
    from deltalake.exceptions import DeltaError
    from obstore.exceptions import BaseError

    try:
        yield
    except (DeltaError, BaseError, OSError) as error:
        raise store_error(error, store) from None
    except Exception as error:
        if type(error).__module__ != "pyarrow.lib":
            raise
        raise store_error(error, store) from None


def store_error(error: BaseException, store: StoreLocation) -> StoreError:
    """StoreError for an exception, matched by message text because three libraries wrap it differently."""
    text = str(error)
    for pattern, words, hint in _CAUSES:
        if re.search(pattern, text, re.IGNORECASE):
            return StoreError(f"{store.url}: {words}", hint)
    first = re.sub(r"\s+", " ", re.split("Debug source|LINE 1:", text)[0]).strip().rstrip(".")
    return StoreError(f"{store.url}: {first[:300] or type(error).__name__}")


AGAIN = "Uploaded parts are kept; start the same command again."
_CAUSES = (
    (r"No space left|os error 28\b", "the disk is full", f"Free some space. {AGAIN}"),
    (r"os error 122\b|Disk quota", "the quota of the disk is used up", f"Free some space. {AGAIN}"),
    (r"Quota", "the quota of the store is used up", f"Free some space there, or raise the quota. {AGAIN}"),
    (r"Storage_?Full|Insufficient ?Storage|\b507\b", "the store is full", f"Free some space there. {AGAIN}"),
    (r"Read-only file system|os error 30\b", "the disk is read-only", "Give a folder that can be written."),
    (
        r"InvalidAccessKeyId|SignatureDoesNotMatch|Unauthenticated|401 Unauthorized|ExpiredToken|InvalidToken",
        "the credentials are not accepted",
        "Check the access key, the secret and the region in the environment.",
    ),
    (
        r"os error 13\b|os error 1\b|Permission denied|PermissionDenied|AccessDenied|403 Forbidden|\b403\b",
        "access is denied",
        "Check the rights of the user, or of the access key: it has to read, list and write there.",
    ),
    (
        r"NoSuchBucket|ContainerNotFound|bucket does not exist",
        "there is no such bucket",
        "Create it, or correct the name.",
    ),
    (
        r"169\.254\.169\.254|CredentialsNotLoaded|no credentials|Error getting credentials|instance credentials",
        "no credentials were found",
        "Set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or their like, in the environment.",
    ),
    (r"BadScheme|URL scheme is not allowed", "its server has no TLS", "Set AWS_ALLOW_HTTP=true if that is meant."),
    (r"Missing region|region.*(must be|is) (specified|missing)", "the region is missing", "Set AWS_REGION."),
    (
        r"dns error|failed to lookup|Name or service not known",
        "its server's name is unknown",
        "Check the URL, AWS_ENDPOINT_URL and the network.",
    ),
    (
        r"Connection refused|ConnectError|tcp connect|Connection reset|connection closed|error sending request"
        r"|timed? ?out|\b50[0234]\b|SlowDown|IncompleteMessage",
        "its server does not answer, or answers with errors",
        f"Check AWS_ENDPOINT_URL and the network. {AGAIN}",
    ),
)


def check_store(config: Config) -> None:
    """Check that the store of a configuration can be used, if there is one.

    Raises:
        ValueError: it cannot; the text is for a user.
    """
    if not config.of(FleetTables).store.url:
        return
    if not is_installed():
        raise ValueError(MISSING)
    try:
        location(config.of(FleetTables).store.url)
    except StoreError as error:
        raise ValueError(error.text) from None
