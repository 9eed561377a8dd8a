"""A draft becomes a folder that validates, or nothing; and what the report says of it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from srprov import trees
from srprov.conversion import folder, report
from srprov.conversion.folder import check_target, write
from srprov.conversion.tree import Tree
from srprov.definitions import load_experiment
from srprov.errors import UsageError
from srprov.importing.normal import Refused
from tests.unit.conversion.making import draft, project

IMAGE = {"image": "busybox:1"}
MOUNT = {"volumes": [{"type": "bind", "source": ".", "target": "/ws"}]}


@pytest.fixture
def stack(tmp_path: Path) -> Path:
    """Give a folder as teams have them."""
    folder = tmp_path / "stack"
    for name in ("config", ".git", "sub"):
        (folder / name).mkdir(parents=True)
    (folder / "config" / "start.sh").write_text("#!/bin/sh\n")
    (folder / "config" / "start.sh").chmod(0o755)
    (folder / "config" / "link").symlink_to("start.sh")
    (folder / ".git" / "HEAD").write_text("x")
    (folder / "tok.txt").write_text("hunter2")
    (folder / "compose.yaml").write_text("services: {}\n")
    return folder


def made(stack: Path, services: dict[str, Any], **more: Any) -> Path:
    target = stack.parent / "out"
    write(draft(project(services, **more), stack, out="../out"), str(target), ["compose.yaml"])
    return target


def left(folder: Path) -> list[str]:
    return sorted(one.name for one in folder.iterdir())


def test_the_folder_validates_and_holds_what_is_mounted(stack: Path) -> None:
    use = {"secrets": [{"source": "tok", "target": "/run/secrets/tok"}]}
    target = made(stack, {"a": {**IMAGE, **MOUNT, **use}}, secrets={"tok": {"name": "lab_tok", "file": "./tok.txt"}})
    experiment = load_experiment(target / "experiment.edf").experiment
    assert experiment.services["a"].runtime.mounts[0].seed is not None
    assert os.path.normpath(experiment.secrets["tok"].file) == str(stack / "tok.txt")
    assert left(target) == ["experiment.edf", "files", "import-report.md"]
    assert (target / "files" / "config" / "start.sh").stat().st_mode & 0o111
    assert os.readlink(target / "files" / "config" / "link") == "start.sh"


def test_neither_secrets_nor_the_history_are_copied(stack: Path) -> None:
    use = {"secrets": [{"source": "tok", "target": "/run/secrets/tok"}]}
    target = made(stack, {"a": {**IMAGE, **MOUNT, **use}}, secrets={"tok": {"name": "lab_tok", "file": "./tok.txt"}})
    assert left(target / "files") == ["compose.yaml", "config", "sub"]
    assert not any(b"hunter2" in one.read_bytes() for one in target.rglob("*") if one.is_file())


def test_a_folder_inside_of_what_is_copied_does_not_copy_itself(stack: Path) -> None:
    target = stack / "out"
    target.mkdir()
    write(draft(project({"a": {**IMAGE, **MOUNT}}), stack), str(target), ["compose.yaml"])
    assert left(target / "files") == ["compose.yaml", "config", "sub", "tok.txt"]


@pytest.mark.parametrize("empty", [False, True])
def test_nothing_that_is_copied_makes_a_repository(stack: Path, *, empty: bool) -> None:
    """Where the project was cloned, git takes `.git`, and not what beside it would be a repository by itself."""
    (stack / "HEAD").write_text("ref: refs/heads/main\n")
    (stack / "objects").mkdir()
    (stack / "refs").mkdir() if empty else (stack / "refs").symlink_to("sub")
    with pytest.raises(UsageError, match="nothing is written: files/HEAD: a repository here could name programs"):
        made(stack, {"a": {**IMAGE, **MOUNT}})
    assert not (stack.parent / "out").exists()
    (stack / "HEAD").rename(stack / "head.txt")
    assert (made(stack, {"a": {**IMAGE, **MOUNT}}) / "files" / "head.txt").exists()


@pytest.mark.parametrize(
    ("service", "key", "said"),
    [
        ({"image": "Not An Image"}, "services.a.image", "no image reference"),
        ({**IMAGE, "stop_signal": "SIGNOPE"}, "services.a.stop_signal", "a signal that Linux has"),
        ({**IMAGE, "volumes": [{"type": "bind", "source": "./out", "target": "/o"}]}, "services.a.volumes", "leaves"),
    ],
)
def test_what_does_not_validate_is_told_at_the_files_own_place(
    stack: Path, service: dict[str, Any], key: str, said: str
) -> None:
    (stack / "out").mkdir()
    (stack / "out" / "link").symlink_to("/etc")
    found = draft(project({"a": service}), stack, out="../out")
    with pytest.raises(Refused) as refused:
        write(found, str(stack.parent / "out"), ["compose.yaml"])
    (problem,) = refused.value.problems
    assert (problem.path, problem.location.file) == (key, str(stack / "compose.yaml"))
    assert left(stack.parent) == ["stack"]


def test_a_mount_below_what_another_service_writes_to_is_told_at_its_service(stack: Path) -> None:
    """A folder that may be written becomes a volume of all that mount it."""
    below = [*MOUNT["volumes"], {"type": "volume", "target": "/ws/node_modules"}]
    services = {"a": {**IMAGE, "volumes": below}, "b": {**IMAGE, **MOUNT}}
    found = draft(project(services), stack, out="../out")
    with pytest.raises(Refused) as refused:
        write(found, str(stack.parent / "out"), ["compose.yaml"])
    (problem,) = refused.value.problems
    assert (problem.path, problem.location.file) == ("services.a.volumes", str(stack / "compose.yaml"))
    assert "'/ws/node_modules' lies in the volume" in problem.message and "'b' may write to" in problem.message
    assert left(stack.parent) == ["stack"]


def test_nothing_is_left_when_a_file_cannot_be_copied(stack: Path) -> None:
    os.mkfifo(stack / "config" / "pipe")
    found = draft(project({"a": {**IMAGE, **MOUNT}}), stack, out="../out")
    with pytest.raises(UsageError, match=r"cannot copy .*pipe"):
        write(found, str(stack.parent / "out"), ["compose.yaml"])
    assert left(stack.parent) == ["stack"]


def test_a_folder_that_holds_something_is_not_touched(stack: Path) -> None:
    with pytest.raises(UsageError, match="holds files already"):
        check_target(str(stack))
    with pytest.raises(UsageError, match="no folder for"):
        check_target(str(stack / "none" / "out"))
    with pytest.raises(UsageError, match="cannot write to"):
        check_target(str(stack / "compose.yaml"))


def test_the_report_in_all_forms(stack: Path) -> None:
    service = {
        **IMAGE,
        "dns": ["8.8.8.8"],
        "network_mode": "service:b",
        "volumes": [{"type": "bind", "source": "~/x|y", "target": "/x"}],
    }
    found = draft(project({"a": service}), stack)
    assert report.summary(found) == "5 exact, 1 adapted, 1 dropped, 1 refused"
    text = report.as_text(found).splitlines()
    place = f"{stack / 'compose.yaml'}:"
    assert text[0].startswith(place) and text[0].endswith("[services.a.network_mode]") and ": refused: " in text[0]
    page = report.as_markdown(found, [str(stack / "compose.yaml")])
    assert str(stack) not in page, "reports travel with experiments"
    assert [line for line in page.splitlines() if line.startswith("## ")] == [
        "## Refused: the experiment would be another one",
        "## Dropped: nothing in an experiment does it",
        "## Adapted: kept by other means",
    ]
    assert "'~/x\\|y' is in the home" in page
    log = json.loads(report.as_sarif(report.told(found)))
    results = log["runs"][0]["results"]
    assert [(one["ruleId"], one["level"]) for one in results] == [
        ("refused", "error"), ("dropped", "warning"), ("adapted", "note"),
    ]  # fmt: skip
    region = results[1]["locations"][0]["physicalLocation"]["region"]
    dropped = next(one for one in found.findings if one.key == "services.a.dns")
    assert region == {"startLine": dropped.at.line, "startColumn": dropped.at.column}
    assert results[1]["locations"][0]["logicalLocations"] == [{"fullyQualifiedName": "services.a.dns"}]


def test_a_folder_that_is_there_and_empty_is_filled(stack: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also the one that somebody stands in, which keeps its name and its place."""
    target = stack.parent / "out"
    target.mkdir()
    before = target.stat().st_ino
    monkeypatch.chdir(target)
    write(draft(project({"a": {**IMAGE, **MOUNT}}), stack, out="../out"), ".", ["compose.yaml"])
    assert left(Path()) == ["experiment.edf", "files", "import-report.md"]
    assert target.stat().st_ino == before
    load_experiment("experiment.edf")


def test_nothing_is_left_of_a_file_a_thousand_folders_deep_either(stack: Path) -> None:
    place = stack.joinpath(*["a"] * 1400)
    for one in [*reversed(place.parents), place]:
        one.mkdir(exist_ok=True)
    (place / "file").write_text("x")
    mount = {"type": "bind", "source": f"./{'a/' * 1400}file", "target": "/f", "read_only": True}
    services = {"a": {**IMAGE, "volumes": [mount]}, "b": {"image": "Not An Image"}}
    with pytest.raises(Refused):
        write(draft(project(services), stack, out="../out"), str(stack.parent / "out"), ["compose.yaml"])
    trees.remove(stack / "a")  # pytest's own way ends there, too
    assert left(stack.parent) == ["stack"]


def test_an_empty_folder_stays_empty_when_something_is_refused(stack: Path) -> None:
    target = stack.parent / "out"
    target.mkdir()
    with pytest.raises(Refused):
        write(draft(project({"a": {"image": "Not An Image"}}), stack, out="../out"), str(target), ["compose.yaml"])
    assert left(target) == []


@pytest.mark.parametrize("linked", ["configs", "configs/authorized_keys", "a.dockerfile"])
def test_nothing_is_written_by_way_of_a_projects_links(stack: Path, linked: str) -> None:
    """What the import writes itself has names that the project chooses."""
    away = stack.parent / "away"
    away.mkdir()
    (away / "mine").write_text("mine")
    (stack / linked).parent.mkdir(exist_ok=True)
    (stack / linked).symlink_to(away if linked == "configs" else away / "mine")
    services = {
        "a": {
            "build": {"context": ".", "dockerfile_inline": "FROM busybox\n"},
            "configs": [{"source": "authorized_keys", "target": "/x"}],
        }
    }
    out = made(stack, services, configs={"authorized_keys": {"name": "k", "content": "stolen"}})
    assert left(away) == ["mine"]
    assert (away / "mine").read_text() == "mine"
    assert (out / "files" / linked).is_symlink()
    assert (out / "written/configs/authorized_keys").read_text() == "stolen"


def test_no_file_is_written_by_way_of_a_link(tmp_path: Path) -> None:
    """Also where one has the place of a folder: it is made when all else is there, and refused."""
    away, top = tmp_path / "away", tmp_path / "top"
    away.mkdir()
    top.mkdir()
    tree = Tree(str(top))
    tree.link("configs", str(away))
    tree.write("configs/authorized_keys", b"stolen")
    with pytest.raises(OSError, match="it is a link"):
        tree.finish()
    assert left(away) == [] and (top / "configs/authorized_keys").read_bytes() == b"stolen"


def test_nothing_that_stands_in_a_file_takes_the_place_of_what_is_copied(stack: Path) -> None:
    """One of several Compose files may be a stranger's: his text was what the service of another one built, or ran."""
    (stack / "configs").mkdir()
    (stack / "configs/run.sh").write_text("mine")
    (stack / "b.dockerfile").write_text("FROM mine\n")
    services = {
        "a": {"build": {"context": ".", "dockerfile": "b.dockerfile"}, "volumes": [_reads("./configs")]},
        "b": {
            "build": {"context": ".", "dockerfile_inline": "FROM busybox\n"},
            "configs": [{"source": "run.sh", "target": "/x"}],
        },
    }
    out = made(stack, services, configs={"run.sh": {"content": "a stranger's"}})
    assert (out / "files/configs/run.sh").read_text() == "mine"
    definitions = load_experiment(out / "experiment.edf")
    built = {name: definitions.containers[one.cdf] for name, one in definitions.experiment.services.items()}
    assert {name: one.dockerfile_text for name, one in built.items()} == {"a": "FROM mine\n", "b": "FROM busybox\n"}
    mounts = {name: one.runtime.mounts[0].source for name, one in definitions.experiment.services.items()}
    assert (Path(mounts["a"]) / "run.sh").read_text() == "mine" and Path(mounts["b"]).read_text() == "a stranger's"


def _reads(folder: str) -> dict[str, Any]:
    return {"type": "bind", "source": folder, "target": "/cfg", "read_only": True}


def test_a_link_that_is_put_in_the_folder_s_place_meanwhile_leads_nothing_elsewhere(
    stack: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever may write to the folder above: files of the user's with the names of an import's were replaced."""
    own, write_one = stack.parent / "own", Tree.write
    own.mkdir()
    (own / "experiment.edf").write_text("mine")

    def swapping(self: Tree, *given: Any) -> None:
        for one in stack.parent.glob("*.part") if not (stack.parent / "moved").exists() else ():
            one.rename(stack.parent / "moved")
            one.symlink_to(own)
        write_one(self, *given)

    monkeypatch.setattr(Tree, "write", swapping)
    made(stack, {"a": {**IMAGE}})
    assert os.listdir(own) == ["experiment.edf"] and (own / "experiment.edf").read_text() == "mine"
    assert (stack.parent / "moved" / "experiment.edf").exists()


@pytest.mark.parametrize("name", ["HEAD", "head", ".git", "..", "."])
def test_no_config_makes_a_repository_or_leads_elsewhere(stack: Path, name: str) -> None:
    """With a file `HEAD`, `commondir` names the rest of one, such as the user's own `.git`: git ran a program."""
    every = {name: {"content": "ref: x"}, "commondir": {"content": "../../../.git"}}
    services = {"a": {"image": "x", "configs": [{"source": one, "target": f"/{at}"} for at, one in enumerate(every)]}}
    out = made(stack, services, configs=every)
    assert sorted(one.name for one in (out / "written/configs").iterdir()) == ["commondir", f"config-{name}"]


def test_two_configs_of_one_file_name_are_two_files(stack: Path) -> None:
    every = {one: {"content": one} for one in ("a b-2", "a b", "a?b")}
    services = {"a": {"image": "x", "configs": [{"source": one, "target": f"/{at}"} for at, one in enumerate(every)]}}
    out = made(stack, services, configs=every)
    texts = {one.name: one.read_text() for one in (out / "written/configs").iterdir()}
    assert texts == {"a-b-2": "a b-2", "a-b": "a b", "a-b-3": "a?b"}


@pytest.mark.parametrize("kind", ["links", "folders"])
def test_links_and_folders_count_before_they_are_made(stack: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder, "_MOST_ENTRIES", 100)
    (stack / "m").mkdir()
    for number in range(200):
        one = stack / "m" / f"{number:03}"
        one.symlink_to("x") if kind == "links" else one.mkdir()
    made_here: list[str] = []
    for name in ("make", "link"):
        way = getattr(Tree, name)
        monkeypatch.setattr(Tree, name, lambda *of, way=way: (made_here.append(of[1]), way(*of))[1])
    mounts = {"volumes": [{"type": "bind", "source": "./m", "target": "/m", "read_only": True}]}
    with pytest.raises(UsageError, match="more than 100 files, folders and links"):
        made(stack, {"a": {**IMAGE, **mounts}})
    assert 0 < len(made_here) <= 100
    assert left(stack.parent) == ["stack"]
