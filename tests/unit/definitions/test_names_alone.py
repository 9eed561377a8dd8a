"""Names of robots in an inventory's place: nothing that lies in the folder at hand is read for them."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import load_inventory
from srprov.definitions.starter import starter
from srprov.errors import DefinitionError
from srprov.lab.inventory import as_text
from srprov.lab.places import Site
from srprov.lab.spec import Robot
from srprov.record.memory import note_inventory

PROGRAM = 'ansible_ssh_common_args: -o ProxyCommand="sh -c id"\n'


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a folder of a stranger's, in which the user works."""
    folder = tmp_path / "project"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize("place", ["group_vars/all.yml", "group_vars/all/more", "host_vars/robot1.yml"])
def test_no_variables_of_the_folder_at_hand_count_for_names_alone(project: Path, place: str) -> None:
    """They may name a program that would run here, as soon as any verb connects; a link to them counts as well."""
    (project / place).parent.mkdir(parents=True)
    (project / place).write_text(PROGRAM)
    for names in ("robot1,", "robot1,robot2"):
        with pytest.raises(DefinitionError) as refused:
            load_inventory([names])
        assert f"for which {place.partition('/')[0]} is not read" in refused.value.problems[0].message
    (project / place).unlink()
    top = project / place.partition("/")[0]
    top.rename(project.parent / "elsewhere")
    top.symlink_to("../elsewhere")
    with pytest.raises(DefinitionError):
        load_inventory(["robot1,"])
    top.unlink()
    assert sorted(load_inventory(["robot1,robot2,"]).hosts) == ["robot1", "robot2"]


def test_no_file_is_read_that_is_called_like_names(project: Path) -> None:
    """It may be a program, which then ran; with a folder before it, it is named as a file."""
    (project / "robot1,robot2,").write_text("robot3 ansible_host=10.0.0.3\n")
    with pytest.raises(DefinitionError) as refused:
        load_inventory(["robot1,robot2,"])
    assert "the name of a file, too" in refused.value.problems[0].message
    assert list(load_inventory(["./robot1,robot2,"]).hosts) == ["robot3"]


def test_names_beside_an_inventory_that_was_named_have_its_variables(project: Path) -> None:
    """The user has named a file of that folder."""
    (project / "group_vars").mkdir()
    (project / "group_vars" / "all.yml").write_text("ansible_user: robot\n")
    (project / "lab.ini").write_text("robot1\n")
    found = load_inventory(["lab.ini", "robot9,"])
    assert {name: one.user for name, one in found.hosts.items()} == {"robot1": "robot", "robot9": "robot"}


@pytest.mark.parametrize("place", ["group_vars/all.yml", "host_vars/robot1.yml"])
@pytest.mark.parametrize("who", ["lab up", "init"])
def test_nothing_is_read_with_an_inventory_that_srprov_wrote(project: Path, place: str, who: str) -> None:
    """A project that was cloned brings it by the next `git pull`; whoever wrote it himself takes the line away."""
    lab = as_text(Site("", 1), [Robot("robot1")], None)
    text = lab if who == "lab up" else starter("x")["inventory.yml"]
    (project / "hosts.yml").write_text(text)
    assert "robot1" in load_inventory(["hosts.yml"]).hosts
    (project / place).parent.mkdir()
    (project / place).write_text(PROGRAM)
    for named in ("hosts.yml", str(project / "hosts.yml"), "."):
        with pytest.raises(DefinitionError) as refused:
            load_inventory([named])
        (problem,) = refused.value.problems
        assert f"{place.partition('/')[0]} would be" in problem.message
        assert "host_vars" in text.splitlines()[problem.location.line - 1], "the line that says so"
    (project / "hosts.yml").write_text("".join(one for one in text.splitlines(True) if "host_vars" not in one))
    assert load_inventory(["hosts.yml"]).hosts["robot1"].ssh_options


def _refusal(path: str) -> str:
    with pytest.raises(DefinitionError) as refused:
        load_inventory([path])
    return refused.value.problems[0].message


@pytest.mark.parametrize("place", ["group_vars/all.yml", "host_vars/robot1.yml"])
def test_nothing_is_read_with_the_inventory_of_a_record(
    project: Path, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside it lies what the experiment shipped, whoever wrote that; a folder of a colleague's has all as he likes."""
    home = project / "results" / "sessions" / "1" / "inputs"
    (home / place).parent.mkdir(parents=True)
    (home / "inventory.yml").write_text('{"all": {"hosts": {"robot1": {"ansible_host": "10.0.0.1"}}}}')
    (home / place).write_text(PROGRAM)
    (home / "race.edf").write_text("edf: 1\n")
    named = ["results/sessions/1/inputs/inventory.yml", "results/sessions/1/../1/inputs/inventory.yml"]
    for path in (*named, str(home / "inventory.yml"), str(home)):
        assert "is the inventory of a record, with which nothing is read" in _refusal(path)
    monkeypatch.chdir(home)
    assert f"and {place.partition('/')[0]} would be" in _refusal("inventory.yml")
    (home / place).unlink()
    (home / place).parent.rmdir()
    assert list(load_inventory(["inventory.yml"]).hosts) == ["robot1"]


def test_no_inventory_of_a_record_is_run(project: Path) -> None:
    """docs/evidence.md names it in a command, and a record may be somebody else's."""
    home = project / "sessions" / "1" / "inputs"
    home.mkdir(parents=True)
    for text in ("#!/bin/sh\ntouch ran; echo '{}'\n", "\x7fELF"):
        (home / "inventory.yml").write_text(text)
        (home / "inventory.yml").chmod(0o755)
        assert "is the inventory of a record, and a program" in _refusal("sessions/1/inputs/inventory.yml")
    assert not (project / "ran").exists()


def test_the_folder_of_a_record_is_no_inventory(project: Path) -> None:
    """Of a folder all files are read, and what lies there the experiment shipped: a `hosts` with a ProxyCommand."""
    home = project / "sessions" / "1" / "inputs"
    home.mkdir(parents=True)
    (home / "inventory.yml").write_text("all: {hosts: {robot1: }}\n")
    (home / "hosts").write_text("robot1 ansible_ssh_common_args='-o ProxyCommand=\"touch ran\"'\n")
    for path in ("sessions/1/inputs", "sessions/1/inputs/", str(home)):
        assert "is the folder of a record" in _refusal(path)
    assert not load_inventory(["sessions/1/inputs/inventory.yml"]).hosts["robot1"].ssh_options


def test_no_folder_is_the_inventory_of_a_record(project: Path) -> None:
    """It would be read with the variables in it, and not with those beside it."""
    home = project / "sessions" / "1" / "inputs" / "inventory.yml"
    (home / "group_vars").mkdir(parents=True)
    (home / "hosts.yml").write_text("all: {hosts: {robot1: }}\n")
    (home / "group_vars/all.yml").write_text(PROGRAM)
    for path in ("sessions/1/inputs/inventory.yml", "sessions/1/inputs/inventory.yml/", "sessions/1/inputs"):
        assert "is the inventory of a record, and a folder" in _refusal(path)


def test_a_record_is_known_where_a_link_led_there(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`cd sessions/1/inputs`, which is a link in a stranger's record: the shell has the name, the kernel has not."""
    (project / "elsewhere" / "group_vars").mkdir(parents=True)
    (project / "elsewhere/inventory.yml").write_text("all: {hosts: {robot1: }}\n")
    (project / "elsewhere/group_vars/all.yml").write_text(PROGRAM)
    (project / "inputs").symlink_to("elsewhere")
    monkeypatch.chdir(project / "inputs")
    monkeypatch.setenv("PWD", str(project / "inputs"))
    assert "is the inventory of a record, with which nothing is read" in _refusal("inventory.yml")
    monkeypatch.setenv("PWD", str(project))
    assert load_inventory(["inventory.yml"]).hosts["robot1"].ssh_options, "a name of another folder says nothing"


@pytest.mark.parametrize("command", ["sh -c id", "***x", "nc"])
def test_the_inventory_of_a_record_names_no_command(project: Path, command: str) -> None:
    """A record, and a bundle, may be a stranger's; what srprov writes there is `***`."""
    recorded = project / "run" / "inputs" / "inventory.yml"
    recorded.parent.mkdir(parents=True)
    recorded.write_text(f"all: {{hosts: {{r1: {{ansible_ssh_common_args: '-o ProxyCommand=\"{command}\"'}}}}}}\n")
    for path in ("run/inputs/inventory.yml", str(recorded)):
        with pytest.raises(DefinitionError) as refused:
            load_inventory([path])
        assert "is the inventory of a record, and 'r1' has a ProxyCommand" in refused.value.problems[0].message
    recorded.write_text(recorded.read_text().replace(command, "***"))
    assert load_inventory([recorded]).hosts["r1"].ssh_options == (("proxycommand", "***"),)


ALL = """all: {children: {builders: {hosts: {r1: }}, arms: {hosts: {r1: }}},
  hosts: {r1: {ansible_host: 192.0.2.1, ansible_port: 2222, ansible_user: pi, srprov_tags: [arm],
  ansible_connection: local, ansible_password: word, ansible_become_password: word, ansible_ssh_private_key_file: key,
  ansible_ssh_common_args: "-o UserKnownHostsFile=~/.bashrc -o StrictHostKeyChecking=accept-new -o HostKeyAlias=ls"}}}
"""


def test_the_record_of_another_machine_says_only_where_robots_are(project: Path) -> None:
    """Into a file that it names a host key would be written; `local` is this machine; nobody typed its passwords."""
    (project / "run" / "inputs").mkdir(parents=True)
    recorded = project / "run" / "inputs" / "inventory.yml"
    recorded.write_text(ALL)
    for path in ("run/inputs/inventory.yml", str(recorded)):
        found = load_inventory([path])
        one = found.hosts["r1"]
        assert (one.address, one.port, one.user, one.tags) == ("192.0.2.1", 2222, "pi", ("arm",))
        assert (one.connection, one.ssh_options, one.identity_file) == ("ssh", (), None)
        assert one.password is one.become_password is None
        assert found.groups.keys() & {"builders", "arms"} == {"arms"}, "whose images the user's robots run says he"
        assert (found.named, found.strange_record) == (False, path), "nor is sudo's password told there"
    assert note_inventory(ALL) == ""
    found = load_inventory(["run/inputs/inventory.yml"])
    assert found.named and found.hosts["r1"].connection == "local", "this machine wrote it"
    assert found.groups["builders"] == ("r1",)
    recorded.write_text(ALL.replace("2222", "2223"))
    assert not load_inventory(["run/inputs/inventory.yml"]).hosts["r1"].ssh_options, "and not what is there now"
    (project / "mine.yml").write_text(ALL)
    assert load_inventory(["mine.yml"]).hosts["r1"].ssh_options, "a copy is the user's word"
    assert load_inventory(["mine.yml", "run/inputs/inventory.yml"]).hosts["r1"].connection == "ssh"
