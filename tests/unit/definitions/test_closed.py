"""Before `--allow outside` nothing is looked at that is not the experiment's own: no word depends on what is there."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.definitions import load_experiment

NAMED = {
    "CDF": ("{cdf: PLACE}", "", ""),
    "extends": ("{cdf: t.cdf}", "cdf: 1\nextends: PLACE\nexpose: [80]\n", ""),
    "waits for its health": (
        "{cdf: t.cdf}\n  b: {image: x, depends_on: {a: {condition: service_healthy}}}",
        "cdf: 1\nextends: PLACE\n",
        "",
    ),
    "seed of its volume": ("{cdf: PLACE}", "", "volumes: {maps: {seed: seed}}\n"),
}
KEPT = {
    "Dockerfile": ("{cdf: t.cdf}", "cdf: 1\ndockerfile: PLACE\n", ""),
    "its context": ("{cdf: t.cdf}", "cdf: 1\ndockerfile: {context: PLACE, dockerfile: D, args: {A: b}}\n", ""),
    "its ARG": ("{cdf: t.cdf}", "cdf: 1\ndockerfile: {context: ., dockerfile: PLACE, args: {A: b}}\n", ""),
    "variables": ("{image: x, env_file: PLACE}", "", ""),
    "playbook": ("{image: x}", "", "playbooks: {before: [PLACE]}\n"),
    "shipped": ("{image: x, volumes: ['./PLACE:/x:ro']}", "", ""),
    "data": ("{image: x, data: [{path: PLACE, target: /x}]}", "", ""),
    "data by hash": (f"{{image: x, data: [{{path: PLACE, target: /x, sha256: {'0' * 64}}}]}}", "", ""),
    "built in": ("{cdf: t.cdf}", "cdf: 1\nbase: x\nfiles: [{src: PLACE, dest: /x}]\n", ""),
    "seed": ("{image: x, volumes: ['maps:/m']}", "", "volumes: {maps: {seed: PLACE}}\n"),
}
"""What has to lie in the folder; so what lies there and is not the experiment's own."""


def _text(words: str) -> Callable[[Path], object]:
    return lambda place: place.write_text(words)


THERE: Mapping[str, Callable[[Path], object]] = {
    "nothing": lambda place: None,
    "a folder": lambda place: place.mkdir(),
    "a pipe": os.mkfifo,
    "no text": _text("a: b: c\n"),
    "a CDF": _text("cdf: 1\nimage: busybox\nvolumes: ['maps:/m']\nhealthcheck: {test: [CMD, 'true']}\n"),
    "another CDF": _text("cdf: 1\nbase: busybox\nports: ['80:80']\n"),
    "a Dockerfile": _text("FROM busybox\nARG A\n"),
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for folder in ("mine", "exp/seed", "exp/.git"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "exp/inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    (tmp_path / "exp/.git/D").write_text("FROM busybox\n")
    monkeypatch.chdir(tmp_path / "exp")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path


def told(service: str, cdf: str, top: str, place: str, capsys: pytest.CaptureFixture[str]) -> list[tuple[int, str]]:
    """Return what each verb says of an experiment."""
    Path("t.cdf").write_text(cdf.replace("PLACE", place))
    text = f"edf: 1\nname: e\nservices:\n  a: {service}\n{top}".replace("PLACE", place)
    Path("e.edf").write_text(text)
    said = []
    for words in (
        ["validate", "e.edf"], ["validate", "t.cdf"], ["validate", "--format", "json", "e.edf"],
        ["plan", "e.edf", "-i", "inv.yml"], ["plan", "e.edf", "-i", "inv.yml", "--allow", "env"],
        ["assign", "e.edf", "-i", "inv.yml"], ["build", "--show", "e.edf"], ["trials", "e.edf"],
        ["lock", "e.edf", "-i", "inv.yml"], ["run", "e.edf", "-i", "inv.yml", "--yes"],
    ):  # fmt: skip
        if words[:2] != ["validate", "t.cdf"] or cdf:
            status = run(words)
            said.append((status, "".join(capsys.readouterr())))
    return said


@pytest.mark.parametrize(
    ("named", "place"),
    [(one, place) for one in NAMED for place in ("../mine/x", ".git/x", "away/x")] + [(one, ".git/x") for one in KEPT],
)
def test_no_word_depends_on_what_is_elsewhere(
    here: Path, capsys: pytest.CaptureFixture[str], named: str, place: str
) -> None:
    Path("away").symlink_to("../mine")
    at, words = Path(place), {**NAMED, **KEPT}[named]
    said = {}
    for name, make in THERE.items():
        shutil.rmtree(at) if at.is_dir() else at.unlink(missing_ok=True)
        make(at)
        said[name] = told(*words, place, capsys)
    assert all(one == said["nothing"] for one in said.values())
    assert any("--allow outside" in text for _, text in said["nothing"])
    assert {status for status, text in said["nothing"] if "--allow outside" in text} <= {0, 9}
    assert str(os.path.realpath(at)) in said["nothing"][-1][1], "it is named"


@pytest.mark.parametrize("place", ["../mine/x", ".git/x"])
def test_no_such_file_is_opened(here: Path, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    Path(place).write_text("cdf: 1\nimage: busybox\n")
    Path("e.edf").write_text(f"edf: 1\nname: e\nservices: {{a: {{cdf: {place}}}}}\n")
    opened, real = list[str](), os.open

    def noted(path: str, *more: int, **others: int) -> int:
        opened.append(os.fspath(path))
        return real(path, *more, **others)

    monkeypatch.setattr(os, "open", noted)
    assert load_experiment("e.edf", {}).unsupported
    assert not [one for one in opened if one.endswith("/x")]
    assert not load_experiment("e.edf", {}, outside=True).unsupported
    assert [one for one in opened if one.endswith("/x")]


def test_with_permission_all_is_read_as_before(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("../mine/x").write_text("cdf: 1\nimage: busybox\nvolumes: ['maps:/m']\n")
    Path("e.edf").write_text("edf: 1\nname: e\nservices: {a: {cdf: ../mine/x}}\nvolumes: {map: {seed: seed}}\n")
    assert run(["validate", "e.edf"]) == 0
    assert "it is not looked at without `--allow outside`" in capsys.readouterr().out
    assert run(["validate", "--allow", "outside", "e.edf"]) == 5
    assert "of which nothing is shown" in capsys.readouterr().out


@pytest.mark.parametrize("services", ["{cdf: d/real.cdf}", "{cdf: t.cdf}", "{image: x, env_file: d/v.env}"])
def test_a_way_that_leads_out_and_back_is_closed(here: Path, services: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The kernel looks at each folder on it: whether it is there, and where it leads if it is a link."""
    Path("real.cdf").write_text("cdf: 1\nimage: busybox\n")
    Path("v.env").write_text("A=1\n")
    Path("d").symlink_to("../mine/sec/../../exp")
    sec, said = here / "mine/sec", []
    for make in (lambda: None, sec.mkdir, lambda: sec.symlink_to("../exp/seed"), lambda: sec.symlink_to("/etc")):
        shutil.rmtree(sec) if sec.is_dir() and not sec.is_symlink() else sec.unlink(missing_ok=True)
        make()
        said.append(told(services, "cdf: 1\nextends: d/real.cdf\n", "", "", capsys))
    assert all(one == said[0] for one in said)
    assert "leaves the folder" in said[0][0][1] or "--allow outside" in said[0][0][1]


def test_an_edf_elsewhere_gives_a_cdf_no_folder(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`a.edf` is a link to any file of the user's: whether that names the CDF would tell what is in it."""
    Path("sub").mkdir()
    Path("sub/x.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: ../seed, dest: /x}]\n")
    Path("a.edf").symlink_to("../mine/a")
    said = set()
    for words in ("extends: sub/x.cdf\n", "extends: sub/y.cdf\n", "a: b: c\n"):
        (here / "mine/a").write_text(words)
        said.add((run(["validate", "sub/x.cdf"]), "".join(capsys.readouterr())))
    assert len(said) == 1
    Path("a.edf").unlink()
    Path("a.edf").write_text("edf: 1\nname: e\nservices: {a: {cdf: sub/x.cdf}}\n")
    assert run(["validate", "sub/x.cdf"]) == 0


@pytest.mark.parametrize("name", ["l.edf", "l.cdf", "l.yml", "Dockerfile", "sub/l.edf"])
@pytest.mark.parametrize("by", ["link", "second name"])
def test_what_is_checked_is_no_file_elsewhere(
    here: Path, name: str, by: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A check of all files of a project would tell of any file whether it is a definition that is right."""
    Path("sub").mkdir()
    Path("own.edf").write_text("edf: 1\nname: e\nservices: {a: {image: busybox}}\n")
    said = set()
    for words in ("edf: 1\nname: e\nservices: {a: {image: busybox}}\n", "cdf: 1\nimage: x\n", "a: b: c\n", "FROM x\n"):
        (here / "mine/a").write_text(words)
        Path(name).unlink(missing_ok=True)
        if by == "link":
            Path(name).symlink_to(here / "mine/a")
        else:
            os.link(here / "mine/a", name)
        for given in ([name], ["."], [str(here / "exp" / name)]):
            said.add((given[0], run(["validate", *given]), "".join(capsys.readouterr())))
    assert len(said) == 3 and {status for _, status, _ in said} == {0}
    assert any("it is not looked at without `--allow outside`" in text for given, _, text in said if given == name)
