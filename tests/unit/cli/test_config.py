"""Defaults from files: who wins, and what a stranger's file may not do."""

from __future__ import annotations

import importlib
import json
import os
import sys
from pathlib import Path

import click
import pytest
from click.core import ParameterSource

from srprov.cli.config import _GROUPS, OWN_KEYS, PARAMETERS, PROJECT_KEYS, ConfigFile, default_map, places, user_folder
from srprov.cli.main import _MODULES, _VERBS, cli, run
from srprov.cli.whose_inventory import inventory_set_aside
from srprov.errors import UsageError
from tests.bounded import bounded

VERBS = {"plan": "", "apply": ""}


def write(path: Path, text: str) -> None:
    """Write a file and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o644)


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


@pytest.mark.parametrize("word", sorted(OWN_KEYS - PROJECT_KEYS))
@pytest.mark.parametrize("text", ["{word} = true\n", "[apply]\n{word} = true\n"])
def test_a_projects_file_sets_only_what_is_listed(tmp_path: Path, word: str, text: str) -> None:
    """What a stranger may have written cannot allow, write, run or name anything; the line is named."""
    write(tmp_path / "srprov.toml", text.format(word=word))

    with pytest.raises(UsageError, match=rf"srprov\.toml:{text.count(chr(10))}: .*'{word}'"):
        default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")})


@pytest.mark.parametrize(
    "text", ['workers = "256"', "workers = 100000", "forks = 5_000", "forks = 4000.5", "forks = ' 9000 '"]
)
def test_a_projects_file_starts_no_more_processes_than_there_are_processors(tmp_path: Path, text: str) -> None:
    """256 of them took 3.6 GB; the user's own file may say so."""
    write(tmp_path / "srprov.toml", f"{text}\n")
    with pytest.raises(UsageError, match=r"srprov\.toml:1: '(workers|forks)' cannot have this value"):
        default_map(VERBS, tmp_path, own(tmp_path))
    write(tmp_path / "srprov.toml", "workers = 'auto'\nforks = 512\n")
    write(user_folder(own(tmp_path)) / "srprov.toml", f"{text}\n")
    assert default_map(VERBS, tmp_path, own(tmp_path))


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    """A file that is no TOML is an error that names it."""
    write(tmp_path / "srprov.toml", "forks = = 3\n")

    with pytest.raises(UsageError, match=r"srprov\.toml"):
        default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")})


def own(tmp_path: Path) -> dict[str, str]:
    """Return an environment whose user has no configuration."""
    return {"HOME": str(tmp_path / "home")}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("forsk = 3\n", r"srprov\.toml:1: there is no option 'forsk' to set; did you mean 'forks'\?"),
        ("# a\n\n[plan]\n\nsource = 1\n", r":5: there is no option 'source'"),
        ("[deploy]\nforks = 3\n", r":1: there is no verb 'deploy'"),
        ("forks = 3\n[lab.up]\nrobots = 3\n", r"cannot set anything of 'lab'"),
        ("[plan]\nforks = 3\n[apply]\nevents = '/x'\n", r":4: a project's file cannot set 'events'"),
        ("plan.out = '/x'\n", r"cannot set 'out'"),
        ("inventory = {a = 1}\n", r"there is no verb 'inventory'"),
        ("\nforks = [1]\n", r":2: 'forks' cannot have this value"),
        ("timeout = nan\n", r":1: 'timeout' cannot have this value"),
        (f"forks = 1{'0' * 400}\n", r":1: 'forks' cannot have this value"),
        ("[plan]\nverbose = 2026-01-01\n", r":2: 'verbose' cannot have this value"),
        ('inventory = ["a", 3]\n', r":1: 'inventory' cannot have this value"),
        ('inventory = "a\\u0000"\n', r":1: 'inventory' cannot have this value"),
        ("locked = true\n[plan]\nlocked = false\n", r":3: 'locked' cannot have this value"),
        ("locked = 'no'\n", r":1: 'locked' cannot have this value"),
    ],
)
def test_an_unknown_key_is_an_error_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    """A typing mistake must not pass for a setting."""
    write(tmp_path / "srprov.toml", text)

    with pytest.raises(UsageError, match=said):
        default_map({**VERBS, "lab": ""}, tmp_path, own(tmp_path))


def test_an_unknown_key_in_the_users_own_file_is_an_error_too(tmp_path: Path) -> None:
    """Of a shared file only our table counts."""
    write(tmp_path / "home" / ".config" / "srprov" / "srprov.toml", "alow = ['env']\n")

    with pytest.raises(UsageError, match=r"'alow' to set; did you mean 'allow'"):
        default_map(VERBS, tmp_path, own(tmp_path))


def test_of_a_shared_file_only_our_table_counts(tmp_path: Path) -> None:
    """Other tools write what they like, and may leave the file open to others when we have no part in it."""
    write(tmp_path / "pyproject.toml", "[tool.other]\nallow = ['all']\n")
    (tmp_path / "pyproject.toml").chmod(0o666)
    assert default_map(VERBS, tmp_path, own(tmp_path)) == {"plan": {}, "apply": {}}
    write(tmp_path / "pyproject.toml", "[tool.other]\nallow = ['all']\n[tool.srprov.plan]\nallow = ['all']\n")
    (tmp_path / "pyproject.toml").chmod(0o644)
    with pytest.raises(UsageError, match=r"pyproject\.toml:4: a project's file cannot set 'allow'"):
        default_map(VERBS, tmp_path, own(tmp_path))


@pytest.mark.parametrize("name", sorted(OWN_KEYS & set(_VERBS)))
def test_an_option_that_is_called_as_a_verb_is_an_option(tmp_path: Path, name: str) -> None:
    """Its value was taken for the verb's table: a traceback, in whatever folder such a file lay."""
    path = tmp_path / "home/.config/srprov/srprov.toml"
    write(path, f"{name} = true\n")
    parameter = PARAMETERS.get(name, name)
    assert default_map(_VERBS, tmp_path, own(tmp_path))["plan"][parameter] is True
    assert places(_VERBS, ConfigFile(path=path, own=True))["plan", parameter] == 1


@pytest.mark.parametrize("key", sorted(PROJECT_KEYS))
@pytest.mark.parametrize("value", ["0", "1", "0.5", "-3", "true", "'x'"])
def test_a_number_for_an_option_that_is_yes_or_no_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], key: str, value: str
) -> None:
    """`verbose = 1` in a project's file was a traceback of each verb that has the option."""
    write(tmp_path / "srprov.toml", f"{key} = {value}\n")
    monkeypatch.chdir(tmp_path)
    for verb in ("plan", "apply", "logs"):
        run([verb, "none.edf", "-i", "none.yml"])
    assert "a bug in srprov" not in capsys.readouterr().err


@pytest.mark.parametrize("mode", [0o664, 0o646, 0o777])
def test_a_file_that_others_can_write_is_refused(tmp_path: Path, mode: int) -> None:
    """The hint says the command."""
    write(tmp_path / "srprov.toml", "forks = 3\n")
    os.chown(tmp_path / "srprov.toml", -1, 4711)
    (tmp_path / "srprov.toml").chmod(mode)

    with pytest.raises(UsageError, match="can be written by other users") as refused:
        default_map(VERBS, tmp_path, own(tmp_path))
    assert "chmod go-w FILE" in refused.value.hint


@pytest.mark.skipif(os.geteuid() != 0, reason="only of root is known which group is its own")
def test_a_file_that_the_user_s_own_group_can_write_is_taken(tmp_path: Path) -> None:
    """With a umask of 002, as Ubuntu gives it to users, git and editors make all files so."""
    write(tmp_path / "srprov.toml", "forks = 3\n")
    (tmp_path / "srprov.toml").chmod(0o664)
    assert default_map(VERBS, tmp_path, own(tmp_path))["apply"] == {"forks": 3}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
def test_a_file_of_another_user_is_refused(tmp_path: Path) -> None:
    """Whoever owns it can write it at any time."""
    write(tmp_path / "srprov.toml", "forks = 3\n")
    os.chown(tmp_path / "srprov.toml", 4711, 4711)

    with pytest.raises(UsageError, match="belongs to another user"):
        default_map(VERBS, tmp_path, own(tmp_path))


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("whose", ["folder", "link"])
def test_an_own_file_in_whose_place_others_can_put_one_is_refused(tmp_path: Path, whose: str) -> None:
    """They put a link there to one that the user cloned: it names an inventory, which is a program."""
    folder, cloned = user_folder(own(tmp_path)), tmp_path / "cloned"
    cloned.mkdir()
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.symlink_to(cloned)
    write(cloned / "srprov.toml", "forks = 3\n")
    assert default_map(VERBS, tmp_path, own(tmp_path))
    if whose == "link":
        os.lchown(folder, 4711, 4711)
    else:
        folder.parent.chmod(0o777)

    with pytest.raises(UsageError, match="could be replaced by other users"):
        default_map(VERBS, tmp_path, own(tmp_path))


@pytest.mark.parametrize("inventory", ["/etc/hosts", "../lab.yml", "link.yml"])
def test_a_projects_inventory_lies_in_its_folder(tmp_path: Path, inventory: str) -> None:
    """Errors show lines of it, so it may not be just any file."""
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab.yml").write_text("all: {hosts: {r1: }}\n")
    (tmp_path / "lab" / "link.yml").symlink_to(tmp_path / "lab.yml")
    write(tmp_path / "lab" / "srprov.toml", f"inventory = '{inventory}'\n")

    with pytest.raises(UsageError, match="not in the project's folder"):
        default_map(VERBS, tmp_path / "lab", own(tmp_path))


def test_a_projects_configuration_is_no_link_to_a_file_elsewhere(tmp_path: Path) -> None:
    """Errors name keys; of a file that other tools share nothing is read."""
    write(tmp_path / "elsewhere.toml", "hunter2 = 1\n[tool.srprov]\nhunter2 = 1\n")
    (tmp_path / "project").mkdir()
    (tmp_path / "project" / "pyproject.toml").symlink_to(tmp_path / "elsewhere.toml")
    assert not default_map(VERBS, tmp_path / "project", own(tmp_path))["plan"]
    (tmp_path / "project" / "srprov.toml").symlink_to(tmp_path / "elsewhere.toml")
    with pytest.raises(UsageError, match="is a link to another file") as refused:
        default_map(VERBS, tmp_path / "project", own(tmp_path))
    assert "hunter2" not in str(refused.value)


def test_the_users_own_configuration_may_be_a_link(tmp_path: Path) -> None:
    write(tmp_path / "dotfiles.toml", "yes = true\n")
    folder = user_folder(own(tmp_path))
    folder.mkdir(parents=True)
    (folder / "srprov.toml").symlink_to(tmp_path / "dotfiles.toml")
    assert default_map(VERBS, tmp_path, own(tmp_path))["apply"]["yes"] is True


def test_a_relative_folder_for_configuration_is_ignored(tmp_path: Path) -> None:
    """It would be one of the project, with the rights of the user's own."""
    write(tmp_path / "config" / "srprov" / "srprov.toml", "yes = true\n")
    assert user_folder({"XDG_CONFIG_HOME": "config", "HOME": "/home/ada"}) == Path("/home/ada/.config/srprov")


def test_every_option_has_its_place_in_the_lists() -> None:
    """A new option has to be put into one of them; keys reach the option of that name."""
    hidden = {"heartbeat", "help"}
    found = {}
    for verb in _VERBS.keys() - {"lab"}:
        name = _MODULES.get(verb, verb)
        command = getattr(importlib.import_module(f"srprov.cli.{name}"), name)
        below = command.commands.values() if isinstance(command, click.Group) else [command]
        for option in (one for each in below for one in each.params if isinstance(one, click.Option)):
            found[max(option.opts, key=len).lstrip("-")] = option.name
    assert found.keys() - hidden == OWN_KEYS
    for key, name in found.items():
        assert key in hidden or name == PARAMETERS.get(key, key.replace("-", "_"))


def test_a_verb_that_stands_for_several_hands_its_defaults_on(tmp_path: Path) -> None:
    """Click looks for those of `export compose` below `export`, under the name of the second word."""
    for verb in _VERBS.keys() - {"lab"}:
        name = _MODULES.get(verb, verb)
        command = getattr(importlib.import_module(f"srprov.cli.{name}"), name)
        assert isinstance(command, click.Group) == (verb in _GROUPS), verb
        assert not isinstance(command, click.Group) or tuple(sorted(command.commands)) == _GROUPS[verb]
    write(tmp_path / "srprov.toml", "forks = 3\n[export]\ntimeout = 2.0\n")
    found = default_map(_VERBS, tmp_path, own(tmp_path))["export"]
    assert found == {key: {"forks": 3, "timeout": 2.0} for key in ("compose", "kubernetes", "swarm")}


PROGRAM = '#!/bin/sh\ntouch ran\necho \'{"all": {"hosts": ["r1"]}}\'\n'
PROXY = '-o ProxyCommand="touch FOLDER/ran; false"'
BY_PROXY = f"all: {{hosts: {{r1: {{ansible_host: 192.0.2.1, ansible_ssh_common_args: '{PROXY}'}}}}}}\n"
HERE = "all: {hosts: {r1: {ansible_connection: local}}}\n"


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("inventory", [PROGRAM, BY_PROXY, HERE])
def test_only_an_inventory_that_the_user_named_runs_anything_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], named: bool, inventory: str
) -> None:
    """A program, a ProxyCommand and this machine itself; asked by a verb that only looks."""
    write(tmp_path / "inv", inventory.replace("FOLDER", str(tmp_path)))
    (tmp_path / "inv").chmod(0o755)
    write(tmp_path / "srprov.toml", "inventory = 'inv'\ntimeout = 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))

    code = run(["status", *(["-i", "inv"] if named else [])])

    said = capsys.readouterr().err
    if named:
        assert (tmp_path / "ran").exists() or inventory == HERE, said
    else:
        assert code == 5, said
        assert "name it yourself: -i FILE" in said
        assert not (tmp_path / "ran").exists()


def test_only_an_inventory_that_the_user_named_offers_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its errors would tell the value of a variable, and whether a file exists; its key could take minutes to read."""
    write(tmp_path / "inv", "r1 ansible_host=192.0.2.1 ansible_ssh_private_key_file=/tmp/${DECOY}\n")
    write(tmp_path / "srprov.toml", "inventory = 'inv'\ntimeout = 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DECOY", "hunter2")
    assert run(["status"]) == 5
    said = capsys.readouterr().err
    assert "name it yourself: -i FILE" in said and "hunter2" not in said


@pytest.mark.parametrize("project", ["srprov.toml", "pyproject.toml"])
@pytest.mark.parametrize("place", ["", "[plan]\n"])
def test_a_project_names_no_other_robots_than_the_user_himself(tmp_path: Path, project: str, place: str) -> None:
    """They would get the secrets of his own EDF, which lies in a clone, and a plan has their names alone."""
    mine, environ = tmp_path / ".config" / "srprov" / "srprov.toml", {"HOME": str(tmp_path)}
    table = "[tool.srprov]\n" if project.startswith("py") else ""
    below = place.replace("[", "[tool.srprov.") if table else place
    write(tmp_path / "lab" / project, f"{table}forks = 2\n{below}inventory = 'robots.yml'\n")
    write(mine, "forks = 1\n")
    found = default_map(VERBS, tmp_path / "lab", environ)
    assert found["plan"] == {"forks": 2, "inventories": ["robots.yml"]}, "who says nothing gets the project's"
    write(mine, f"forks = 1\n{place}inventory = '{tmp_path}/mine.yml'\n")
    found = default_map(VERBS, tmp_path / "lab", environ)
    assert found["plan"] == {"forks": 2, "inventories": [f"{tmp_path}/mine.yml"]}
    assert found["apply"] == ({"forks": 2, "inventories": [f"{tmp_path}/mine.yml"]} if not place else {"forks": 2})
    write(mine, f"forks = 1\n{place}inventory = 'mine.yml'\n")
    found = default_map(VERBS, tmp_path / "lab", environ)
    assert found["plan"]["inventories"] == ["robots.yml"], "of two names for a file in this folder, the project's"


def test_a_project_gives_no_other_address_to_robots_that_the_user_has_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`inventory = "robot1,robot2,"` means the same robots in each folder, a project's `robot1` another one."""
    write(tmp_path / "conf/srprov/srprov.toml", "inventory = 'robot1,robot2,'\n")
    write(tmp_path / "lab/srprov.toml", "inventory = 'robots.yml'\ntimeout = 1\n")
    write(tmp_path / "lab/robots.yml", "all: {hosts: {robot1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.chdir(tmp_path / "lab")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "conf"))
    environ = {"XDG_CONFIG_HOME": str(tmp_path / "conf")}
    assert default_map(VERBS, tmp_path / "lab", environ)["plan"]["inventories"] == ["robot1,robot2,"]
    run(["facts"])
    said = capsys.readouterr().err
    assert "note: the inventory is robot1,robot2, of your own configuration" in said, said
    assert "127.0.0.1" not in said


def test_robots_that_a_project_has_by_name_are_not_said_to_be_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """His own file has a relative path, which gives way; both kinds of names stand, and one looked like the other."""
    write(tmp_path / "conf/srprov/srprov.toml", "inventory = 'mine.yml'\n")
    write(tmp_path / "lab/srprov.toml", "inventory = '192.0.2.1,'\ntimeout = 0.1\n")
    monkeypatch.chdir(tmp_path / "lab")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "conf"))
    assert run(["facts"]) == 4
    assert "of your own configuration" not in capsys.readouterr().err
    assert run(["config", "facts", "--json"]) == 0
    (row,) = [one for one in json.loads(capsys.readouterr().out)["settings"] if one["setting"] == "inventory"]
    assert (row["value"], row["source"]) == (["192.0.2.1,"], "project")


def test_an_inventory_that_is_set_aside_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Who means the project's robots would else have the experiment on his own."""
    (tmp_path / "lab").mkdir()
    monkeypatch.chdir(tmp_path / "lab")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    write(tmp_path / ".config/srprov/srprov.toml", f"inventory = '{tmp_path}/mine.yml'\n")
    for place in (tmp_path / "mine.yml", tmp_path / "lab/robots.yml"):
        write(place, "all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    note = f"note: the inventory is {tmp_path}/mine.yml, of your own configuration"
    for name, given, told in (
        ("srprov.toml", [], True),
        ("srprov.toml", ["-i", "robots.yml"], False),
        ("other.toml", [], False),
    ):
        write(tmp_path / "lab" / name, "forks = 2\ninventory = 'robots.yml'\n")
        run(["facts", *given])
        said = capsys.readouterr().err
        assert (note in said and "srprov.toml:2 needs -i" in said) if told else note not in said, said
        (tmp_path / "lab" / name).unlink()


def test_nothing_is_said_of_an_inventory_that_a_verb_has_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of the lab of `replay --lab`, which the user's configuration does not name."""
    write(tmp_path / "conf/srprov/srprov.toml", f"inventory = '{tmp_path}/mine.yml'\n")
    write(tmp_path / "srprov.toml", "inventory = 'robots.yml'\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "conf"))
    context = click.Context(click.Command("facts"), info_name="facts", parent=click.Context(cli, info_name="srprov"))
    context.set_parameter_source("inventories", ParameterSource.DEFAULT_MAP)
    context.params["inventories"] = own = (f"{tmp_path}/mine.yml",)
    assert inventory_set_aside(context, own) == f"{tmp_path}/srprov.toml:1"
    assert inventory_set_aside(context, ("/lab/inventory/lab.yml",)) == ""


@pytest.mark.parametrize("word", [f"ansible_{one}" for one in ("password", "ssh_pass", "become_password", "sudo_pass")])
@pytest.mark.parametrize("own", ["r1 {word}=decoy-4711\n", "[all:vars]\n{word}=decoy-4711\n"])
def test_only_an_inventory_that_the_user_named_has_passwords(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], word: str, own: str
) -> None:
    """Another one of the project's would say which address is told it: the user's own file lies in a clone."""
    write(tmp_path / "mine", own.format(word=word))
    write(tmp_path / "site", "r1 ansible_host=127.0.0.1 ansible_port=1\n")
    write(tmp_path / "srprov.toml", "inventory = ['mine', 'site']\ntimeout = 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert run(["facts"]) == 5
    said = capsys.readouterr().err
    assert "'r1' has a password" in said and "name it yourself: -i FILE" in said and "decoy" not in said
    assert run(["facts", "-i", "mine", "-i", "site"]) == 4, "who names both trusts both"


def test_a_program_in_a_folder_is_not_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nor is one at a relative path of the user's own configuration; one at an absolute path is."""
    write(tmp_path / "lab" / "inv", PROGRAM.replace("touch ran", f"touch {tmp_path}/ran"))
    (tmp_path / "lab" / "inv").chmod(0o755)
    assert run(["locks", "-i", str(tmp_path / "lab")]) == 5
    assert "only an inventory that you name yourself as one is run" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("absolute", [False, True])
def test_the_users_own_configuration_names_a_program_by_its_absolute_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, absolute: bool
) -> None:
    """A relative path would be looked for in whatever folder this is."""
    write(tmp_path / "inv", PROGRAM.replace("touch ran", f"touch {tmp_path}/ran; exit 3"))
    (tmp_path / "inv").chmod(0o755)
    write(tmp_path / "home" / ".config" / "srprov" / "srprov.toml", f"inventory = '{'~/../' if absolute else ''}inv'\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)

    assert run(["locks"]) == 5
    assert (tmp_path / "ran").exists() is absolute


@pytest.mark.parametrize("absolute", [False, True])
def test_a_variable_names_a_program_by_its_absolute_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], absolute: bool
) -> None:
    """One that a shell's profile sets holds in every folder, as a configuration does."""
    write(tmp_path / "inv", PROGRAM.replace("touch ran", f"touch {tmp_path}/ran; exit 3"))
    (tmp_path / "inv").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SRPROV_LOCKS_INVENTORY", str(tmp_path / "inv") if absolute else "inv")

    assert run(["locks"]) == 5
    assert (tmp_path / "ran").exists() is absolute
    assert absolute or "name it yourself: -i FILE" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["apply", "replay", "verify"])
@pytest.mark.parametrize("by", ["variable", "configuration"])
def test_a_file_of_signers_that_holds_in_every_folder_has_its_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: str, by: str
) -> None:
    """Else a project that was cloned would say whose signatures count."""
    write(tmp_path / "home" / "team", "")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "team", "")
    write(tmp_path / "x", "no plan")
    call = [verb, "x", *{"apply": ["-i", "none,"], "replay": ["-i", "none,", "-o", "new"]}.get(verb, [])]
    for path in ("team", str(tmp_path / "home" / "team")):
        if by == "variable":
            monkeypatch.setenv(f"SRPROV_{verb.upper()}_SIGNERS", path)
        else:
            write(tmp_path / "home" / ".config" / "srprov" / "srprov.toml", f"[{verb}]\nsigners = '{path}'\n")
        code, said = run(call), capsys.readouterr().err
        assert code != 0
        assert ("would be looked for in whatever folder" in said) is (path == "team"), said
    run([*call, "--signers", "team"])
    assert "would be looked for" not in capsys.readouterr().err


@pytest.mark.parametrize("seconds", ["inf", "-inf", "nan", "1e300", "86401.0", "-1"])
def test_a_project_cannot_make_a_wait_endless_or_impossible(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], seconds: str
) -> None:
    """TOML has `inf` and `nan`, which timers do not take."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    for key, verb in (("timeout", "status"), ("lock-wait", "apply"), ("settle", "apply"), ("time-limit", "plan")):
        write(tmp_path / "srprov.toml", f"{key} = {seconds}\n")
        assert run([verb, "e.edf", "-i", "h"]) == 5
        said = capsys.readouterr().err
        assert f"srprov.toml:1: '{key}' cannot have this value" in said or "is not in the range" in said, said
        (tmp_path / "srprov.toml").unlink()
        option = f"--{key}={seconds}"
        assert run([verb, "e.edf", "-i", "h", option]) == 5
        assert f"error[SRP-212]: --{key}: " in capsys.readouterr().err


@pytest.mark.parametrize("name", ["srprov.toml", "pyproject.toml"])
@pytest.mark.parametrize(
    "text",
    [
        pytest.param("a" + ".a" * 200_000 + " = 1\n", id="a key of many parts"),
        pytest.param("[" + "a." * 2000 + "a]\n" + "".join(f"k{n} = 1\n" for n in range(40_000)), id="a long table"),
        pytest.param("".join(f"k{n} = 1\n" for n in range(40_000)), id="unknown keys"),
        pytest.param("".join(f"[plan.t{n}]\n" for n in range(20_000)), id="unknown tables"),
        pytest.param("[plan]\nforks = 3\n" + "\n" * 900_000, id="a key before many lines"),
        pytest.param("inventory = [" + "'a'," * 100_000 + "]\n", id="many inventories"),
        pytest.param(f"inventory = '{'a/' * 200_000}'\n", id="a long path"),
    ],
)
def test_a_projects_file_is_read_in_time(tmp_path: Path, name: str, text: str) -> None:
    """It is read before every verb, and whoever wrote it may want that none gets further."""
    table = "" if name == "srprov.toml" else "[tool.srprov]\n"
    write(tmp_path / name, table + (text if not table else text.replace("[plan", "[tool.srprov.plan")))

    def read() -> str:
        try:
            return str(default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")})["plan"])
        except UsageError as error:
            return error.message

    assert len(bounded(read)) < 10_000


def _a_key_below(table: str, rows: int) -> str:
    return table + "".join(f"k{number}.a.a.a.a.a.a.a = 1\n" for number in range(rows))


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(_a_key_below("[" + "a." * 63 + "a]\n", 9000), id="a table of many parts"),
        pytest.param(_a_key_below("[[" + "a." * 63 + "a]]\n", 9000), id="a list of tables"),
        pytest.param(_a_key_below("[" + "a." * 63 + "a]\nx = [\n[1]]\n", 9000), id="a list that looks like a table"),
        pytest.param("x = [" + "1," * 140_000 + "]\n", id="a long list"),
        pytest.param("".join(f"k{number} = 1\n" for number in range(40_000)), id="many lines"),
    ],
)
def test_what_is_long_to_read_is_not_taken_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    """Each line costs what the name of its table does, so that a file of a megabyte took every verb six seconds."""
    read: list[str] = []
    reader = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    monkeypatch.setattr(reader, "loads", lambda text: read.append(text) or {})
    write(tmp_path / "srprov.toml", text)
    with pytest.raises(UsageError, match=r"more dots than keys|longer than 256 KiB"):
        default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")})
    assert not read


def test_what_people_write_is_taken_apart(tmp_path: Path) -> None:
    keys = "".join(f"k{number} = ['a==1.2.3']\n" for number in range(50))
    tools = "".join(f"[tool.t{table}.lint.rules]\n{keys}" for table in range(100))
    write(tmp_path / "pyproject.toml", tools + "[tool.srprov]\nforks = 3\n")
    assert default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")})["plan"] == {"forks": 3}


def test_a_file_of_other_tools_is_not_taken_apart(tmp_path: Path) -> None:
    """It may have lines that srprov would refuse in its own."""
    write(tmp_path / "pyproject.toml", "[tool.other]\nx = '" + "." * 5000 + "'\n")
    assert default_map(VERBS, tmp_path, {"HOME": str(tmp_path / "home")}) == {"plan": {}, "apply": {}}
