"""--workers and --connect-rate reach whoever connects, from the command line and from configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run
from srprov.transport import pool
from tests.fakes import World

FACTS = ["facts", "-i", "inv.yml"]


@pytest.fixture
def asked(world: World, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Give what sessions are made with."""
    made: list[dict[str, Any]] = []
    sessions: Any = pool.Sessions

    def noted(hosts: Any, **more: Any) -> Any:
        made.append(more)
        return sessions(hosts, **more)

    monkeypatch.setattr(pool, "Sessions", noted)
    return made


def test_without_a_word_this_process_has_all_connections(asked: list[dict[str, Any]]) -> None:
    assert run(FACTS) == 0
    assert (asked[0]["workers"], asked[0]["rate_per_s"]) == (1, pool.RATE_PER_S)


def test_there_are_no_more_workers_than_robots_and_few_robots_need_none(asked: list[dict[str, Any]]) -> None:
    for word in ("2", "9", "auto"):
        assert run([*FACTS, "--workers", word, "--connect-rate", "7.5"]) == 0
    assert [(one["workers"], one["rate_per_s"]) for one in asked] == [(2, 7.5), (2, 7.5), (1, 7.5)]


def test_a_project_may_set_workers_but_not_the_rate(
    asked: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "srprov.toml").write_text("workers = 2\n")
    (tmp_path / "srprov.toml").chmod(0o600)
    assert run(FACTS) == 0 and asked[0]["workers"] == 2
    (tmp_path / "srprov.toml").write_text("connect-rate = 1000\n")
    assert run(FACTS) == 5 and "connect-rate" in capsys.readouterr().err


@pytest.mark.parametrize("word", ["0", "-1", "257", "many", "1.5", "²", ""])
def test_what_is_no_number_of_processes_is_refused(
    asked: list[dict[str, Any]], capsys: pytest.CaptureFixture[str], word: str
) -> None:
    assert run([*FACTS, f"--workers={word}"]) == 5 and not asked
    assert "--workers" in capsys.readouterr().err
