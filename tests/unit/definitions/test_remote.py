"""CDFs in git repositories: nothing is fetched to check files, and what was fetched is a CDF as any other."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import check_files, load_experiment
from srprov.errors import DefinitionError
from srprov.planning.policy import permissions

URL = "https://h/cdfs.git"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "exp").mkdir()
    (tmp_path / "tree" / "sub").mkdir(parents=True)
    (tmp_path / "tree" / "sub" / "a.cdf").write_text(
        "cdf: 1\nextends: ../base.cdf\nfiles: [{src: f, dest: /f}]\nvolumes: ['./f:/g']\nrequires: {tags: [camera]}\n"
    )
    (tmp_path / "tree" / "sub" / "f").write_text("f")
    (tmp_path / "tree" / "base.cdf").write_text("cdf: 1\nbase: busybox\npackages: {apt: [curl]}\n")
    (tmp_path / "victim.cdf").write_text("cdf: 1\nbase: secret-of-the-victim\n")
    monkeypatch.chdir(tmp_path / "exp")
    return tmp_path


def _edf(here: Path, cdf: str) -> Path:
    (here / "exp" / "e.edf").write_text(f"edf: 1\nname: demo\nservices:\n  s: {{cdf: {cdf}}}\n")
    return here / "exp" / "e.edf"


REMOTE = f"{{git: '{URL}', ref: v1, path: sub/a.cdf}}"


def test_without_fetching_it_is_noted_and_valid(here: Path) -> None:
    (here / "exp" / "t.cdf").write_text(f"cdf: 1\nextends: {REMOTE}\n")
    for cdf, line in ((REMOTE, 4), ("t.cdf", 2)):
        read = load_experiment(_edf(here, cdf), {})
        assert read.experiment.remote == (("s", URL, "v1"),)
        (problem,) = read.unsupported
        assert (problem.location.line, problem.message.endswith("is fetched by plan and apply, with --allow git")) == (
            line,
            True,
        )
        assert check_files(["e.edf"]) == []
        asked = permissions(read.experiment, read.containers)
        assert [(one.kind, one.what) for one in asked] == [
            ("git", f"{URL}, v1: fetched here, a CDF in it says what the container is")
        ]


def test_what_was_fetched_is_a_cdf_as_any_other(here: Path) -> None:
    """Its files are beside it; nothing of the tree is asked for as a file outside."""
    asked: list[tuple[str, str]] = []

    def fetch(url: str, ref: str) -> str:
        asked.append((url, ref))
        return str(here / "tree")

    (here / "exp" / "t.cdf").write_text(f"cdf: 1\nextends: {REMOTE}\nrun: [own]\n")
    for cdf in (REMOTE, "t.cdf"):
        read = load_experiment(_edf(here, cdf), {}, fetch)
        (one,) = read.containers.values()
        assert (one.base, one.apt, one.files[0].source) == ("busybox", ("curl",), str(here / "tree" / "sub" / "f"))
        service = read.experiment.services["s"]
        assert (service.requires.tags, service.runtime.mounts[0].source) == (
            ("camera",),
            str(here / "tree" / "sub" / "f"),
        )
        assert (read.experiment.outside, read.unsupported, service.cdf) == ((), (), one.file)
    assert asked == [(URL, "v1")] * 2


@pytest.mark.parametrize(
    ("cdf", "message"),
    [
        ("{git: 'ext::sh -c x', path: a.cdf}", "is no address that srprov fetches from"),
        (f"{{git: '{URL}', ref: --x, path: a.cdf}}", "is no name of a branch"),
        (f"{{git: '{URL}', path: ../victim.cdf}}", "'../victim.cdf' is no path in a repository"),
        (f"{{git: '{URL}', path: /etc/passwd}}", "'/etc/passwd' is no path in a repository"),
        (f"{{git: '{URL}', path: nothing.cdf}}", f"there is no CDF 'nothing.cdf' in {URL}"),
        (f"{{git: '{URL}', path: link.cdf}}", f"there is no CDF 'link.cdf' in {URL}"),
        (f"{{git: '{URL}', ref: gone, path: a.cdf}}", "no branch"),
        (f"{{git: '{URL}', path: round.cdf}}", "is not valid; what is wrong is not shown"),
    ],
)
def test_what_is_wrong_is_told_at_its_line(here: Path, cdf: str, message: str) -> None:
    (here / "tree" / "link.cdf").symlink_to(here / "victim.cdf")
    (here / "tree" / "round.cdf").write_text(f"cdf: 1\nextends: {{git: '{URL}', path: round.cdf}}\n")

    def fetch(url: str, ref: str) -> str:
        if ref == "gone":
            raise ValueError("no branch")
        return str(here / "tree")

    with pytest.raises(DefinitionError) as refused:
        load_experiment(_edf(here, cdf), {}, fetch)
    (problem,) = refused.value.problems
    assert message in problem.message
    assert problem.location.line == 4 or "not shown" in message


def test_what_a_fetched_cdf_takes_from_elsewhere_is_asked_for_and_not_shown(here: Path) -> None:
    """A relative path out of the repository leads to any file of this machine."""
    (here / "tree" / "sub" / "a.cdf").write_text("cdf: 1\nextends: ../../victim.cdf\n")
    read = load_experiment(_edf(here, REMOTE), {}, lambda url, ref: str(here / "tree"))
    assert read.unsupported and read.experiment.outside == (("s", str(here / "victim.cdf")),)
    read = load_experiment(_edf(here, REMOTE), {}, lambda url, ref: str(here / "tree"), outside=True)
    assert read.experiment.outside == (("s", str(here / "victim.cdf")),)
    (here / "victim.cdf").write_text("secret-of-the-victim\n")
    with pytest.raises(DefinitionError) as refused:
        load_experiment(_edf(here, REMOTE), {}, lambda url, ref: str(here / "tree"), outside=True)
    assert "secret" not in str([(one.message, one.excerpt, one.hint) for one in refused.value.problems])


def test_a_repository_on_this_machine_is_asked_for_as_a_file_outside(here: Path) -> None:
    url = f"file://{here}/cdfs.git"
    read = load_experiment(_edf(here, f"{{git: '{url}', path: a.cdf}}"), {})
    assert read.experiment.outside == (("s", f"{here}/cdfs.git"),)
