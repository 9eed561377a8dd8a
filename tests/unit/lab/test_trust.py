"""What of this machine's settings is in the lab's images, and that nothing else is."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.lab import trust, trust_apt
from srprov.lab.plain_address import plain_address, plain_proxy

LOGINS = ("ann:hunter2", "ann:hun'ter2", "ann:hun#ter2", "ann:hun?ter2", "ann:hun ter2", "ann:hunter2@", "hunter2", '"')
"""Apt goes by a proxy with each of them; the last one ends its text."""


def test_pip_settings_keep_the_index_and_leave_out_files() -> None:
    real = """[global]
cert = /old
index-url = https://index.example/simple
extra-index-url = file:///here https://more.example/100%/simple
find-links = /wheels
"""
    assert trust.pip_conf(real, "/bundle") == (
        "[global]\ncert = /bundle\nindex-url = https://index.example/simple\n"
        "extra-index-url = https://more.example/100%/simple\n\n"
    )


@pytest.mark.parametrize("login", LOGINS)
def test_an_address_has_no_login_whatever_is_in_it(login: str) -> None:
    assert plain_address(f"http://{login}@proxy.example:3128/a/b") == "http://proxy.example:3128/a/b"
    assert plain_proxy(f"{login}@[fd00::1]:3128") == "[fd00::1]:3128"


@pytest.mark.parametrize(
    "text", ["http://ann:hun/ter2@proxy.example", "http://h/?token=x", "http://h/#x", "http://h/a@b", "ftp://h", "x y"]
)
def test_an_address_of_another_form_is_none(text: str) -> None:
    assert plain_address(text) == ""


def test_no_password_of_this_machine_goes_into_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stranger's container of a lab reads its image."""
    there = {
        "/etc/apt/sources.list": "deb [trusted=yes x=hunter2] http://ann:hunter2@mirror.example/debian bookworm main\n"
        "deb http://mirror.example/debian bookworm main # ann:hunter2\n",
        "/etc/apt/apt.conf": 'Acquire::http::Proxy "http://ann:hunter2@proxy.example:3128/"; Acquire::Retries "3";\n',
        "/etc/apt/apt.conf.d/mine": 'Acquire::Retries "3"; // user@example\n',
        "/etc/pip.conf": "[global]\nindex-url = https://__token__:hun'ter2@index.example/simple\n"
        "proxy = ann:hunter2@proxy.example:3128\n",
    }
    monkeypatch.setattr(trust, "_read", lambda path: there.get(str(path), ""))
    monkeypatch.setattr(trust, "_source_files", lambda: [Path("/etc/apt/sources.list")])
    monkeypatch.setattr(trust, "_setting_files", lambda: [Path(one) for one in there if "/apt.conf" in one])
    monkeypatch.setattr(
        trust, "_apt_config", lambda: 'Acquire::http::Proxy "http://ann:hunt@er2@proxy.example:3128/";\n'
    )
    made = trust.files()
    assert not [path for path, content in made.items() if any(one in content for one in (b"ter2", b"er2", b"ann:"))]
    lines = made["etc/apt/sources.list"].decode().splitlines()
    assert lines == [f"deb {it}http://mirror.example/debian bookworm main" for it in ("[trusted=yes] ", "")]
    assert made["etc/apt/apt.conf.d/90machine"] == b'Acquire::http::Proxy "http://proxy.example:3128/";\n'
    assert b"proxy = proxy.example:3128" in made["etc/pip.conf"]
    assert set(there) - set(trust.kept_here()) == {"/etc/apt/apt.conf.d/mine"}


def test_of_apt_s_settings_only_proxies_and_figures_are_taken() -> None:
    """Whatever else stands there may be a password: a command, a header, a login."""
    kept = [
        'Acquire::http::Proxy::mirror.example "DIRECT";',
        'Acquire::https::Proxy "https://proxy.example";',
        'Acquire::https::mirror.example::Verify-Peer "false";',
        'Acquire::Check-Valid-Until "false";',
        'Acquire::http::Timeout "20";',
    ]
    left = [
        'Acquire::ftp::ProxyLogin:: "PASS hunter2";',
        'Acquire::http::User-Agent "hunter2";',
        'Acquire::http::Timeout "hunter2";',
        'Acquire::http::Proxy-Auto-Detect "/usr/bin/hunter2";',
        'DPkg::Post-Invoke:: "curl https://hooks.example/hunter2";',
        'CommandLine::AsString "hunter2";',
    ]
    assert trust_apt.settings("\n".join([*left, *kept])).splitlines() == kept


def test_a_key_beside_a_certificate_stays_here() -> None:
    one = b"-----BEGIN CERTIFICATE-----\nMIIB\n-----END CERTIFICATE-----\n"
    key = b"-----BEGIN PRIVATE KEY-----\nhunter2\n-----END PRIVATE KEY-----\n"
    assert trust.certificates(b"# of ann\n" + one + key + one) == one + one
    assert trust.certificates(key) == b""


def test_a_stanza_of_sources_has_known_fields_alone() -> None:
    text = """# ann:hunter2
Types: deb
URIs: http://ann:hun'ter2@mirror.example/debian/
 http://other.example/debian
Suites: bookworm bookworm-updates
Components: main
X-Login: hunter2
Signed-By:
 -----BEGIN PGP PUBLIC KEY BLOCK-----
"""
    assert trust_apt.stanza(text) == (
        "Types: deb\nURIs: http://mirror.example/debian/ http://other.example/debian\n"
        "Suites: bookworm bookworm-updates\nComponents: main"
    )


@pytest.mark.parametrize(
    ("source", "ours"),
    [
        ("deb http://mirror.example/debian bookworm main", True),
        ("deb http://mirror.example/debian-security bookworm-security main", True),
        ("deb http://mirror.example/debian trixie main", False),
        ("deb http://vendor.example/apt bookworm main", False),
        ("# deb http://mirror.example/debian bookworm main", False),
        ("Types: deb\nURIs: http://mirror.example/debian/\nSuites: bookworm", True),
        ("Types: deb\nURIs: http://vendor.example/node\nSuites: nodistro", False),
    ],
)
def test_only_debians_own_sources_go_into_the_image(source: str, ours: bool) -> None:
    assert trust_apt.is_debian(source) is ours
