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
DEVICES = [Device(WORLD_NAME, LOCAL_HOSTS), Device(BENCH_NAME), Device("7")]
pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed here")


@pytest.fixture
def made(tmp_path: Path) -> Path:
    create(tmp_path / "keys", DEVICES, NOW, days=30, authority_days=300)
    return tmp_path / "keys"


def openssl(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True)


def verify(folder: Path, purpose: str, *options: str) -> subprocess.CompletedProcess[str]:
    at = str(int((NOW + timedelta(days=1)).timestamp()))
    trusted = ("-x509_strict", "-no-CApath", "-no-CAstore", "-CAfile", folder / "authority.pem")
    time = () if "-attime" in options else ("-attime", at)
    return openssl("verify", *trusted, *time, "-purpose", purpose, *options, folder / "certificate.pem")


@pytest.mark.parametrize(
    ("folder", "purpose", "accepted"),
    [
        ("world", "sslserver", True),
        ("world", "sslclient", False),
        ("bench", "sslclient", True),
        ("robot-7", "sslclient", True),
        ("robot-7", "sslserver", False),
    ],
)
def test_openssl_takes_each_certificate_for_its_purpose_alone(
    made: Path, folder: str, purpose: str, accepted: bool
) -> None:
    assert (verify(made / folder, purpose).returncode == 0) is accepted


def test_openssl_takes_no_certificate_of_another_authority(made: Path, tmp_path: Path) -> None:
    create(tmp_path / "others", DEVICES, NOW, days=30, authority_days=300)
    shutil.copy(tmp_path / "others" / "robot-7" / "authority.pem", made / "robot-7")
    assert verify(made / "robot-7", "sslclient").returncode != 0


@pytest.mark.parametrize(("days", "accepted"), [(-1.01, False), (-0.99, True), (29.99, True), (30.01, False)])
def test_openssl_takes_them_from_a_day_before_they_were_made_until_their_end(
    made: Path, days: float, accepted: bool
) -> None:
    at = int((NOW + timedelta(days=days)).timestamp())
    assert (verify(made / "robot-7", "sslclient", "-attime", str(at)).returncode == 0) is accepted


@pytest.mark.parametrize("place", ["localhost", "127.0.0.1"])
def test_openssl_finds_the_worlds_hosts_and_no_others(made: Path, place: str) -> None:
    option = "-verify_ip" if place[0].isdigit() else "-verify_hostname"
    assert verify(made / "world", "sslserver", option, place).returncode == 0
    assert (
        verify(made / "world", "sslserver", option, place.replace("l", "x").replace("7", "8")).returncode != 0
    )


def test_openssl_reads_the_common_name(made: Path) -> None:
    said = openssl(
        "x509", "-in", made / "world" / "certificate.pem", "-noout", "-subject", "-nameopt", "RFC2253"
    )
    assert said.stdout == "subject=CN=@world\n"
