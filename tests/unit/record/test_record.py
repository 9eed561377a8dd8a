"""A run's folder: what is in it, that it is whole as far as it goes, and that it never is in the way of the run."""

from __future__ import annotations

import datetime as dt
import json
import os
import resource
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType

import pytest
from msgspec.structs import replace

from srprov import own_records
from srprov.definitions.model import Host, Inventory
from srprov.definitions.repository_names import repository_among
from srprov.definitions.sshargs import parse
from srprov.execution import Event
from srprov.planning.planfile import PlanFile, document
from srprov.record import RunFolder, RunInputs, default_root, event_json, run_id, write_inputs
from srprov.record.documents import inventory_document
from srprov.record.folder import PlainFolder
from srprov.record.input_places import inputs
from srprov.record.plain import plain
from srprov.resource import Action
from srprov.secret import Hidden, Secret, forget
from tests.fakes import World
from tests.worlds import experiment, inventory, removal_for, service
from tests.worlds import plan_for as plan_of

NOW = dt.datetime(2026, 11, 21, 9, 5, 7, tzinfo=dt.timezone.utc)
VALUE = "hunter2-record"


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another."""
    forget()
    yield
    forget()


def modes(folder: Path) -> dict[str, str]:
    """Return path below the folder -> permissions in octal."""
    every = [folder, *folder.rglob("*")]
    return {str(path.relative_to(folder)): f"{stat.S_IMODE(path.stat().st_mode):o}" for path in every}


def test_everything_is_there_and_for_its_owner_only(tmp_path: Path) -> None:
    """Inputs, decision, plan, what should be true per robot, versions, events and result; 0600 in 0700."""
    world = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", robot="r2"))
    plan = plan_of(world, what)
    desired = [step.want for step in plan.steps if step.want]
    file = PlanFile(plan=plan, fingerprints={})
    lab = inventory(world)
    run = RunInputs(verb="apply", owner="a@b", version="1", plan=plan, file=file, inventory=lab, desired=desired)
    os.umask(0)
    try:
        with RunFolder(tmp_path / "runs" / "deep", run_id(plan, NOW)) as folder:
            write_inputs(folder, run)
            folder.event(event_json(Event(kind="start", host="r1", step=plan.steps[0])))
            folder.event(event_json(Event(kind="waiting", host="", text=f"for {VALUE}")))
            folder.put_json("result.json", lambda: {"run": str(folder.path)})
    finally:
        os.umask(0o022)
    assert folder.problem == ""
    found = modes(folder.path)
    names = {"plan.txt", "plan.json", "assignment.json", "environment.json", "events.jsonl", "result.json",
             "inputs/inventory.yml", "rendered/r1.yml", "rendered/r2.yml"}  # fmt: skip
    assert {name: mode for name, mode in found.items() if mode != "700"} == dict.fromkeys(names, "600")
    assert {name for name, mode in found.items() if mode == "700"} == {".", "inputs", "rendered"}
    decision = json.loads((folder.path / "assignment.json").read_text())
    assert decision["assignment"] == {"a": "r1", "b": "r2"} and set(decision["costs"]) == {"a", "b"}
    kept = json.loads((folder.path / "plan.json").read_text())
    assert kept == json.loads(json.dumps(document(file)))
    assert [step["id"] for step in map(json.loads, (folder.path / "events.jsonl").read_text().splitlines())][1] is None
    environment = json.loads((folder.path / "environment.json").read_text())
    assert environment["libraries"]["paramiko"] and environment["owner"] == "a@b"
    rendered = json.loads((folder.path / "rendered" / "r1.yml").read_text())
    assert {next(iter(one)) for one in rendered} >= {"image", "container", "file"}


def test_the_name_says_when_what_and_which_plan() -> None:
    """Equal plans have equal hashes, other plans others; the time is UTC wherever the controller is."""
    world = World().add("r1")
    one, other = plan_of(world, experiment(service("a"))), removal_for(world)
    there = NOW.astimezone(dt.timezone(dt.timedelta(hours=9)))
    assert run_id(one, there) == run_id(plan_of(World().add("r1"), experiment(service("a"))), NOW)
    assert run_id(one, NOW).startswith("20261121T090507Z-hello-") and len(run_id(one, NOW)) == 31
    assert run_id(one, NOW) != run_id(other, NOW)


def test_two_runs_in_one_second_have_a_folder_each(tmp_path: Path) -> None:
    """Nothing is ever written into the folder of another run."""
    paths = []
    for number in range(3):
        with RunFolder(tmp_path, "same") as folder:
            folder.put("a", lambda number=number: str(number))  # type: ignore[misc]
        paths.append(folder.path)
    assert [path.name for path in paths] == ["same", "same-2", "same-3"]
    assert [(path / "a").read_text() for path in paths] == ["0", "1", "2"]


def test_secrets_are_taken_out_of_every_file(tmp_path: Path) -> None:
    """Of text, of JSON, of events, and of the words of a failure."""
    Secret(VALUE)

    def broken() -> str:
        raise RuntimeError(f"no {VALUE}")

    with RunFolder(tmp_path, "run") as folder:
        folder.put("inputs/e.edf", lambda: f"token: {VALUE}\n")
        folder.put_json("x.json", lambda: {VALUE: [VALUE, 5, Hidden("x")]})
        folder.event({"text": VALUE})
        folder.put("y", broken)
    written = "".join(path.read_text() for path in folder.path.rglob("*") if path.is_file())
    assert VALUE not in written + folder.problem
    assert json.loads((folder.path / "x.json").read_text()) == {"***": ["***", 5, "***"]}
    assert folder.problem == "RuntimeError: no ***"


@pytest.mark.parametrize("how", ["file in the way", "no such device"])
def test_a_disk_that_cannot_be_written_is_told_once_and_stops_nothing(tmp_path: Path, how: str) -> None:
    """The run goes on; the reason names the place."""
    root = Path("/proc/nowhere")
    if how == "file in the way":
        root = tmp_path / "file"
        root.write_text("")
    with RunFolder(root, "run") as folder:
        for _ in range(5):
            folder.event({"a": 1})
            folder.put("x", lambda: "x")
    assert str(root) in folder.problem
    assert not folder.path.is_dir()


def test_a_file_that_does_not_fit_is_told(tmp_path: Path) -> None:
    """What was there before stays whole, no half file is left, and nothing more is tried."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with RunFolder(tmp_path, "run") as folder:
            folder.put("first", lambda: "first")
            folder.put("large", lambda: "x" * 2000)
            folder.put("after", lambda: "after")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "File too large" in folder.problem
    assert sorted(path.name for path in folder.path.iterdir()) == ["events.jsonl", "first"]
    assert (folder.path / "first").read_text() == "first"


def test_a_slow_disk_does_not_hold_up_whoever_records(tmp_path: Path) -> None:
    """Handing over a file or an event takes no time, whatever the writer is waiting for."""
    gate = threading.Event()

    def slow() -> str:
        gate.wait(20)
        return "late"

    folder = RunFolder(tmp_path, "run")
    begun = time.monotonic()
    folder.put("slow", slow)
    for number in range(1000):
        folder.event({"number": number})
    assert time.monotonic() - begun < 15
    gate.set()
    folder.close()
    folder.close()
    assert len((folder.path / "events.jsonl").read_text().splitlines()) == 1000


def test_the_default_place_follows_xdg(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """XDG_STATE_HOME when it is absolute, as its specification wants; else the usual folder below the home."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert default_root() == tmp_path / "srprov" / "runs"
    monkeypatch.setenv("XDG_STATE_HOME", "relative")
    monkeypatch.setenv("HOME", "/home/ada")
    assert default_root() == Path("/home/ada/.local/state/srprov/runs")


@pytest.mark.parametrize("named", [True, False])
def test_a_record_s_inventory_is_the_user_s_own_word_where_he_had_named_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: bool
) -> None:
    """That of a project that he ran has the names, groups and addresses of whoever wrote it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    world = World().add("r1")
    Secret(word := "a-user-that-is-a-secret")
    lab = inventory(world)
    lab = replace(lab, hosts={"r1": replace(lab.hosts["r1"], user=word)}, named=named)
    plan = plan_of(world, experiment(service("a", robot="r1")))
    file = PlanFile(plan=plan, fingerprints={})
    run = RunInputs(verb="apply", owner="a@b", version="1", plan=plan, file=file, inventory=lab, desired=())
    write_inputs(PlainFolder(tmp_path / "plain"), run)
    with RunFolder(tmp_path / "runs", run_id(plan, NOW)) as folder:
        write_inputs(folder, run)
    for one in (tmp_path / "plain", folder.path):
        written = one / "inputs" / "inventory.yml"
        assert word not in written.read_text()
        assert own_records.is_known(str(written)) is named


def test_the_inventory_is_written_without_passwords() -> None:
    """What srprov read, as an inventory that Ansible reads too; a proxy's command may hold anything."""
    host = Host(
        name="r1", address="10.0.0.1", user="ada", password=Secret("first-pass"), become_password=Secret("second-pass"),
        ssh_options=(("proxycommand", "sshpass -p third-pass ssh x"), ("port", "22")), tags=("fast",),
    )  # fmt: skip
    lab = Inventory(hosts=MappingProxyType({"r1": host}), groups=MappingProxyType({"all": ("r1",), "rovers": ("r1",)}))
    shown = inventory_document(lab)
    assert 'pass"' not in json.dumps(shown) and "third-pass" not in json.dumps(shown)
    mine = shown["all"]["hosts"]["r1"]
    assert (mine["ansible_password"], mine["ansible_become_password"]) == ("***", "***")
    assert mine["ansible_ssh_common_args"] == "-o 'proxycommand=***' -o port=22"
    assert shown["all"]["children"] == {"rovers": {"hosts": {"r1": None}}}


def test_an_option_of_ssh_is_one_word_of_a_recorded_inventory() -> None:
    """It would be further options to who reads the record, or none that can be read."""
    options = (("userknownhostsfile", '"/home/u/my lab/known"'), ("setenv", "A=1 -o StrictHostKeyChecking=accept-new"))
    lab = Inventory(
        hosts=MappingProxyType({"r1": Host(name="r1", address="10.0.0.1", ssh_options=options)}),
        groups=MappingProxyType({"all": ("r1",)}),
    )
    written = inventory_document(lab)["all"]["hosts"]["r1"]["ansible_ssh_common_args"]
    assert tuple(parse(written)) == options


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("e.edf", "e.edf"),
        ("cdf/a.cdf", "cdf/a.cdf"),
        ("../x/a.cdf", "outside/x/a.cdf"),
        ("/etc/a.cdf", "outside/etc/a.cdf"),
        ("a/../../../b", "a/b"),
    ],
)
def test_inputs_stay_in_their_folder(name: str, place: str) -> None:
    """Wherever a definition file lies, its copy lies below inputs/."""
    assert list(inputs({name: "text"})) == [(place, "text")]


@pytest.mark.parametrize(
    "files",
    [
        {"x" * 300: "a"}, {"": "a"}, {"a": "1", "a/b": "2"}, {"a/b": "1", "a": "2"}, {"inventory.yml": "FORGED"},
        {"..": "x"}, {"a\0b": "x"}, {"/".join("a" * 2000): "x"}, {"other": "x", "x/y": "1", "x": "2"}, {"é" * 120: "x"},
    ],
)  # fmt: skip
def test_no_name_in_a_plan_file_damages_the_record(tmp_path: Path, files: dict[str, str]) -> None:
    with RunFolder(tmp_path, "run") as folder:
        folder.put("inputs/inventory.yml", lambda: "REAL")
        for name, text in inputs(files):
            folder.put(f"inputs/{name}", lambda text=text: text)  # type: ignore[misc]
        folder.event({"event": "start"})
    below = tmp_path / "run" / "inputs"
    there = {str(one.relative_to(below)): one.read_text() for one in below.rglob("*") if one.is_file()}
    assert there.pop("inventory.yml") == "REAL" and sorted(there.values()) == sorted(files.values())
    assert (tmp_path / "run" / "events.jsonl").read_text() == '{"event": "start"}\n' and not folder.problem


@pytest.mark.parametrize(
    "names",
    [
        (".git/HEAD", ".git/config"), ("a/.git/config",), ("a/.hg/hgrc",), ("../.git/config",),
        ("HEAD", "config", "objects/x", "refs/x"), ("../m/HEAD", "../m/commondir"),
        ("m/head", "m/Objects/x", "m/REFS/x"),
    ],
)  # fmt: skip
def test_no_record_is_a_repository(names: tuple[str, ...]) -> None:
    """A plan file may name any files; in a clone, `.git` comes before what else would be a repository."""
    found = dict(inputs({"e.edf": "e.edf", **{name: name for name in names}}))
    assert repository_among(found) == "" and sorted(found.values()) == sorted(["e.edf", *names])
    assert found["e.edf"] == "e.edf"


def test_a_file_that_is_called_head_alone_keeps_its_name() -> None:
    names = ["m/HEAD", "m/config", "refs/x"]
    assert [place for place, _ in inputs(dict.fromkeys(names, ""))] == names


def test_a_file_that_cannot_be_written_does_not_end_the_events(tmp_path: Path) -> None:
    with RunFolder(tmp_path, "run") as folder:
        folder.put("a" * 300, lambda: "x")
        folder.event({"event": "start"})
    assert "too long" in folder.problem
    assert (tmp_path / "run" / "events.jsonl").read_text() == '{"event": "start"}\n'


def test_any_value_becomes_json() -> None:
    """Bytes by length and hash, hidden values as `***`, sets in order."""
    shown = plain({"a": b"xy", "b": Hidden("v"), 3: {"y", "x"}, "d": Action.CREATE, "e": (1, None, 2.5, Path("/p"))})
    assert shown["a"]["bytes"] == 2 and len(shown["a"]["sha256"]) == 64
    assert {key: shown[key] for key in ("b", "3", "d", "e")} == {
        "b": "***",
        "3": ["x", "y"],
        "d": "+",
        "e": [1, None, 2.5, "/p"],
    }
    json.dumps(shown)
