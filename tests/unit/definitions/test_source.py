"""The text that tells where an experiment comes from: what it takes of git's configuration, and what it does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions.source import source_of

URL = "https://git.example/team/robots.git"


def repository(folder: Path, url: str = URL) -> Path:
    """Make a folder that looks like a checkout of `url`, and return the EDF in it."""
    (folder / ".git").mkdir(parents=True)
    (folder / ".git" / "config").write_text(f'[remote "origin"]\n\turl = {url}\n')
    return edf(folder)


def edf(folder: Path) -> Path:
    """Make a folder with an EDF in `demo`, and return its path."""
    (folder / "demo").mkdir(parents=True)
    (folder / "demo" / "e.edf").write_text("edf: 1\n")
    return folder / "demo" / "e.edf"


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        (URL, URL),
        ("https://ada:secret@Git.Example:8443/x", "https://git.example:8443/x"),
        ("https://git.example/x?token=secret#secret", "https://git.example/x"),
        ("git@git.example:team/x.git", "ssh://git.example/team/x.git"),
        ("ada:secret@git.example:team/x.git", "ssh://git.example/team/x.git"),
        ("ssh://git@[fd00::1]:22/x", "ssh://[fd00::1]:22/x"),
    ],
)
def test_of_a_remote_only_scheme_host_and_path_are_taken(tmp_path: Path, url: str, shown: str) -> None:
    assert source_of(str(repository(tmp_path, url))) == f"{shown}#demo/e.edf"


@pytest.mark.parametrize(
    "url",
    [
        "https://user:pa/ss@host/secret",
        "https://user:12/secret@host/x",
        "https://git.example/secret\u202e",
        "https://git.example/secret\n  second line",
        f"https://git.example/secret{'x' * 1024}",
        "/srv/git/secret",
        "file:///srv/secret",
        "https://[secret/x",
    ],
)
def test_a_remote_of_another_form_is_not_shown(tmp_path: Path, url: str) -> None:
    """A password with a slash, two lines, too long, no host: the EDF counts by its path."""
    path = repository(tmp_path, url)
    assert source_of(str(path)).endswith(f":{path}")
    assert "secret" not in source_of(str(path)).removesuffix(str(path))


@pytest.mark.parametrize("kind", ["gitdir", "link", "link to the configuration", "second name of the configuration"])
def test_nothing_leads_to_the_configuration_of_another_repository(tmp_path: Path, kind: str) -> None:
    repository(tmp_path / "private", "https://intern.example/secret")
    path = edf(tmp_path / "project")
    git, private = tmp_path / "project" / ".git", tmp_path / "private" / ".git"
    if kind == "gitdir":
        git.write_text(f"gitdir: {private}\n")
    elif kind == "link":
        git.symlink_to(private)
    elif kind == "link to the configuration":
        git.mkdir()
        (git / "config").symlink_to(private / "config")
    else:
        git.mkdir()
        (git / "config").hardlink_to(private / "config")
    assert source_of(str(path)).endswith(f":{path}")
