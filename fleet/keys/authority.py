"""The authority and the certificates that it signs: in memory, nothing is written here."""

import re
import secrets
from dataclasses import dataclass
from datetime import datetime, timedelta
from ipaddress import IPv6Address, ip_address
from typing import Final, Self

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ec import (
    SECP256R1,
    EllipticCurvePrivateKey,
    generate_private_key,
)
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from chassis.refusal import Refusal
from protocol.identity import date_text
from protocol.keys import BENCH_NAME, WORLD_NAME, checked_name

_HOST_NAME: Final = re.compile(r"(?=.{1,253}\Z)(?![\d.]+\Z)\w[\w-]{0,62}(\.\w[\w-]{0,62})*", re.ASCII)
_ROBOT_FOLDER: Final = "robot-"
_FOLDERS: Final = {WORLD_NAME: "world", BENCH_NAME: "bench"}
_HOLDERS: Final = {folder: name for name, folder in _FOLDERS.items()}


LOCAL_HOSTS: Final = ("localhost", "127.0.0.1")
"""Of a world that is found on its own machine only."""


def checked_host(text: str) -> str:
    """Where robots find the world: a host name or an IPv4 address.

    Raises:
        ValueError: it is neither; its text is for people.
    """
    try:
        address = ip_address(text)
    except ValueError:
        if _HOST_NAME.fullmatch(text):
            return text
        raise ValueError(
            f"{text!r} found, a host name or an IPv4 address is expected, such as lab.example or "
            "192.168.1.7, without protocol and port"
        ) from None
    if isinstance(address, IPv6Address):  # Zenoh takes what stands before the first colon for the host
        raise ValueError(
            f"{text!r} found, but over TLS Zenoh connects to no IPv6 address; give the world a host name"
        )
    return text


@dataclass(frozen=True)
class Device:
    """Who gets a certificate."""

    name: str
    """A robot's id, ``WORLD_NAME`` or ``BENCH_NAME``: the common name."""
    hosts: tuple[str, ...] = ()
    """Where it is found, each a ``checked_host``; for the world only."""

    @property
    def folder(self) -> str:
        """The name of the folder with its keys."""
        return folder_of(self.name)


def folder_of(name: str) -> str:
    """The name of the folder with the keys of a robot, the world or the bench."""
    return _FOLDERS.get(name, f"{_ROBOT_FOLDER}{name}")


def name_of(folder: str) -> str | None:
    """Whose keys a folder of this name holds; None if it is no device's."""
    if folder in _HOLDERS or not folder.startswith(_ROBOT_FOLDER):
        return _HOLDERS.get(folder)
    try:
        return checked_name(folder.removeprefix(_ROBOT_FOLDER))
    except ValueError:
        return None


def hosts_in(certificate: x509.Certificate) -> list[str]:
    """The hosts for which a certificate is valid, as people write them."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return [*names.get_values_for_type(x509.DNSName), *map(str, names.get_values_for_type(x509.IPAddress))]


BACKDATING: Final = timedelta(days=1)
"""Certificates are valid from so long before they are made: a device's clock may be wrong by a time zone."""


@dataclass(frozen=True)
class Credentials:
    """A certificate and the private key that belongs to it."""

    certificate: x509.Certificate
    key: EllipticCurvePrivateKey

    @property
    def certificate_pem(self) -> bytes:
        """The certificate as Zenoh and OpenSSL read it."""
        return self.certificate.public_bytes(Encoding.PEM)

    @property
    def key_pem(self) -> bytes:
        """The private key as Zenoh and OpenSSL read it, without password."""
        return self.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


@dataclass(frozen=True)
class Authority(Credentials):
    """Whom all devices of a fleet trust."""

    @classmethod
    def new(cls, now: datetime, days: int) -> Self:
        """An authority for so many days, with a name of its own, so that two can be told apart."""
        key, name = generate_private_key(SECP256R1()), _name(f"unspoken authority {secrets.token_hex(4)}")
        return cls(_signed(name, key, name, key, now, days), key)

    def issue(self, device: Device, now: datetime, days: int) -> Credentials:
        """A certificate for a device, with a new private key; valid for so many days from now on.

        The world's certificate is for a server at its hosts, all others are for clients: no robot can be
        taken for the world.

        Raises:
            Refusal: the authority expires before.
        """
        end, latest = now + timedelta(days=days), self.certificate.not_valid_after_utc
        if end > latest:
            most, new = (latest - now).days, "make new keys for everybody with 'unspoken keys create'"
            raise Refusal(
                f"certificates for {days} days would end on {date_text(end)}, after their authority, which "
                f"expires on {date_text(latest)}; {f'--days {most} is the most' if most >= 1 else new}"
            )
        is_world = device.name == WORLD_NAME
        purpose = ExtendedKeyUsageOID.SERVER_AUTH if is_world else ExtendedKeyUsageOID.CLIENT_AUTH
        extensions: list[x509.ExtensionType] = [x509.ExtendedKeyUsage([purpose])]
        if device.hosts:
            extensions.append(x509.SubjectAlternativeName(map(_general_name, device.hosts)))
        key, name, issuer = generate_private_key(SECP256R1()), _name(device.name), self.certificate.subject
        return Credentials(_signed(name, key, issuer, self.key, now, days, *extensions), key)


def _general_name(host: str) -> x509.GeneralName:
    return x509.DNSName(host) if _HOST_NAME.fullmatch(host) else x509.IPAddress(ip_address(host))


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _signed(
    subject: x509.Name,
    key: EllipticCurvePrivateKey,
    issuer: x509.Name,
    signer: EllipticCurvePrivateKey,
    now: datetime,
    days: int,
    *extensions: x509.ExtensionType,
) -> x509.Certificate:
    """A certificate: that of an authority where it is signed with its own key, else that of a device."""
    signs = signer is key
    usage = x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BACKDATING)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=signs, path_length=0 if signs else None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
    trusted = x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key())
    for extension in (trusted, *extensions):
        builder = builder.add_extension(extension, critical=False)
    return builder.sign(signer, SHA256())
