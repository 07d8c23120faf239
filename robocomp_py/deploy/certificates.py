"""X.509 certificates of a deployment: its authority, and what that signs. EC keys (P-256), PEM files.

`cryptography` is imported only here.
"""

from __future__ import annotations

import datetime
import ipaddress
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..errors import DeploymentError
from ..transports.permissions import LONGEST_NAME

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

CA_DAYS = 3650
_BACKDATED = datetime.timedelta(minutes=5)
"""Tolerated difference between the clocks of hosts."""


@dataclass(frozen=True)
class Issued:
    """A certificate and its private key, as PEM."""

    certificate: bytes
    key: bytes


@dataclass(frozen=True)
class Certificate:
    """The content of a certificate."""

    name: str
    addresses: frozenset[str]
    expires: datetime.datetime
    begins: datetime.datetime


def make_authority(name: str, now: datetime.datetime) -> Issued:
    """An authority of its own, which can sign nothing but end entities."""
    x509, ec, hashes, _ = _library()
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _named(f"{name} deployment")
    builder = (
        _dated(x509.CertificateBuilder(), now, CA_DAYS)
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
    return _issued(builder.sign(key, hashes.SHA256()), key)


def issue(
    authority: Issued, name: str, addresses: Iterable[str], now: datetime.datetime, days: float, *, serves: bool
) -> Issued:
    """A certificate for `name`. It is valid for a client, and with `serves` for a server at these addresses."""
    x509, ec, hashes, serialization = _library()
    from cryptography.x509.oid import ExtendedKeyUsageOID

    signing: Any = serialization.load_pem_private_key(authority.key, None)
    above = x509.load_pem_x509_certificate(authority.certificate)
    key = ec.generate_private_key(ec.SECP256R1())
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if serves else [])]
    builder = (
        _dated(x509.CertificateBuilder(), now, days)
        .subject_name(_named(name))
        .issuer_name(above.subject)
        .public_key(key.public_key())
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signing.public_key()), critical=False)
    )
    names = [_general_name(each) for each in sorted(set(addresses))]
    if names:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return _issued(builder.sign(signing, hashes.SHA256()), key)


def read(pem: bytes) -> Certificate:
    """Raises ValueError."""
    x509, *_ = _library()
    found = x509.load_pem_x509_certificate(pem)
    addresses: set[str] = set()
    try:
        there = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        addresses = {str(each.value) for each in there}
    except x509.ExtensionNotFound:
        pass  # a process that only connects has none
    [name] = found.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    return Certificate(str(name.value), frozenset(addresses), found.not_valid_after_utc, found.not_valid_before_utc)


def is_signed_by(pem: bytes, authority: bytes) -> bool:
    """Whether that authority has signed it."""
    x509, *_ = _library()
    from cryptography.exceptions import InvalidSignature

    try:
        x509.load_pem_x509_certificate(pem).verify_directly_issued_by(x509.load_pem_x509_certificate(authority))
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def _library() -> tuple[Any, Any, Any, Any]:
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError as exc:
        raise DeploymentError(
            f"keys need the package `cryptography`: pip install 'robocomp-py[security]' ({exc})"
        ) from exc
    return x509, ec, hashes, serialization


def _named(name: str) -> Any:
    x509, *_ = _library()
    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name[:LONGEST_NAME])])


def _dated(builder: Any, now: datetime.datetime, days: float) -> Any:
    x509, *_ = _library()
    ends = now + datetime.timedelta(days=days)
    begins = min(now - _BACKDATED, ends - _BACKDATED)  # only tests make expired ones
    return builder.serial_number(x509.random_serial_number()).not_valid_before(begins).not_valid_after(ends)


def _usage(*, signs_certificates: bool) -> Any:
    x509, *_ = _library()
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _general_name(address: str) -> Any:
    x509, *_ = _library()
    try:
        return x509.IPAddress(ipaddress.ip_address(address))
    except ValueError:
        return x509.DNSName(address)


def _issued(certificate: Any, key: EllipticCurvePrivateKey) -> Issued:
    _, _, _, serialization = _library()
    form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    return Issued(certificate.public_bytes(serialization.Encoding.PEM), key.private_bytes(*form))
