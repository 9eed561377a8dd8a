"""What is read before a run: no repository of this machine is opened because a fetched CDF names it."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.controller.source import fetched
from srprov.errors import RefusedError


def test_a_repository_of_this_machine_that_a_fetched_cdf_names_is_asked_for_before_git_opens_it(tmp_path: Path) -> None:
    edf, tree, opened = tmp_path / "x.edf", tmp_path / "tree", []
    tree.mkdir()
    edf.write_text("edf: 1\nname: x\nservices:\n  s:\n    cdf: {git: 'https://example.org/a.git', path: a.cdf}\n")
    (tree / "a.cdf").write_text("cdf: 1\nextends: {git: 'file:///home/victim/secret.git', path: b.cdf}\n")
    (tree / "b.cdf").write_text("cdf: 1\nbase: busybox:1\n")

    def fetch(url: str, _ref: str) -> str:
        opened.append(url)
        return str(tree)

    with pytest.raises(RefusedError, match=r"/home/victim/secret\.git"):
        fetched(str(edf), ["git"], fetch)
    assert opened == ["https://example.org/a.git"]
    assert fetched(str(edf), ["git", "outside"], fetch).containers
