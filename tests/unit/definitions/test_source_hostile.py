"""git's configuration of a stranger's project is read, or passed over, in no time."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions.source import source_of
from tests.bounded import bounded
from tests.unit.definitions.test_source import URL, edf, repository


def configured(folder: Path, config: str) -> Path:
    path = repository(folder)
    (folder / ".git" / "config").write_text(config)
    return path


@pytest.mark.parametrize(
    "config",
    [
        "[core]\nbare\n  x = 1\n",
        f"[core]\na{' ' * 65_000}b\n",
        f'[remote "origin"]\nurl{" " * 65_000}b\n',
        f'[remote "origin"{" " * 65_000}b\n',
        "\n" * 65_536,
        "[" * 65_000,
    ],
)
def test_settings_of_any_form_are_passed_over(tmp_path: Path, config: str) -> None:
    path = configured(tmp_path, config)
    assert bounded(lambda: source_of(str(path)), cpu_s=0.5).endswith(f":{path}")


def test_settings_in_each_folder_above_are_read_up_to_a_limit(tmp_path: Path) -> None:
    folder = tmp_path
    for _ in range(200):
        folder /= "a"
        (folder / ".git").mkdir(parents=True)
        (folder / ".git" / "config").write_text("\n" * 65_536)
    path = edf(folder)
    assert bounded(lambda: source_of(str(path)), cpu_s=0.5).endswith(f":{path}")


@pytest.mark.parametrize(
    "config",
    [
        f'[core]\n\tbare\n\t  x = 1\n[remote "origin"]\n\turl = {URL}\n\t\tfetch = +refs/heads/*:refs/x/*\n',
        f'# [remote "x"]\n[remote "origin"] ; ours\r\n\tURL={URL}\r\n\t; url = https://git.example/other\r\n',
        f'[remote "origin"]\n\turl = https://git.example/a\n\tprune\n[x]\nurl = x\n[remote "origin"]\n\turl = {URL}\n',
    ],
)
def test_settings_are_read_as_git_has_them(tmp_path: Path, config: str) -> None:
    """What is further in than the line before is a line of its own; comments and any case; the last one counts."""
    assert source_of(str(configured(tmp_path, config))) == f"{URL}#demo/e.edf"


@pytest.mark.parametrize("config", [f'[DEFAULT]\nurl = {URL}\n[remote "origin"]\n', f'[remote "other"]\nurl = {URL}\n'])
def test_no_other_section_has_the_url(tmp_path: Path, config: str) -> None:
    path = configured(tmp_path, config)
    assert source_of(str(path)).endswith(f":{path}")
