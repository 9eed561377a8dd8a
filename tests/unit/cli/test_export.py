"""`srprov export compose`: a twin, robots from stored facts, a plan; what it says and how it ends."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.controller.owners import keep, read_owner
from srprov.controller.plan_proof import proved
from srprov.facts.document import facts_document
from srprov.modules.module import canonical
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile, dump
from tests.resources import resource
from tests.unit.assignment.worlds import robot

EDF = """\
edf: 1
name: demo
parameters: {GAIT: {values: [walk, run]}}
trials: {order: listed, timeout: 5s}
services:
  cam: {image: busybox, cost: 30, per_robot: {tags: [camera]}}
  nav: {image: busybox, cost: 50, depends_on: [map]}
  map: {image: busybox, cost: 40, robot: r2}
  debug: {image: busybox, profiles: [debug]}
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with an EDF, an inventory and facts of three robots, as the current one."""
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {}, r2: {}, r3: {}}}\n")
    facts = {
        name: robot(name, load1=load, tags=tags, underlay_address=f"192.0.2.{name[1]}")
        for name, load, tags in (("r1", 1.0, ("camera",)), ("r2", 2.0, ()), ("r3", 3.0, ("camera",)))
    }
    (tmp_path / "facts.json").write_text(json.dumps(facts_document(facts, {})))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


def services(path: Path) -> dict[str, dict[str, object]]:
    found = yaml.safe_load(path.read_text())["services"]
    assert isinstance(found, dict)
    return found


def test_a_twin_has_all_services_and_asks_nobody(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", "compose", "e.edf", "-o", "out"]) == 0
    told = capsys.readouterr().out
    assert "e.edf:4:1: dropped: trials: Compose runs no trials" in told
    assert "out: compose.yml, and 1 file beside" in told
    found = services(lab / "out" / "compose.yml")
    assert sorted(found) == ["cam", "debug", "map", "nav"]
    assert found["debug"]["profiles"] == ["debug"]
    assert found["nav"]["environment"] == {"GAIT": "walk"}


def test_robots_are_chosen_as_by_assign(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["e.edf", "-i", "inv.yml", "--facts", "facts.json"]
    assert run(["assign", *given, "--json"]) == 0
    wanted = json.loads(capsys.readouterr().out)["assignment"]
    assert run(["export", "compose", *given, "-o", "out", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("export")).iter_errors(document)) == []
    placed = {name: one["robot"] for one in document["machines"] for name in one["services"]}
    assert placed == wanted
    for one in document["machines"]:
        assert sorted(services(lab / "out" / one["file"])) == one["services"]
    assert "map=192.0.2.2" in str(services(lab / "out" / wanted["nav"] / "compose.yml")["nav"]["extra_hosts"])
    assert run(["export", "compose", *given, "--profile", "debug", "-o", "more", "--json"]) == 0
    assert "debug" in str(json.loads(capsys.readouterr().out)["machines"])


def test_one_pc_is_possible_whatever_inventory_is_configured(lab: Path) -> None:
    (lab / "srprov.toml").write_text('inventory = "inv.yml"\n')
    assert run(["export", "compose", "e.edf", "--twin", "-o", "out"]) == 0
    assert (lab / "out" / "compose.yml").is_file()


def test_what_is_there_is_not_written_over(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (lab / "out").mkdir()
    (lab / "out" / "mine").write_text("1")
    assert run(["export", "compose", "e.edf", "-o", "out"]) == 5
    assert "out is there and not empty" in capsys.readouterr().err
    assert [one.name for one in (lab / "out").iterdir()] == ["mine"]


def test_what_is_refused_writes_nothing(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (lab / "e.edf").write_text(EDF + "network: {encryption: wireguard}\n")
    assert run(["export", "compose", "e.edf", "-i", "inv.yml", "--facts", "facts.json", "-o", "out"]) in (5, 8)
    told = capsys.readouterr().err
    assert "network.encryption" in told or "wireguard" in told
    assert not (lab / "out").exists()


def test_facts_are_read_by_no_link_that_leads_out(
    lab: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    """A project's `facts.json` may lead to those of another lab: addresses of its robots would be in the export."""
    other = tmp_path_factory.mktemp("other") / "facts.json"
    (lab / "facts.json").rename(other)
    (lab / "facts.json").symlink_to(other)
    given = ["export", "compose", "e.edf", "-i", "inv.yml", "-o", "out", "--facts"]
    assert run([*given, "facts.json"]) == 5
    assert "facts.json is a link that leads out of its folder" in capsys.readouterr().err
    assert not (lab / "out").exists()
    (lab / "facts.json").unlink()
    (lab / "facts.json").hardlink_to(other)
    assert run([*given, "facts.json"]) == 5
    assert "facts.json has another name (a hard link)" in capsys.readouterr().err
    assert not (lab / "out").exists()
    assert run([*given, str(other)]) == 0, "what the user names himself"


def test_addresses_that_only_stored_facts_say_are_told(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Services on other robots send there what they have for each other, and the facts may be somebody else's."""
    hosts = "{r1: {ansible_host: 192.0.2.1}, r2: {ansible_host: 192.0.2.77}, r3: {srprov_underlay: 192.0.2.3}}"
    (lab / "inv.yml").write_text(f"all: {{hosts: {hosts}}}\n")
    given = ["e.edf", "-i", "inv.yml", "--facts", "facts.json"]
    said = "r2 is at 192.0.2.2 for services on other robots, as facts.json says; the inventory has 192.0.2.77"
    for tool in ("compose", "swarm"):
        assert run(["export", tool, *given, "--lossy" if tool == "swarm" else "--reassign", "-o", tool]) == 0
        assert f"note: {said}\n" in capsys.readouterr().err
        readme = (lab / tool / "README.md").read_text()
        assert said.replace("_", "\\_") in readme and "r1 is at" not in readme and "r3 is at" not in readme
    assert run(["export", "kubernetes", *given, "--lossy", "-o", "k8s"]) == 0
    assert "is at 192" not in capsys.readouterr().err
    (lab / "inv.yml").write_text("all: {hosts: {r1: {}, r2: {}, r3: {}}}\n")
    assert run(["export", "compose", *given, "-o", "more"]) == 0
    assert "note: r2 is at 192.0.2.2 for services on other robots, as facts.json says\n" in capsys.readouterr().err


def test_facts_need_an_inventory(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", "compose", "e.edf", "--facts", "facts.json", "-o", "out"]) == 5
    assert "name it with -i" in capsys.readouterr().err


PRIVATE = """\
edf: 1
name: demo
description: nobody's business
services:
  map: {image: busybox, volumes: ["./key:/key"]}
"""


def plan_of(source: Path, inputs: dict[str, str]) -> PlanFile:
    """Return a plan that places one service, and says that it was made from an EDF."""
    plan = Plan(instance="demo", source=f"anna@desk:{source}", steps=(), assignment={"map": "r2"})
    return PlanFile(plan=plan, fingerprints={"r2": {}}, inputs=inputs)


@pytest.fixture
def private(lab: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an EDF in another folder, with a key beside it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(lab / "state"))
    home = lab / "private"
    home.mkdir()
    (home / "e.edf").write_text(PRIVATE)
    (home / "key").write_text("of nobody else\n")
    (lab / "e.edf").unlink()
    return home / "e.edf"


@pytest.mark.parametrize("tool", ["compose", "swarm", "kubernetes"])
def test_a_plan_of_a_stranger_names_no_file_that_is_read(
    private: Path, lab: Path, capsys: pytest.CaptureFixture[str], tool: str
) -> None:
    """An EDF elsewhere came with the key beside it into the export, and of any other file lines were shown."""
    (lab / "netrc").write_text("password: nobody's business\n")
    for inputs in ({"other.edf": "edf: 1\n"}, {"e.edf": PRIVATE}, {"netrc": "edf: 1\n"}):
        for source in (private, lab / "netrc"):
            (lab / "p.json").write_text(dump(plan_of(source, inputs)))
            assert run(["export", tool, "p.json", "-o", "out"]) == 5
            told = capsys.readouterr().err
            assert "nobody" not in told and ("is not there" in told or "netrc has changed since" in told), told
            assert not (lab / "out").exists()


def test_a_plan_that_was_written_here_finds_its_edf(private: Path, lab: Path) -> None:
    """Where it was by this controller's own word, whatever the plan says."""
    plan = plan_of(private, {"e.edf": PRIVATE})
    owner = replace(read_owner("demo", str(private)), source=plan.plan.source)
    keep(owner)
    (lab / "p.json").write_text(dump(proved(plan, owner)))
    assert run(["export", "compose", "p.json", "-o", "out"]) == 0
    assert services(lab / "out" / "r2" / "compose.yml").keys() == {"map"}
    private.write_text(PRIVATE.replace("nobody", "somebody"))
    assert run(["export", "compose", "p.json", "-o", "late"]) == 5


def test_a_plan_of_a_stranger_does_not_say_where_robots_are(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Services were told of a host of his as of one of the others, and sent what was meant for that one there."""
    monkeypatch.setenv("XDG_STATE_HOME", str(lab / "state"))
    (lab / "e.edf").write_text("edf: 1\nname: demo\nservices: {db: {image: busybox}, web: {image: busybox}}\n")
    owner = replace(read_owner("demo", str(lab / "e.edf")), source="lab@desk:e.edf")
    keep(owner)
    placed, his = {"db": "r1", "web": "r2"}, "203.0.113.9"
    told = {name: {"gateway": "", "vtep": his} for name in placed.values()}
    where = {name: {"ip": "", "mac": "", "network": "overlay", "robot": robot} for name, robot in placed.items()}
    overlay = {"mtu": 0, "port": 0, "subnet": "", "vni": 0, "serial": 1}
    record = {**overlay, "instance": "demo", "source": owner.source, "robots": told, "services": where}
    path = "/var/lib/srprov/demo/placement.json"
    wanted = resource("file", path, {"content": canonical(record) + "\n"}, host="r1")
    away = dict.fromkeys(placed.values(), "no route")
    plan = Plan(instance="demo", source=owner.source, steps=(), assignment=placed, unreachable=away)
    prints = {name: {"underlay": {"address": his}} for name in placed.values()}
    saved = PlanFile(
        plan=plan, fingerprints=prints, inputs={"e.edf": (lab / "e.edf").read_text()}, also_wanted=(wanted,)
    )
    (lab / "p.json").write_text(dump(saved))
    assert run(["export", "compose", "p.json", "-o", "none"]) == 5
    assert "the address of r1 is not known" in capsys.readouterr().err
    robots = ("-i", "inv.yml", "--facts", "facts.json")
    (lab / "own.json").write_text(dump(proved(saved, owner)))
    for file, words, db in (("p.json", robots, "192.0.2.1"), ("own.json", (), his), ("own.json", robots, his)):
        assert run(["export", "compose", file, *words, "-o", f"{file}{len(words)}"]) == 0
        hosts = services(lab / f"{file}{len(words)}" / "r2" / "compose.yml")["web"]["extra_hosts"]
        assert isinstance(hosts, list) and f"db={db}" in hosts


def test_an_export_copies_no_secret_key_or_password_unasked(
    lab: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(lab / "home"))
    service = '{image: busybox, volumes: ["./ws:/ws"]}'
    edf = f"edf: 1\nname: demo\nsecrets: {{t: {{file: ws/token}}}}\nservices: {{a: {service}}}\n"
    (lab / "ws").mkdir()
    (lab / "e.edf").write_text(edf)
    (lab / "inv.yml").write_text("all: {hosts: {r1: {ansible_password: kuka-4711}, r2: {}, r3: {}}}\n")
    given = ("-i", "inv.yml", "--facts", "facts.json")
    for name, text, words in (
        ("token", "a token", ()),
        ("key", "-----BEGIN OPENSSH PRIVATE KEY-----\n", ()),
        ("hosts", (lab / "inv.yml").read_text(), given),
        ("hosts", (lab / "inv.yml").read_text(), ()),
    ):
        (lab / "ws" / name).write_text(text)
        assert run(["export", "compose", "e.edf", "-o", "out", *words]) == 9
        assert f"a: outside ({lab}/ws/{name})" in capsys.readouterr().err
        assert not (lab / "out").exists()
        (lab / "ws" / name).unlink()
        (lab / "ws" / "other").touch()
    assert run(["export", "compose", "e.edf", "-o", "out", *given]) == 0
