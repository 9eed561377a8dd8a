"""Of what lies in a record, or among an export's secrets, no line is shown, whatever names it."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.definitions.own_lines import is_users_own
from srprov.own_records import KEPT_OUT, record_around

CANARY = "hunter2-hunter2"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in (("out/secrets/.gitignore", KEPT_OUT), ("out/secrets/db", f"{CANARY} 'x\n")):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)
    return tmp_path


@pytest.mark.parametrize("service", ["image: busybox, env_file: out/secrets/db", "cdf: a.cdf"])
def test_validate_shows_no_line_of_a_secret(here: Path, capsys: pytest.CaptureFixture[str], service: str) -> None:
    Path("a.cdf").write_text("cdf: 1\ndockerfile: out/secrets/db\n")
    Path("e.edf").write_text(f"edf: 1\nname: nav\nservices: {{a: {{{service}}}}}\n")
    for named in ("e.edf", "a.cdf") if "cdf" in service else ("e.edf",):
        assert run(["validate", named]) != 0
        told = capsys.readouterr()
        assert "db" in told.out + told.err and CANARY not in told.out + told.err


def test_what_is_in_a_record_is_the_users_own_but_for_who_is_there_himself(here: Path) -> None:
    secret, inner = str(here / "out/secrets/db"), str(here / "out/secrets")
    assert is_users_own(secret, str(here), ()) and is_users_own(secret, str(here / "elsewhere"), ())
    assert not is_users_own(secret, inner, ())
    assert record_around(secret, str(here)) == inner and not record_around(str(here / "out"), str(here))
