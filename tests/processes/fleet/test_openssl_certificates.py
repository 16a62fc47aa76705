"""The certificates of ``unspoken keys``, judged by OpenSSL."""

import shutil
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from fleet.keys.authority import LOCAL_HOSTS, Device
from fleet.keys.folders import create
from protocol.keys import BENCH_NAME, WORLD_NAME

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
FOLDERS = ("world", "bench", "robot-7")
DEVICES = [Device(WORLD_NAME, LOCAL_HOSTS), Device(BENCH_NAME), Device("7")]
pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed here")


@pytest.fixture
def made(tmp_path: Path) -> Path:
    create(tmp_path / "keys", DEVICES, NOW, days=30, authority_days=300)
    return tmp_path / "keys"


def openssl(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True)


def verify(folder: Path, purpose: str, *options: object, days: float = 1.0) -> bool:
    """Whether OpenSSL takes a certificate for a purpose, so many days after it was made."""
    at = int((NOW + timedelta(days=days)).timestamp())
    trusted = ("-x509_strict", "-no-CApath", "-no-CAstore", "-CAfile", folder / "authority.pem")
    asked = ("-attime", at, "-purpose", purpose, *options, folder / "certificate.pem")
    return openssl("verify", *trusted, *asked).returncode == 0


def test_openssl_takes_each_certificate_for_its_purpose_alone(made: Path) -> None:
    purposes = ("sslserver", "sslclient")
    taken = {(each, purpose) for each in FOLDERS for purpose in purposes if verify(made / each, purpose)}
    assert taken == {("world", "sslserver"), ("bench", "sslclient"), ("robot-7", "sslclient")}


def test_openssl_takes_no_certificate_of_another_authority(made: Path, tmp_path: Path) -> None:
    create(tmp_path / "others", DEVICES, NOW, days=30, authority_days=300)
    shutil.copy(tmp_path / "others" / "robot-7" / "authority.pem", made / "robot-7")
    assert not verify(made / "robot-7", "sslclient")


def test_openssl_takes_them_from_a_day_before_they_were_made_until_their_end(made: Path) -> None:
    for days, taken in ((-1.01, False), (-0.99, True), (29.99, True), (30.01, False)):
        assert verify(made / "robot-7", "sslclient", days=days) is taken, days


def test_openssl_finds_the_worlds_hosts_and_no_others(made: Path) -> None:
    for option, right, wrong in (
        ("-verify_hostname", "localhost", "xocaxhost"),
        ("-verify_ip", "127.0.0.1", "128.0.0.1"),
    ):
        assert verify(made / "world", "sslserver", option, right)
        assert not verify(made / "world", "sslserver", option, wrong)


def test_openssl_reads_the_common_name(made: Path) -> None:
    certificate = made / "world" / "certificate.pem"
    said = openssl("x509", "-in", certificate, "-noout", "-subject", "-nameopt", "RFC2253")
    assert said.stdout == "subject=CN=@world\n"
