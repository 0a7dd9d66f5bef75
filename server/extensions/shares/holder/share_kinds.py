"""Kinds of shares: a pseudo-terminal under a stable path, a TCP port, a UDP socket."""

from __future__ import annotations

import _socket
import contextlib
import errno
import fcntl
import os
import select
import termios
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable

from imuscope.recordings.system import atomic_write
from imuscope.server.extensions.shares.holder.clients import Client, UdpClient
from imuscope.server.extensions.shares.holder.settings import MODULE
from imuscope.server.extensions.shares.holder.shares import ShareAddress, ShareError
from imuscope.server.system.light_modules import Socket
from imuscope.server.system.open_files import descriptor_field, descriptors, file_text, process_folders
from imuscope.server.system.terminals import PTS

MOST_TCP_CLIENTS = 16
UNREAD = 1 << 13  # bytes that a client has not read, of a line of some 10 kB/s: it does not read at all
RATES = {getattr(termios, name): int(name[1:]) for name in dir(termios) if name[:1] == "B" and name[1:].isdigit()}


class Share(ABC):
    """One share and its clients.

    Args:
        address: of the share.
        next_number: numbers of clients.
    """

    def __init__(self, address: ShareAddress, next_number: Callable[[], int]) -> None:
        self.address = address
        self.clients: list[Client] = []
        self._next_number = next_number

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """Whether it is offered."""

    @abstractmethod
    def open(self) -> None:
        """Offer it.

        Raises:
            ShareError: it cannot be offered: cause, then action.
        """

    @abstractmethod
    def close(self) -> None:
        """Disconnect everybody and remove it. Idempotent."""

    @property
    def listener(self) -> int:
        """Descriptor that is readable when a client connects; −1 for none."""
        return -1

    def accept(self) -> Client | None:
        """A client that connected, if any."""
        return None

    @property
    def is_full(self) -> bool:
        """Whether no further client can connect."""
        return False

    def idle_client(self) -> Client | None:
        """The client that gives way to another one; None: all of them take part."""
        return None

    def turn_away(self) -> None:
        """Refuse the client that connects, of a share that may be full."""
        raise NotImplementedError

    def clean(self) -> None:  # noqa: B027 - most kinds have a connection for each client
        """Discard what a client that has left did not read: the next one must not get it."""

    def update(self) -> tuple[Client | None, Client | None]:
        """The client that came and the one that left since the last call, for shares without a listener."""
        return None, None

    def drop(self, client: Client) -> None:
        """Disconnect a client."""
        if client in self.clients:
            self.clients.remove(client)

    def _add(self, peer: str, fd: int, make: type[Client] = Client, terminal: str = "") -> Client:
        may_write = not self.address.read_only and not any(one.may_write for one in self.clients)
        client = make(self._next_number(), self.address.text, peer, fd, may_write=may_write, terminal=terminal)
        self.clients.append(client)
        return client


class PtyShare(Share):
    """A pseudo-terminal under a stable path. All programs that have it open are one client."""

    def __init__(self, address: ShareAddress, next_number: Callable[[], int]) -> None:
        super().__init__(address, next_number)
        self._master = -1
        self._poll = select.poll()
        self._slave = ""

    @property
    def is_open(self) -> bool:
        return self._master >= 0

    def open(self) -> None:
        path = self.address.path
        if os.path.lexists(path) and not _is_own_link(path):
            raise ShareError(f"{path} exists and is not a link of a share; choose another path or remove it")
        if (other := _holder_of(path)) is not None:
            words = f"{path} is offered by another holder (process {other})"
            raise ShareError(f"{words}; choose another path or end that one")
        self._make()

    def _make(self) -> None:
        """Make a terminal, to which the path leads from now on; ShareError: it cannot be."""
        path = self.address.path
        try:
            master, slave = os.openpty()
        except OSError as error:
            words = f"{path} cannot be created: {error.strerror or error}"
            raise ShareError(f"{words}; close programs that have terminals open") from None
        try:
            tty.setraw(slave)
            name = os.ttyname(slave)
            self._own(slave)
            temporary = f"{path}.{os.getpid()}.tmp"
            os.symlink(name, temporary)
            atomic_write.replace(temporary, path, durable=False)
        except ShareError as error:
            os.close(master)
            raise ShareError(f"{path} cannot be created: {error}") from None
        except OSError as error:
            os.close(master)
            raise ShareError(_cannot_link(path, error)) from None
        finally:
            os.close(slave)
        os.set_blocking(master, False)
        self._master, self._slave = master, name
        self._poll.register(master, select.POLLIN)

    def _own(self, slave: int) -> None:
        """Set owner, group and permissions of the terminal; ShareError: no such user or group."""
        owner, group = self.address.owner, self.address.group
        uid, gid = _user(owner), _group(group)
        if uid >= 0 or gid >= 0:
            os.fchown(slave, uid, gid)
        if self.address.permissions is not None:
            os.fchmod(slave, self.address.permissions)

    def close(self) -> None:
        self.clients.clear()
        if self._master >= 0:
            self._poll.unregister(self._master)
            os.close(self._master)
            self._master = -1
        try:
            if os.readlink(self.address.path) == self._slave:
                os.unlink(self.address.path)
        except OSError:
            pass

    def update(self) -> tuple[Client | None, Client | None]:
        if self._master < 0:
            return None, None
        events = self._events()
        is_open = not events & select.POLLHUP
        if not self.clients and (is_open or events & select.POLLIN):  # or it came, wrote and left since the last look
            return self._add(self.address.path, self._master, terminal=self._slave), None
        if not is_open and self.clients:
            return None, self.clients.pop()
        for client in self.clients:
            with contextlib.suppress(termios.error):  # it was closed just now
                client.baud = RATES.get(termios.tcgetattr(self._master)[4])
        return None, None

    def _events(self) -> int:
        return sum(event for _, event in self._poll.poll(0))

    def clean(self) -> None:
        """Also ends the exclusive use by a program that has left (TIOCEXCL): it lasts as long as a terminal, which that
        of a device does not.
        """
        if self._master < 0 or not self._events() & select.POLLHUP:
            return
        try:
            slave = os.open(self._slave, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:  # in exclusive use, or of another owner
            self._renew()
            return
        try:
            fcntl.ioctl(slave, termios.TIOCNXCL)
            termios.tcflush(slave, termios.TCIOFLUSH)  # that of the master leaves what the slave has received
        except (OSError, termios.error):
            pass
        finally:
            os.close(slave)

    def _renew(self) -> None:
        """Replace the terminal; it stays if that fails."""
        old = self._master
        self._poll.unregister(old)
        try:
            self._make()
        except ShareError:
            self._poll.register(old, select.POLLIN)
        else:
            os.close(old)

    def drop(self, client: Client) -> None:
        """Hang up: the programs that have it open see an unplugged port; the path leads to a new one."""
        super().drop(client)
        self.close()
        self.open()


class TcpShare(Share):
    """A listening TCP port."""

    def __init__(self, address: ShareAddress, next_number: Callable[[], int]) -> None:
        super().__init__(address, next_number)
        self._listener: Socket | None = None
        self._sockets: dict[int, Socket] = {}

    @property
    def is_open(self) -> bool:
        return self._listener is not None

    def open(self) -> None:
        family = _socket.AF_INET6 if ":" in self.address.host else _socket.AF_INET
        listener = Socket(family, _socket.SOCK_STREAM)
        try:
            listener.setsockopt(_socket.SOL_SOCKET, _socket.SO_REUSEADDR, 1)
            listener.bind((self.address.host, self.address.port))
            listener.listen(MOST_TCP_CLIENTS)
            listener.setblocking(False)
        except OSError as error:
            listener.close()
            why = (error.strerror or "it cannot be used").lower()
            raise ShareError(f"{self.address.text} cannot be offered: {why}; choose another port or host") from None
        self._listener = listener

    def close(self) -> None:
        for client in list(self.clients):
            self.drop(client)
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    @property
    def listener(self) -> int:
        return self._listener.fileno() if self._listener is not None else -1

    def accept(self) -> Client | None:
        if self._listener is None:
            return None
        try:
            connection, peer = self._listener.accept()
        except OSError:
            return None
        connection.setblocking(False)
        connection.setsockopt(_socket.IPPROTO_TCP, _socket.TCP_NODELAY, 1)
        connection.setsockopt(_socket.SOL_SOCKET, _socket.SO_KEEPALIVE, 1)
        host = f"[{peer[0]}]" if ":" in peer[0] else peer[0]
        client = self._add(f"{host}:{peer[1]}", connection.fileno())
        self._sockets[client.number] = connection
        return client

    @property
    def is_full(self) -> bool:
        return len(self.clients) >= MOST_TCP_CLIENTS

    def idle_client(self) -> Client | None:
        return next((one for one in self.clients if not one.received and (not one.sent or one.unread >= UNREAD)), None)

    def turn_away(self) -> None:
        if self._listener is not None:
            with contextlib.suppress(OSError):
                self._listener.accept()[0].close()

    def drop(self, client: Client) -> None:
        super().drop(client)
        connection = self._sockets.pop(client.number, None)
        if connection is not None:
            connection.close()


class UdpShare(Share):
    """Datagrams to one address, and from it."""

    def __init__(self, address: ShareAddress, next_number: Callable[[], int]) -> None:
        super().__init__(address, next_number)
        self._socket: Socket | None = None

    @property
    def is_open(self) -> bool:
        return self._socket is not None

    def open(self) -> None:
        family = _socket.AF_INET6 if ":" in self.address.host else _socket.AF_INET
        made = Socket(family, _socket.SOCK_DGRAM)
        try:
            made.connect((self.address.host, self.address.port))
            made.setblocking(False)
        except OSError as error:
            made.close()
            why = (error.strerror or "it cannot be used").lower()
            raise ShareError(f"{self.address.text} cannot be reached: {why}; check host and port") from None
        self._socket = made

    def close(self) -> None:
        self.clients.clear()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def update(self) -> tuple[Client | None, Client | None]:
        if self.clients or self._socket is None:
            return None, None
        return self._add(self.address.text, self._socket.fileno(), UdpClient), None


def make_share(address: ShareAddress, next_number: Callable[[], int]) -> Share:
    """The share of an address, not offered yet."""
    kinds: dict[str, Callable[[ShareAddress, Callable[[], int]], Share]]
    kinds = {"pty": PtyShare, "tcp": TcpShare, "udp": UdpShare}
    return kinds[address.kind](address, next_number)


def _is_own_link(path: str) -> bool:
    try:
        return os.readlink(path).startswith(PTS)
    except OSError:
        return False


def _holder_of(path: str) -> int | None:
    """Process of another holder that offers a terminal under this path; None: there is none, or a holder that was
    killed.
    """
    try:
        index = os.readlink(path).removeprefix(PTS)
    except OSError:
        return None
    for folder in process_folders():
        try:
            if MODULE not in file_text(folder, "cmdline"):
                continue
            for fd in descriptors(folder):
                if os.readlink(fd).endswith("ptmx") and descriptor_field(folder, fd.name, "tty-index") == index:
                    return int(folder.name)
        except OSError:  # it ended, or belongs to another user
            continue
    return None


def _user(name: str) -> int:
    """Number of a user; −1 for none given."""
    import pwd  # libraries that most holders do not need, here and below

    try:
        return -1 if not name else int(name) if name.isdigit() else pwd.getpwnam(name).pw_uid
    except KeyError:
        raise ShareError(f"there is no user {name!r:.40}; name one that exists") from None


def _group(name: str) -> int:
    """Number of a group; −1 for none given."""
    import grp

    try:
        return -1 if not name else int(name) if name.isdigit() else grp.getgrnam(name).gr_gid
    except KeyError:
        raise ShareError(f"there is no group {name!r:.40}; name one that exists") from None


def _cannot_link(path: str, error: OSError) -> str:
    number = error.errno
    folder = os.path.dirname(path)
    if number == errno.ENOENT and os.path.isdir(folder):
        return f"{path} cannot be created: {folder} takes no files; choose a folder such as /run/imuscope"
    if number == errno.ENOENT:
        return f"{path} cannot be created: there is no folder {folder}; create it first"
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        return f"{path} cannot be created: no permission to write in {folder} or to set its owner"
    return f"{path} cannot be created: {(error.strerror or str(error)).lower()}"
