"""--engine: which address it takes, who gets it, and what `worker` says before it serves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run
from tests.unit.cli.test_sharing import FACTS, asked

SCHEDULER = "tls://127.0.0.1:8786"
__all__ = ["asked"]


def test_it_reaches_whoever_connects(asked: list[dict[str, Any]]) -> None:
    assert run(FACTS) == 0 and run([*FACTS, "--engine", SCHEDULER]) == 0
    assert [one["scheduler"] for one in asked] == ["", SCHEDULER]


@pytest.mark.parametrize("words", [FACTS, ["worker", "--site", "west"]])
def test_a_scheduler_without_tls_is_refused(
    words: list[str], asked: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is sent or asked for."""
    assert run([*words, "--engine", "tcp://127.0.0.1:8786"]) == 9 and not asked
    assert "error[SRP-524]: --engine tcp://127.0.0.1:8786: only tls:// is spoken" in capsys.readouterr().err


def test_what_is_no_address_is_told(asked: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*FACTS, "--engine", "127.0.0.1:8786"]) == 5 and not asked
    assert "write tls://HOST:PORT" in capsys.readouterr().err


def test_one_s_own_configuration_may_set_it_and_a_project_may_not(
    asked: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It says where passwords and secrets go."""
    (tmp_path / "srprov.toml").write_text(f'engine = "{SCHEDULER}"\n')
    (tmp_path / "srprov.toml").chmod(0o600)
    assert run(FACTS) == 5 and not asked
    assert "engine" in capsys.readouterr().err
    own = tmp_path / "home" / "srprov" / "srprov.toml"
    own.parent.mkdir(parents=True)
    (tmp_path / "srprov.toml").rename(own)
    assert run(FACTS) == 0 and asked[0]["scheduler"] == SCHEDULER


@pytest.mark.parametrize(("site", "code"), [("west", 0), ("West", 5), ("a b", 5), ("", 5), ("w\n", 5), ("x" * 64, 5)])
def test_a_site_has_a_plain_name(site: str, code: int, asked: list[dict[str, Any]], tmp_path: Path) -> None:
    (tmp_path / "inv.yml").write_text(f"all: {{hosts: {{r1: {{srprov_site: {site!r}}}}}}}\n".replace("'", '"'))
    assert run(FACTS) == code


def test_worker_without_certificates_says_which(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["worker", "--site", "west", "--engine", SCHEDULER]) == 5
    said = capsys.readouterr().err
    assert "distributed.comm.tls.ca-file of Dask's configuration is not set" in said
    assert "DASK_DISTRIBUTED__COMM__TLS__CA_FILE" in said


@pytest.mark.parametrize("site", ["West", "a b", "", "x" * 64])
def test_worker_takes_no_name_that_an_inventory_cannot_have(site: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Else it would serve, and nobody would ever find it."""
    assert run(["worker", "--site", site, "--engine", SCHEDULER]) == 5
    assert "cannot be the name of a site" in capsys.readouterr().err
