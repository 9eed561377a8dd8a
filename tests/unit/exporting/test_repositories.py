"""Code repositories of CDFs in an export's build contexts: strangers' files, which are written on this machine."""

from __future__ import annotations

from pathlib import Path

from srprov.definitions import load_experiment
from srprov.exporting.images import built
from srprov.exporting.variables import Open
from srprov.images.plan import Checkout, ContextFile

_CDF = "cdf: 1\nbase: debian:bookworm\nrepositories: [{git: 'https://example.org/a.git', path: /ws}]\n"


def _file(path: str) -> ContextFile:
    return ContextFile(path=path, content=b"x", mode=0o644)


def test_what_version_control_calls_its_own_is_left_out_and_told(tmp_path: Path) -> None:
    (tmp_path / "e.edf").write_text("edf: 1\nname: e\nservices: {a: {cdf: a.cdf}}\n")
    (tmp_path / "a.cdf").write_text(_CDF)
    holds = Checkout(commit="0" * 40, files=(_file("a.py"), _file(".dvc/config"), _file("b/.hg/hgrc")))
    containers = load_experiment(str(tmp_path / "e.edf")).containers
    [made] = built(containers, lambda _: (), lambda _: b"", lambda _cdf, _index: holds, Open()).values()
    assert [one.path for one in made.files] == ["Dockerfile", "repositories/0/a.py"]
    why = "a repository here could name programs"
    assert made.moving == (f"a: repositories/0/.dvc/config and the like are left out: {why}",)
