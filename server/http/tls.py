"""TLS certificates for https: given files, or a self-signed certificate.

    --tls-cert FILE --tls-key FILE      given, PEM; the certificate first, followed by its chain
    --tls                               self-signed, created once and renewed before it expires

    <data>/tls/certificate.pem          the self-signed one names this machine's host names, its .local name, its
    <data>/tls/key.pem                  addresses, loopback, --host and allowed_hosts; the key has mode 0600

A browser warns once of a self-signed certificate. The user can compare the SHA-256 fingerprint printed at start, beside
the address, with the one in the browser's certificate details. The certificate is therefore replaced as rarely as
possible: before it expires and when the machine has a new name, but not for a new address, as those of robots change.

It is valid for this server only and is not an authority (CA:FALSE), so a stolen key cannot vouch for other servers.

A certificate that changes on disk while the server runs (renewed by certbot), or that is renewed here, is used without
a restart: the TLS context loads it for new connections.

Only this file imports `cryptography`, and only with one of the options.
Sources: RFC 5280 §4.2 (extensions), RFC 9525 §6 (names), CA/Browser Forum limits are for public authorities only.
"""

import contextlib
import datetime
import ipaddress
import platform
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

from imuscope.recordings.system.atomic_write import write_atomic
from imuscope.server.settings.config import Config, ConfigError

FOLDER = "tls"
CIPHERS = "ECDHE+AESGCM:ECDHE+CHACHA20"  # of TLS 1.2: forward secrecy, and no CBC; TLS 1.3 has no others
CERTIFICATE_DAYS = 730  # Apple rejects certificates that are valid for more than 825 days
RENEW_DAYS = 60  # before expiry: a robot may be offline for a season
ALWAYS = ("localhost", "127.0.0.1", "::1")
LONGEST_NAME = 253  # of a host (RFC 1035 §2.3.4)


@dataclass(frozen=True, slots=True)
class Tls:
    """A valid certificate.

    Args:
        cert, key: PEM files.
        fingerprint: SHA-256 of the certificate, as browsers show it.
        made: self-signed by this server.
    """

    cert: Path
    key: Path
    fingerprint: str
    made: bool

    def context(self) -> ssl.SSLContext:
        """TLS context of the server: TLS 1.2 or newer; its TLS 1.2 ciphers are `CIPHERS`."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.set_ciphers(CIPHERS)
        context.load_cert_chain(self.cert, self.key)
        return context


class CertificateManager:
    """Certificate of a running server; `check` reloads it when it has changed.

    Raises:
        ConfigError: no valid certificate.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self.tls = tls_of(config)
        self.context = self.tls.context()

    def check(self) -> bool:
        """Reload the certificate from disk, renewing a self-signed one in time; True if it changed.

        Raises:
            ConfigError: the certificate on disk is not valid; the previous one stays in use.
        """
        files = tls_of(self._config)
        if files.fingerprint == self.tls.fingerprint:
            return False
        self.context.load_cert_chain(files.cert, files.key)
        self.tls = files
        return True


def tls_of(config: Config) -> Tls:
    """The certificate that the configuration asks for.

    Raises:
        ConfigError: a file is missing or invalid, the key does not match, or the certificate has expired.
    """
    if config.tls_cert:
        return load_certificate(Path(config.tls_cert).expanduser(), Path(config.tls_key).expanduser())
    try:
        return ensure_self_signed(config.data / FOLDER, names_of(config))
    except OSError as error:
        raise ConfigError(f"the certificate cannot be kept in {config.data / FOLDER}: {error.strerror}.") from None


def load_certificate(cert: Path, key: Path) -> Tls:
    """Load and check a certificate and its key.

    Raises:
        ConfigError: they are not valid; the message says why.
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
    tls = Tls(cert, key, _fingerprint(certificate), False)
    try:
        tls.context()
    except (ssl.SSLError, OSError) as error:
        raise ConfigError(f"tls_cert {cert} and tls_key {key} cannot be used: {error.args[-1]}.") from None
    return tls


def ensure_self_signed(folder: Path, names: Iterable[str]) -> Tls:
    """The self-signed certificate; created or renewed if necessary.

    Args:
        names: host names and addresses; a new address alone does not cause a renewal.

    Raises:
        OSError: it cannot be written.
    """
    cert, key = folder / "certificate.pem", folder / "key.pem"
    with contextlib.suppress(ConfigError):
        tls = load_certificate(cert, key)
        certificate = x509.load_pem_x509_certificate(cert.read_bytes())
        left = certificate.not_valid_after_utc - _now()
        hosts = {name for name in names if _address(name) is None}
        if left > datetime.timedelta(days=RENEW_DAYS) and hosts <= set(_names_in(certificate)):
            key.chmod(0o600)
            return Tls(cert, key, tls.fingerprint, True)
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    secret = ec.generate_private_key(ec.SECP256R1())
    certificate = _certificate(secret, names)
    pem = serialization.Encoding.PEM
    form = serialization.PrivateFormat.PKCS8
    # A process that reads between the two writes finds a pair that does not match, and creates another.
    write_atomic(key, secret.private_bytes(pem, form, serialization.NoEncryption()), 0o600)
    write_atomic(cert, certificate.public_bytes(pem), 0o644)
    return Tls(cert, key, _fingerprint(certificate), True)


def names_of(config: Config) -> list[str]:
    """Names of this server: names first, then addresses, each once."""
    node = platform.node()
    short = node.partition(".")[0]
    names = ["localhost", node, short, f"{short}.local" if short else "", config.host, *config.allowed_hosts]
    hosts = [name.strip("[]").lower().rstrip(".") for name in (*names, *ALWAYS, *addresses())]
    valid = [name for name in hosts if name and len(name) <= LONGEST_NAME and name.isascii() and name.isprintable()]
    unspecified = ("0.0.0.0", "::")
    return sorted(dict.fromkeys(name for name in valid if name not in unspecified), key=lambda one: bool(_address(one)))


def addresses() -> list[str]:
    """Addresses of this machine, as far as known without a library; never those of other machines."""
    result = set[str]()
    with contextlib.suppress(OSError, UnicodeError):
        result |= {str(row[4][0]) for row in socket.getaddrinfo(platform.node(), None)}
    for family, target in ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1")):
        # Local address of the route to a documentation address (RFC 5737, RFC 3849). Nothing is sent.
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((target, 9))
            result.add(str(probe.getsockname()[0]))
    if sys.platform == "linux":
        result |= _interfaces()
    return sorted({address.partition("%")[0] for address in result})


def _interfaces() -> set[str]:
    """IPv4 addresses of the interfaces: SIOCGIFADDR of netdevice(7), ifreq with the name, sockaddr_in at byte 16."""
    import fcntl

    result = set[str]()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            with contextlib.suppress(OSError):
                answer = fcntl.ioctl(probe.fileno(), 0x8915, name.encode()[:15].ljust(40, b"\0"))
                result.add(socket.inet_ntoa(answer[20:24]))
    return result


def _certificate(secret: ec.EllipticCurvePrivateKey, names: Iterable[str]) -> x509.Certificate:
    hosts = list(names)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"imuscope {platform.node()}"[:64])])
    alternatives: list[x509.GeneralName] = []
    for name in hosts:
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
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # clocks differ
        .not_valid_after(now + datetime.timedelta(days=CERTIFICATE_DAYS))
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
        alternatives = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return alternatives.get_values_for_type(x509.DNSName)


def _read(path: Path, name: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{name} {path} cannot be read: {error.strerror}.") from None


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
