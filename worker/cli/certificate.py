"""A self-made certificate, for HTTPS in a plant without a certificate authority of its own."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

_DAYS = 820
"""Tablets refuse certificates of longer validity (825 days, Apple)."""
_ANY_OTHER = ("198.51.100.1", 9)
"""An address for documentation (RFC 5737), reached by the way that leads out of this machine."""
_REQUEST = """
[req]
prompt = no
distinguished_name = name
x509_extensions = extensions
[name]
CN = Groundplan on {host}
[extensions]
basicConstraints = critical, CA:TRUE
extendedKeyUsage = serverAuth
subjectAltName = {names}
"""


class CertificateNotMade(Exception):
    """The certificate could not be made; the sentence says why and what to do."""


@dataclass(frozen=True)
class OwnCertificate:
    """Hold where a certificate and its private key lie, both PEM."""

    certificate: Path
    key: Path


def self_made(data_dir: Path, *, host: str | None) -> OwnCertificate:
    """Return the certificate in ``tls/`` of the data folder; it is made once, by the program ``openssl``.

    It names this machine, its addresses, `localhost` and `host`, and is its own authority: a tablet that
    trusts it opens pages without a warning. The key is readable by its owner alone.

    Raises
    ------
    CertificateNotMade
        If there is no ``openssl``, or it failed.
    """
    folder = data_dir / "tls"
    own = OwnCertificate(folder / "certificate.pem", folder / "key.pem")
    if own.certificate.exists() and own.key.exists():
        return own
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as made:
        request, key, certificate = (
            Path(made, name) for name in ("request.cnf", "key.pem", "certificate.pem")
        )
        names = ", ".join(_names(host))
        request.write_text(_REQUEST.format(host=socket.gethostname(), names=names), encoding="utf-8")
        _openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                 "-days", str(_DAYS), "-config", request, "-keyout", key, "-out", certificate)  # fmt: skip
        key.chmod(0o600)
        key.replace(own.key)
        certificate.replace(own.certificate)
    return own


def _openssl(*words: str | Path) -> None:
    try:
        subprocess.run(["openssl", *words], check=True, capture_output=True, text=True)
    except FileNotFoundError as error:
        detail = "the program openssl is missing: install it, or give --tls-cert and --tls-key"
        raise CertificateNotMade(detail) from error
    except subprocess.CalledProcessError as error:
        raise CertificateNotMade(f"openssl failed: {error.stderr.strip()[-500:]}") from error


def _names(host: str | None) -> list[str]:
    """Return under which names and addresses tablets may reach this machine, as OpenSSL writes them."""
    machine = socket.gethostname()
    found = dict.fromkeys(["localhost", "127.0.0.1", "::1", machine, *_addresses(machine)])
    if host and host not in {"0.0.0.0", "::"}:  # noqa: S104 - compared, not listened on
        found[host] = None
    return [f"{'IP' if _is_address(name) else 'DNS'}:{name}" for name in found]


def _addresses(machine: str) -> list[str]:
    found = []
    with contextlib.suppress(socket.gaierror):
        found += [str(info[4][0]).partition("%")[0] for info in socket.getaddrinfo(machine, None)]
    return [*found, *_address_in_the_plant()]


def _address_in_the_plant() -> list[str]:
    """Return the address from which this machine would answer others; nothing is sent."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(_ANY_OTHER)
        return [str(probe.getsockname()[0])]
    return []


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
