"""Defaults from files: who wins, and what a stranger's file may not do."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.config import PERMISSIONS, default_map
from srprov.errors import UsageError

VERBS = {"plan": "", "apply": ""}


def write(path: Path, text: str) -> None:
    """Write a file and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_without_files_there_are_no_defaults(tmp_path: Path) -> None:
    """No file, no default."""
    assert default_map(VERBS, tmp_path, {"HOME": str(tmp_path)}) == {"plan": {}, "apply": {}}


def test_the_project_wins_over_the_user_and_a_verb_over_all(tmp_path: Path) -> None:
    """The nearer file wins, and inside a file the verb's own table."""
    write(tmp_path / ".config" / "srprov" / "srprov.toml", 'forks = 3\ntimeout = 7.0\nallow = ["device"]\n')
    write(tmp_path / "lab" / "pyproject.toml", "[tool.srprov]\nforks = 4\n[tool.other]\nforks = 9\n")
    write(tmp_path / "lab" / "srprov.toml", 'inventory = ["lab.yml"]\n[apply]\nforks = 5\nwait-timeout = 60\n')

    found = default_map(VERBS, tmp_path / "lab", {"HOME": str(tmp_path)})

    common = {"timeout": 7.0, "allow": ["device"], "inventories": ["lab.yml"]}
    assert found["plan"] == {**common, "forks": 4}
    assert found["apply"] == {**common, "forks": 5, "wait_timeout": 60}


@pytest.mark.parametrize("word", PERMISSIONS)
@pytest.mark.parametrize("text", ["{word} = true\n", "[apply]\n{word} = true\n"])
def test_a_projects_file_gives_no_permission(tmp_path: Path, word: str, text: str) -> None:
    """What a stranger may have written cannot allow anything."""
    write(tmp_path / "srprov.toml", text.format(word=word))

    with pytest.raises(UsageError, match=word):
        default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")})


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    """A file that is no TOML is an error that names it."""
    write(tmp_path / "srprov.toml", "forks = = 3\n")

    with pytest.raises(UsageError, match=r"srprov\.toml"):
        default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")})
