"""How is the page served as https? With a certificate that was given, or with one that is made here.

    --tls-cert FILE --tls-key FILE      given, PEM; the certificate first, those that vouch for it after it
    --tls                               made once, kept, made anew before it ends

    <data>/tls/certificate.pem          one that is made says who it is for: this machine's names, its .local name,
    <data>/tls/key.pem                  its addresses, loopback, --host, allowed_hosts; the key has mode 0600

Nobody vouches for a made certificate, so a browser warns once; whether it is this server that it warns of, the SHA-256
fingerprint tells, which is printed at start beside the address and is in the browser's details of the certificate. That
is why a made one is kept for as long as it can be: it is made anew before it ends and when a name is new by which the
machine is to be called, not when an address has changed, as on a robot they do.

It is for this server and no authority (CA:FALSE): who trusts it trusts nothing else with it, should the key be lost.

A certificate that changes on disk while the server runs (certbot renews), or that must be made anew, is taken into use
without a restart: a context that has loaded a new one gives it to the next who connects.

Only this file imports `cryptography`, and only with one of the options.
Sources: RFC 5280 §4.2 (extensions), RFC 9525 §6 (names), CA/Browser Forum limits are for public authorities only.
"""

from __future__ import annotations

import contextlib
import datetime
import ipaddress
import os
import platform
import secrets
import socket
import ssl
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from server.config import Config, ConfigError

FOLDER = "tls"
CIPHERS = "ECDHE+AESGCM:ECDHE+CHACHA20"  # of TLS 1.2: forward secrecy, and no CBC; TLS 1.3 has no others
DAYS = 730  # Apple's systems take no certificate that is valid for longer than 825 days
RENEW_DAYS = 60  # before the end: a robot may be away for a season
ALWAYS = ("localhost", "127.0.0.1", "::1")
LONGEST_NAME = 253  # of a host (RFC 1035 §2.3.4)


@dataclass(frozen=True, slots=True)
class Tls:
    """A certificate that may be used.

    Args:
        cert, key: PEM files.
        fingerprint: SHA-256 of the certificate, as browsers show it.
        made: it is one of ours.
    """

    cert: Path
    key: Path
    fingerprint: str
    made: bool

    def context(self) -> ssl.SSLContext:
        """What a server needs: TLS 1.2 or newer with the ciphers that this OpenSSL holds to be good."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.set_ciphers(CIPHERS)
        context.load_cert_chain(self.cert, self.key)
        return context


class CertificateManager:
    """Holds the certificate of a running server, and looks now and then whether it is still the one to use.

    Raises:
        ConfigError: there is none that can be used.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self.tls = tls_of(config)
        self.context = self.tls.context()

    def look(self) -> bool:
        """Take what is on disk now into use; a made one is made anew in time. True where it is another.

        Raises:
            ConfigError: what is on disk cannot be used; what was in use stays in use.
        """
        found = tls_of(self._config)
        if found.fingerprint == self.tls.fingerprint:
            return False
        self.context.load_cert_chain(found.cert, found.key)
        self.tls = found
        return True


def tls_of(config: Config) -> Tls:
    """The certificate that the configuration asks for.

    Raises:
        ConfigError: a file is missing, is no certificate or no key, they do not fit, or its time is over.
    """
    if config.tls_cert:
        return load_certificate(Path(config.tls_cert).expanduser(), Path(config.tls_key).expanduser())
    try:
        return ensure_self_signed(config.data / FOLDER, names_of(config))
    except OSError as error:
        raise ConfigError(f"the certificate cannot be kept in {config.data / FOLDER}: {error.strerror}.") from None


def load_certificate(cert: Path, key: Path) -> Tls:
    """A certificate and its key in files, looked through.

    Raises:
        ConfigError: what is wrong with them.
    """
    public, private = _read(cert, "tls_cert"), _read(key, "tls_key")
    try:
        certificate = x509.load_pem_x509_certificate(public)
    except ValueError:
        raise ConfigError(f"tls_cert {cert} holds no certificate in PEM form (-----BEGIN CERTIFICATE-----).") from None
    try:
        secret = serialization.load_pem_private_key(private, None)
    except TypeError:
        raise ConfigError(f"tls_key {key} has a passphrase; give one without.") from None
    except ValueError:
        raise ConfigError(f"tls_key {key} holds no private key in PEM form (-----BEGIN PRIVATE KEY-----).") from None
    if _public(secret.public_key()) != _public(certificate.public_key()):
        raise ConfigError(f"tls_key {key} is not the key of the certificate {cert}.")
    now, end = _now(), certificate.not_valid_after_utc
    if end <= now:
        raise ConfigError(f"tls_cert {cert} has expired on {end:%Y-%m-%d}.")
    if certificate.not_valid_before_utc > now:
        raise ConfigError(
            f"tls_cert {cert} is valid from {certificate.not_valid_before_utc:%Y-%m-%d}; it is {now:%Y-%m-%d} here."
        )
    found = Tls(cert, key, _fingerprint(certificate), False)
    try:
        found.context()
    except (ssl.SSLError, OSError) as error:
        raise ConfigError(f"tls_cert {cert} and tls_key {key} cannot be used: {error.args[-1]}.") from None
    return found


def ensure_self_signed(folder: Path, names: Iterable[str]) -> Tls:
    """Our own certificate: the one that is there, or a new one.

    Args:
        names: host names and addresses; of an address that is new, no new one is made.
    Raises:
        OSError: it cannot be kept.
    """
    cert, key = folder / "certificate.pem", folder / "key.pem"
    with contextlib.suppress(ConfigError):
        found = load_certificate(cert, key)
        certificate = x509.load_pem_x509_certificate(cert.read_bytes())
        left = certificate.not_valid_after_utc - _now()
        wanted = {name for name in names if _address(name) is None}
        if left > datetime.timedelta(days=RENEW_DAYS) and wanted <= set(_names_in(certificate)):
            key.chmod(0o600)
            return Tls(cert, key, found.fingerprint, True)
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    secret = ec.generate_private_key(ec.SECP256R1())
    certificate = _certificate(secret, names)
    pem = serialization.Encoding.PEM
    form = serialization.PrivateFormat.PKCS8
    # Whoever reads between the two finds a pair that does not fit, and makes another.
    _keep(key, secret.private_bytes(pem, form, serialization.NoEncryption()), 0o600)
    _keep(cert, certificate.public_bytes(pem), 0o644)
    return Tls(cert, key, _fingerprint(certificate), True)


def names_of(config: Config) -> list[str]:
    """What this server may be called: names first, then addresses, each once."""
    node = platform.node()
    short = node.partition(".")[0]
    names = ["localhost", node, short, f"{short}.local" if short else "", config.host, *config.allowed_hosts]
    found = [name.strip("[]").lower().rstrip(".") for name in (*names, *ALWAYS, *addresses())]
    fit = [name for name in found if name and len(name) <= LONGEST_NAME and name.isascii() and name.isprintable()]
    unspecified = ("0.0.0.0", "::")
    return sorted(dict.fromkeys(name for name in fit if name not in unspecified), key=lambda one: bool(_address(one)))


def addresses() -> list[str]:
    """Addresses of this machine, as far as the system tells without a library: never one that is not its own."""
    found = set[str]()
    with contextlib.suppress(OSError, UnicodeError):
        found |= {str(row[4][0]) for row in socket.getaddrinfo(platform.node(), None)}
    for family, elsewhere in ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1")):
        # Which address would be used to go there (RFC 5737, RFC 3849: nobody is there). Nothing is sent.
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as asked:
            asked.connect((elsewhere, 9))
            found.add(str(asked.getsockname()[0]))
    if sys.platform == "linux":
        found |= _interfaces()
    return sorted({address.partition("%")[0] for address in found})


def _interfaces() -> set[str]:
    """IPv4 addresses of the interfaces. SIOCGIFADDR of netdevice(7): ifreq with the name, a sockaddr_in at byte 16."""
    import fcntl

    found = set[str]()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        for _, name in socket.if_nameindex():
            with contextlib.suppress(OSError):
                answer = fcntl.ioctl(asked.fileno(), 0x8915, name.encode()[:15].ljust(40, b"\0"))
                found.add(socket.inet_ntoa(answer[20:24]))
    return found


def _certificate(secret: ec.EllipticCurvePrivateKey, names: Iterable[str]) -> x509.Certificate:
    ours = list(names)
    called = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"imuscope {platform.node()}"[:64])])
    alternatives: list[x509.GeneralName] = []
    for name in ours:
        address = _address(name)
        alternatives.append(x509.IPAddress(address) if address is not None else x509.DNSName(name))
    now, public = _now(), secret.public_key()
    usage = dict.fromkeys(
        (
            *("content_commitment", "key_encipherment", "data_encipherment", "key_agreement", "key_cert_sign"),
            *("crl_sign", "encipher_only", "decipher_only"),
        ),
        False,
    )
    return (
        x509.CertificateBuilder()
        .subject_name(called)
        .issuer_name(called)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # clocks differ
        .not_valid_after(now + datetime.timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.KeyUsage(digital_signature=True, **usage), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(public), critical=False)
        .sign(secret, hashes.SHA256())
    )


def _names_in(certificate: x509.Certificate) -> list[str]:
    try:
        held = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return held.get_values_for_type(x509.DNSName)


def _read(path: Path, name: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{name} {path} cannot be read: {error.strerror}.") from None


def _keep(path: Path, data: bytes, mode: int) -> None:
    """Make `path` hold `data`; nobody but those whom `mode` allows can have read it at any moment."""
    aside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with os.fdopen(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        aside.replace(path)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise


def _public(key: object) -> bytes:
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    return key.public_bytes(serialization.Encoding.DER, form)  # type: ignore[attr-defined,no-any-return]


def _fingerprint(certificate: x509.Certificate) -> str:
    return certificate.fingerprint(hashes.SHA256()).hex(":").upper()


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)
