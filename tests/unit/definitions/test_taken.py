"""What leaves the controller lies in the experiment's folder, or is listed and has to be allowed."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.definitions import check_files, checked, homes, load_experiment, load_inventory
from srprov.definitions.version_control import ELSEWHERE
from srprov.errors import DefinitionError
from srprov.planning.policy import permissions
from srprov.record.memory import note_secret_files
from srprov.secret import forget, redact

MARK = "hunter2-in-a-line-of-a-foreign-file"


@pytest.fixture(autouse=True)
def _forget() -> None:
    forget()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with an experiment's folder `exp`, and beside it somebody's project with a decoy."""
    victim = tmp_path / "victim"
    victim.mkdir()
    (victim / "id").write_text(f"{MARK}: [\n")
    (victim / "Dockerfile").write_text("FROM busybox\nCOPY . /\n")
    (victim / "x.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: id, dest: /id}]\nvolumes: ['./sub:/sub']\n")
    (victim / "sub").mkdir()
    (victim / "sub" / "file").write_text("x")
    (tmp_path / "exp").mkdir()
    monkeypatch.chdir(tmp_path / "exp")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "exp" / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    return tmp_path


def edf(here: Path, service: str, top: str = "") -> Path:
    """Write an EDF of one service."""
    path = here / "exp" / "e.edf"
    path.write_text(f"edf: 1\nname: demo\nservices:\n  a: {service}\n{top}")
    return path


def asked(path: Path, **environ: str) -> set[tuple[str, str]]:
    """Return what an experiment asks for: (kind, what)."""
    return {(one.kind, one.what) for one in permissions(load_experiment(path, environ, outside=True).experiment)}


def test_a_dockerfile_elsewhere_takes_its_whole_folder(here: Path) -> None:
    path = edf(here, f"{{cdf: {here}/victim/Dockerfile}}")
    assert asked(path) == {("outside", f"{here}/victim/Dockerfile"), ("outside", f"{here}/victim/")}


def test_each_file_that_a_cdf_elsewhere_takes_is_listed(here: Path) -> None:
    path = edf(here, "{cdf: ../victim/x.cdf}")
    victim = here / "victim"
    assert asked(path) == {("outside", str(one)) for one in (victim / "x.cdf", victim / "id", f"{victim}/sub/")}


def test_a_cdf_that_extends_one_elsewhere_takes_what_that_takes(here: Path) -> None:
    (here / "exp" / "t.cdf").write_text("cdf: 1\nextends: ../victim/x.cdf\n")
    assert ("outside", f"{here}/victim/x.cdf") in asked(edf(here, "{cdf: t.cdf}"))


@pytest.mark.parametrize("link", ["x.cdf", "."])
def test_links_count_as_what_they_lead_to(here: Path, link: str) -> None:
    (here / "exp" / "in").symlink_to(here / "victim" / link)
    name = "in" if link == "x.cdf" else "in/x.cdf"
    (here / "victim" / "x.cdf").write_text("cdf: 1\nimage: busybox\n")
    assert asked(edf(here, f"{{cdf: {name}}}")) == {("outside", f"{here}/victim/x.cdf")}


def test_an_edf_that_is_a_link_out_of_its_folder_is_one_from_outside(here: Path) -> None:
    (here / "victim" / "e.edf").write_text("edf: 1\nname: demo\nservices: {a: {image: busybox}}\n")
    (here / "exp" / "e.edf").symlink_to(here / "victim" / "e.edf")
    assert asked(here / "exp" / "e.edf") == {("outside", f"{here}/victim/e.edf")}


def test_what_lies_in_the_folder_asks_for_nothing(here: Path) -> None:
    (here / "exp" / "sub").mkdir()
    (here / "exp" / "sub" / "Dockerfile").write_text("FROM busybox\n")
    (here / "exp" / "v.env").write_text("A=1\nNOT_SET\n")
    (here / "exp" / "link.cdf").symlink_to("sub/Dockerfile")
    path = edf(here, "{cdf: sub/Dockerfile, env_file: v.env, environment: [A=1], volumes: ['./sub:/sub']}")
    assert asked(path, A="2") == set()


@pytest.mark.parametrize("file", [".git/credentials", "lab.yml", "keys/id"])
@pytest.mark.parametrize("names", ["image: busybox, env_file: FILE", "cdf: a.cdf", "cdf: FILE", "cdf: b.cdf"])
def test_no_line_of_the_users_own_files_in_the_folder_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], file: str, names: str
) -> None:
    """What checks a stranger's change says so where everybody reads it."""
    texts = {
        ".git/credentials": "- https://me:decoy-4711@lab.example decoy: x: y",
        "lab.yml": "{all: {hosts: {decoy: {ansible_password: decoy-4711}}}}: decoy",
        "keys/id": "-----BEGIN OPENSSH PRIVATE KEY----- decoy",
    }
    texts |= {"a.cdf": f"cdf: 1\ndockerfile: {file}\n", "b.cdf": f"cdf: 1\nbase: busybox\nextends: {file}\n"}
    texts["e.edf"] = f"edf: 1\nname: e\nservices: {{a: {{{names.replace('FILE', file)}}}}}\n"
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert run(["validate", "--allow", "outside", str(tmp_path / "e.edf")]) == 5
    said = capsys.readouterr()
    assert "is not shown of a file that is kept" in said.out + said.err, said
    assert "decoy" not in said.out + said.err and "BEGIN" not in said.out + said.err


@pytest.mark.parametrize("kept", [".git/config", "hosts.yml"])
def test_no_line_of_the_users_own_files_is_shown_as_one_of_a_lock(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kept: str
) -> None:
    """An archive that is unpacked in the clone gives one of them the lock's name."""
    (tmp_path / ".git").mkdir()
    (tmp_path / kept).write_text("all: {ansible_password: decoy-4711, url: 'https://me:decoy-4711@lab.example'}\n")
    (tmp_path / "e.edf").write_text("edf: 1\nname: e\nservices: {a: {image: busybox}}\n")
    os.link(tmp_path / kept, tmp_path / "e.lock")
    assert run(["validate", str(tmp_path / "e.edf")]) == 5
    said = capsys.readouterr()
    assert "is not shown of a file that is kept" in said.out + said.err and "decoy" not in said.out + said.err, said


@pytest.mark.parametrize("file", ["token", "maps/floor"])
def test_no_line_of_a_file_that_a_secret_was_read_from_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], file: str
) -> None:
    """A later version of the EDF calls it a definition, or a second name that an archive gave it."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "token").write_text("decoy: 4711\n")
    os.link(tmp_path / "token", tmp_path / "maps/floor")
    (tmp_path / "e.edf").write_text(f"edf: 1\nname: e\nservices: {{a: {{cdf: {file}}}}}\n")
    assert run(["validate", str(tmp_path / "e.edf")]) == 5
    assert "decoy: 4711" in capsys.readouterr().out
    note_secret_files([os.path.realpath(tmp_path / "token")])
    assert run(["validate", str(tmp_path / "e.edf")]) == 5
    said = capsys.readouterr()
    assert "is not shown of a file that is kept" in said.out + said.err and "decoy" not in said.out + said.err, said


@pytest.mark.parametrize(
    ("service", "top", "what"),
    [
        ("{image: x, volumes: ['./.git:/g']}", "", ".git/"),
        ("{image: x, volumes: ['./.git/config:/g']}", "", ".git/config"),
        ("{image: x, volumes: ['./link:/g']}", "", ".git/config"),
        ("{image: x, volumes: ['./sub/.hg:/g']}", "", "sub/.hg/"),
        ("{image: x, volumes: ['./.Git:/g']}", "", ".Git/"),
        ("{image: x, volumes: ['v:/g']}", "volumes: {v: {seed: ./.git}}\n", ".git/"),
        ("{image: x, data: [{path: .git/config, target: /g}]}", "", ".git/config"),
        ("{image: x, env_file: .git/HEAD}", "", ".git/HEAD"),
        ("{cdf: t.cdf}", "", ".git/config"),
    ],
)
def test_what_version_control_keeps_in_the_folder_is_asked_for(here: Path, service: str, top: str, what: str) -> None:
    """The address of a clone may hold its user's token: who wrote the EDF knows where it lies."""
    exp = here / "exp"
    for folder in (".git", ".Git", "sub/.hg"):
        (exp / folder).mkdir(parents=True)
    (exp / ".git" / "config").write_text("url = https://me:token@example.org/x.git\n")
    (exp / ".git" / "HEAD").write_text("ref: refs/heads/main\n")
    (exp / "link").symlink_to(".git/config")
    (exp / "t.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: .git/config, dest: /g}]\n")
    assert asked(edf(here, service, top)) == {("outside", f"{exp}/{what}")}


@pytest.mark.parametrize("folder", ["_darcs", "_DARCS", "CVS", ".sl", ".pijul", ".repo", ".dvc", "_MTN", "sub/_darcs"])
def test_what_every_version_control_keeps_is_asked_for(here: Path, folder: str) -> None:
    """Darcs writes the address by which a clone was made to `_darcs/prefs/defaultrepo`, with its token."""
    inner = here / "exp" / folder / "prefs"
    inner.mkdir(parents=True)
    (inner / "defaultrepo").write_text(f"https://me:{MARK}@example.org/x\n")
    asked_for = {("outside", f"{inner}/")}
    assert asked(edf(here, f"{{image: busybox, volumes: ['./{folder}/prefs:/g']}}")) == asked_for
    (here / "exp" / "link").symlink_to(folder)
    assert asked(edf(here, "{image: busybox, volumes: ['./link/prefs:/g']}")) == asked_for
    assert asked(edf(here, "{image: busybox, volumes: ['.:/g']}")) == set()  # it is left out there


def test_what_version_control_keeps_is_known_by_another_name_that_a_disk_has_for_it(here: Path) -> None:
    """`GIT~1` on a disk of Windows; here it is a second name of the file that a worktree has."""
    exp = here / "exp"
    (exp / ".git").write_text("gitdir: /home/me/x/.git/worktrees/y\n")
    os.link(exp / ".git", exp / "GIT~1")
    assert asked(edf(here, "{image: busybox, volumes: ['./GIT~1:/g']}")) == {("outside", f"{exp}/GIT~1: {ELSEWHERE}")}


def test_an_env_file_is_judged_by_the_path_by_which_it_is_read(here: Path) -> None:
    """It is read by its path without `..`; by the links on its way it would be another one."""
    exp = here / "exp"
    (exp / ".git").mkdir()
    (exp / ".git" / "credentials").write_text(f"https://me:{MARK}@example.org\n")
    (exp / "a" / "b").mkdir(parents=True)
    (exp / "link").symlink_to("a/b")
    (exp / "g").symlink_to(".git")
    path = edf(here, "{image: busybox, env_file: link/../g/credentials}")
    assert asked(path) == {("outside", f"{exp}/.git/credentials")}


@pytest.mark.parametrize("home", ["exp", ".", "exp/.ssh", "exp/.ssh/ada"])
def test_what_lies_beside_an_edf_in_the_home_is_asked_for(
    here: Path, home: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that came by mail is put anywhere; keys and tokens lie in known places of a home."""
    exp = here / "exp"
    (exp / ".ssh").mkdir()
    (exp / "v.env").write_text("A=1\n")
    (exp / "t.cdf").write_text("cdf: 1\nimage: busybox\n")
    monkeypatch.setenv("HOME", str(here / home))
    path = edf(here, "{cdf: t.cdf, env_file: v.env, volumes: ['./.ssh:/s']}")
    beside = {("outside", str(exp / name)) for name in ("t.cdf", "v.env")}
    shipped = {("outside", f"{exp}/.ssh/")}
    assert asked(path) == {"exp": beside | shipped, ".": set()}.get(home, shipped)


@pytest.mark.parametrize("by", ["sudo", "owner"])
def test_what_lies_in_the_home_of_whom_the_user_came_from_is_asked_for(
    here: Path, by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With sudo HOME is root's: the lab's key is root's alone, so its robots are reached so."""
    (here / "exp" / ".ssh").mkdir()
    users = {4321: str(here / "exp"), os.getuid(): str(here / "exp") if by == "owner" else "/nonexistent"}
    monkeypatch.setattr(homes, "_home", lambda user: users.get(user, ""))
    monkeypatch.setenv("SUDO_UID", "4321" if by == "sudo" else "x")
    assert asked(edf(here, "{image: busybox, volumes: ['./.ssh:/s']}")) == {("outside", f"{here}/exp/.ssh/")}


@pytest.mark.parametrize("verb", [["plan"], ["apply", "--yes"], ["plan", "--allow", "env", "--allow", "secret"]])
def test_without_permission_nothing_from_outside_is_planned(
    here: Path, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    """Exit 9, path by path, before a robot is tried; with permission the robot is."""
    edf(here, "{cdf: ../victim/x.cdf}")
    assert run([*verb, "e.edf", "-i", "inv.yml"]) == 9
    said = capsys.readouterr().err
    assert f"a: outside ({here}/victim/x.cdf)" in said and "--allow outside" in said
    assert "unreachable" not in said and MARK not in said
    assert run(["plan", "e.edf", "-i", "inv.yml", "--allow", "outside"]) != 9


@pytest.mark.parametrize("service", ["{cdf: ../victim/id}", "{cdf: in}", "{cdf: t.cdf}", "{cdf: ../victim/w.cdf}"])
@pytest.mark.parametrize("verb", [["validate"], ["validate", "--format", "json"], ["plan", "-i", "inv.yml"]])
def test_no_word_of_a_file_outside_is_shown(
    here: Path, capsys: pytest.CaptureFixture[str], service: str, verb: list[str]
) -> None:
    """A key, a syntax error, an unknown field: one sentence says that something is wrong, and where to see it."""
    (here / "exp" / "in").symlink_to(here / "victim" / "id")
    (here / "exp" / "t.cdf").write_text("cdf: 1\nextends: ../victim/id\n")
    (here / "victim" / "w.cdf").write_text(f"cdf: 1\nbase: busybox\n{MARK}: {MARK}\nports: ['{MARK}']\n")
    edf(here, service)
    assert run([*verb, "--allow", "outside", "e.edf"]) == 5
    done = capsys.readouterr()
    assert MARK not in done.out + done.err
    assert "what is wrong is not shown" in done.out + done.err
    assert f"srprov validate {here}/victim/" in done.out + done.err
    run(["validate", str(here / "victim" / "w.cdf")])
    assert MARK in capsys.readouterr().out


def test_what_is_not_built_yet_of_a_file_outside_is_not_shown_either(here: Path) -> None:
    (here / "victim" / "w.cdf").write_text(f"cdf: 1\nextends: {{git: 'https://h/{MARK}', path: a.cdf}}\n")
    read = load_experiment(edf(here, "{cdf: ../victim/w.cdf}"), {}, outside=True)
    assert read.unsupported and all(MARK not in repr(one) for one in read.unsupported)


def test_variables_of_hosts_that_are_links_elsewhere_are_not_shown(here: Path) -> None:
    (here / "exp" / "host_vars").mkdir()
    (here / "exp" / "host_vars" / "r1.yml").symlink_to(here / "victim" / "id")
    with pytest.raises(DefinitionError) as refused:
        load_inventory(["inv.yml"])
    assert MARK not in repr(refused.value.problems)
    assert check_files(["inv.yml"])


FOREIGN = """cdf: 1
image: busybox
requires: {arch: [arm64]}
ports: ["8123:80"]
volumes: ["decoy-volume:/decoy-target"]
"""
DECOYS = ("arm64", "8123", "decoy")


@pytest.mark.parametrize(
    "service",
    [
        "{cdf: CDF, requires: {arch: [amd64]}}",
        "{cdf: CDF, ports: ['8123:81']}",
        "{cdf: CDF, secrets: [{source: q, target: /decoy-target}]}",
        "{cdf: CDF}\n  b: {image: busybox, replicas: 2, ports: ['8123:80']}",
        "{cdf: CDF}\n  b: {image: busybox, depends_on: {a: {condition: service_healthy}}}",
    ],
)
@pytest.mark.parametrize("cdf", ["../victim/f.cdf", "t.cdf"])
def test_messages_of_merged_files_show_no_value_of_a_file_outside(
    here: Path, capsys: pytest.CaptureFixture[str], service: str, cdf: str
) -> None:
    """Nor of one that a CDF in the folder extends; what is wrong with the EDF alone is still shown."""
    (here / "victim" / "f.cdf").write_text(FOREIGN)
    (here / "exp" / "t.cdf").write_text("cdf: 1\nextends: ../victim/f.cdf\n")
    written = service.replace("CDF", cdf)
    edf(here, f"{written}\n  z: {{image: busybox, depends_on: [nobody]}}", "secrets: {q: {env: X}}\n")
    assert run(["validate", "--allow", "outside", "e.edf"]) == 5
    lines = capsys.readouterr().out.splitlines()
    messages = [line for line in lines if "error[" in line or "hint:" in line]
    assert any("nobody" in line for line in messages)
    asked_for = [decoy for decoy in DECOYS if decoy not in written]
    assert not [line for line in messages for decoy in asked_for if decoy in line], messages
    assert not [line for line in messages if "line " in line or "'/decoy-target'" in line], messages


def test_a_cdf_that_extends_one_outside_tells_of_itself_alone(here: Path) -> None:
    (here / "victim" / "f.cdf").write_text(FOREIGN)
    (here / "exp" / "t.cdf").write_text(
        "cdf: 1\nextends: ../victim/f.cdf\nports: ['8123:99']\nexpose: ['99999']\nrun: [ls]\n"
    )
    told = [one.message for one in checked([here / "exp" / "t.cdf"], outside=True)[0]]
    assert "'99999' is not within ports 1 to 65535" in told
    assert any("of which nothing is shown" in one for one in told)
    assert not [one for one in told if "8123" in one or "'image'" in one]


def test_an_inventory_of_a_project_reads_no_variables_elsewhere(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Named by srprov.toml, not by the user: a link to a file, to a folder, or in a folder."""
    (here / "victim" / "vars").mkdir()
    (here / "victim" / "vars" / "r1.yml").write_text("ansible_host: 192.0.2.77\n")
    (here / "exp" / "srprov.toml").write_text("inventory = 'inv.yml'\n")
    for kind, name, link in (
        ("host_vars", "r1.yml", "vars/r1.yml"), ("group_vars", "all", "vars"), ("host_vars", "r1/x.yml", "vars/r1.yml"),
        (".", "host_vars", "vars"),
    ):  # fmt: skip
        place = here / "exp" / kind / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(here / "victim" / link)
        assert run(["locks"]) == 5, (kind, name)
        assert "or is linked there, and you did not name it" in capsys.readouterr().err
        assert load_inventory(["inv.yml"]).hosts["r1"], "the user's own may"
        place.unlink()
        if kind != ".":
            shutil.rmtree(here / "exp" / kind)


@pytest.mark.parametrize("name", ["also.yml", "host_vars/r1.yml", "group_vars/all/x.yml"])
def test_an_inventory_of_a_project_reads_no_file_by_a_further_name(
    here: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """An archive that is unpacked in a home gives any file of the user's a second name (a hard link)."""
    own = here / "victim" / "own.yml"
    own.write_text(f"all: {{hosts: {{r1: {{ansible_user: {MARK}}}}}}}\nansible_user: {MARK}\n")
    (here / "exp" / name).parent.mkdir(parents=True, exist_ok=True)
    (here / "exp" / name).hardlink_to(own)
    (here / "exp" / "srprov.toml").write_text("inventory = ['inv.yml', 'also.yml']\n")
    if name != "also.yml":
        (here / "exp" / "also.yml").write_text("")
    assert run(["locks"]) == 5
    said = capsys.readouterr()
    assert f"'{name}' lies elsewhere, or is linked there" in said.err and MARK not in said.out + said.err
    if name != "also.yml":
        assert load_inventory(["inv.yml"]).hosts["r1"].user == MARK, "the user's own may"
    kept = here / "exp" / ".git"
    kept.mkdir()
    (here / "exp" / name).unlink()
    own.rename(kept / "own.yml")
    (here / "exp" / name).symlink_to(kept / "own.yml")
    assert run(["locks"]) == 5
    said = capsys.readouterr()
    assert f"'{name}' lies elsewhere, or is linked there" in said.err and MARK not in said.out + said.err


def test_an_inventory_of_the_users_configuration_is_reached_by_no_link_out_of_the_folder(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A relative path of his own is looked for in whatever folder he is in: a project has a link of that name."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(here / "config"))
    (here / "config" / "srprov").mkdir(parents=True)
    (here / "config" / "srprov" / "srprov.toml").write_text("inventory = 'lab/inv.yml'\n")
    (here / "victim" / "inv.yml").write_text((here / "exp" / "inv.yml").read_text().replace("r1", MARK))
    (here / "exp" / "lab").symlink_to(here / "victim")
    assert run(["locks"]) == 5
    said = capsys.readouterr()
    assert "'lab' is a link that leads out of this folder" in said.err
    assert MARK not in said.out + said.err
    with pytest.raises(DefinitionError, match="1 problem"):
        load_inventory(["lab"], unnamed=["lab"])
    assert load_inventory(["lab/inv.yml"]).hosts.keys() == {MARK}, "the user's own may"
    (here / "exp" / "robots").mkdir()
    (here / "exp" / "robots" / "inv.yml").write_text((here / "exp" / "inv.yml").read_text())
    (here / "exp" / "lab").unlink()
    (here / "exp" / "lab").symlink_to("robots")
    assert load_inventory(["lab/inv.yml"], unnamed=["lab/inv.yml"]).hosts.keys() == {"r1"}, "it stays in the folder"


def test_a_folder_of_a_project_as_inventory_reads_no_file_elsewhere(here: Path) -> None:
    (here / "exp" / "lab").mkdir()
    (here / "exp" / "lab" / "robots.yml").symlink_to(here / "exp" / "inv.yml")
    with pytest.raises(DefinitionError, match="1 problem") as refused:
        load_inventory(["lab"], unnamed=["lab"])
    assert "'robots.yml' lies elsewhere" in refused.value.problems[0].message
    assert load_inventory(["lab"]).hosts.keys() == {"r1"}


def test_a_link_to_a_name_that_no_engine_takes_is_refused(here: Path) -> None:
    strange = here / "exp" / os.fsdecode(b"data\xff")
    strange.mkdir()
    (here / "exp" / "data").symlink_to(strange.name)
    (told,) = check_files([edf(here, "{image: busybox, volumes: ['./data:/data:ro']}")])
    assert told.message == "'./data' leads to a name that is not UTF-8"


@pytest.mark.parametrize(
    "service",
    [
        "{image: busybox, environment: [CLOUD_KEY, OTHER]}",
        "{image: busybox, environment: [OTHER=x], env_file: v.env}",
        "{cdf: t.cdf, environment: [OTHER=x]}",
        "{cdf: built.cdf, environment: [CLOUD_KEY=mine]}",
    ],
)
def test_a_bare_name_is_listed_and_its_value_is_a_secret(here: Path, service: str) -> None:
    """From the EDF, an env_file, a CDF; also when it is only built into the image."""
    (here / "exp" / "v.env").write_text("CLOUD_KEY\n")
    (here / "exp" / "t.cdf").write_text("cdf: 1\nimage: busybox\nenvironment: [CLOUD_KEY]\n")
    (here / "exp" / "built.cdf").write_text("cdf: 1\nbase: busybox\nenvironment: [CLOUD_KEY]\n")
    found = asked(edf(here, service), CLOUD_KEY="key-of-the-cloud", OTHER="other-word")
    assert ("env", "CLOUD_KEY, from the controller's environment") in found
    assert redact("got key-of-the-cloud") == "got ***"


def test_a_name_that_is_given_a_value_takes_none(here: Path) -> None:
    (here / "exp" / "t.cdf").write_text("cdf: 1\nimage: busybox\nenvironment: [CLOUD_KEY]\n")
    path = edf(here, "{cdf: t.cdf, environment: {CLOUD_KEY: mine}}")
    assert asked(path, CLOUD_KEY="key-of-the-cloud") == set()


def test_without_permission_no_variable_is_taken(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit 9 names the variable and not its value; validate needs no permission."""
    monkeypatch.setenv("CLOUD_KEY", "key-of-the-cloud")
    edf(here, "{image: busybox, environment: [CLOUD_KEY]}")
    assert run(["plan", "e.edf", "-i", "inv.yml"]) == 9
    said = capsys.readouterr().err
    assert "a: env (CLOUD_KEY, from the controller's environment)" in said and "--allow env" in said
    assert run(["validate", "e.edf"]) == 0
    assert run(["plan", "e.edf", "-i", "inv.yml", "--allow", "env"]) != 9
    assert "key-of-the-cloud" not in said + capsys.readouterr().err


def test_a_tag_of_a_file_does_not_pass_for_a_value_of_the_controller(here: Path) -> None:
    """The mark for such values means nothing in a file."""
    with pytest.raises(DefinitionError):
        load_experiment(edf(here, "{image: busybox, environment: {A: !controller x}}"), {})


def test_variables_elsewhere_are_not_even_looked_through(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A link to the root of all would take long, and tell the names of files there."""
    (here / "exp" / "host_vars").mkdir()
    (here / "exp" / "host_vars" / "r1").symlink_to("/")
    monkeypatch.setattr(os, "walk", lambda path: pytest.fail(f"{path} was looked through"))
    with pytest.raises(DefinitionError, match="1 problem"):
        load_inventory(["inv.yml"], unnamed=["inv.yml"])


def test_a_host_has_no_more_files_of_variables_than_anybody_writes(here: Path) -> None:
    folder = here / "exp" / "host_vars" / "r1"
    folder.mkdir(parents=True)
    for number in range(1001):
        (folder / f"{number}.yml").touch()
    with pytest.raises(DefinitionError) as refused:
        load_inventory(["inv.yml"])
    assert "more than 1000 files" in refused.value.problems[0].message


@pytest.mark.parametrize("fields", ["dockerfile: ../id", "dockerfile: ../../id", "extends: ../id", "extends: ../../id"])
def test_an_edf_above_that_does_not_name_a_cdf_gives_it_no_files_beside_it(
    here: Path, capsys: pytest.CaptureFixture[str], fields: str
) -> None:
    """A project that was cloned into a folder with EDFs of the user's shows no line of what lies there."""
    clone = here / "victim" / "clone"
    (clone / "sub").mkdir(parents=True)
    place = clone / "sub" if "../../" in fields else clone
    (here / "victim" / "mine.edf").write_text("edf: 1\nname: mine\nservices: {a: {cdf: x.cdf}}\n")
    (place / "x.cdf").write_text(f"cdf: 1\n{fields}\n")
    for named in (place / "x.cdf", clone):
        assert run(["validate", "--allow", "outside", str(named)]) == 5
        said = capsys.readouterr()
        assert MARK not in said.out + said.err
        assert "outside of" in said.out or "leaves the folder" in said.out


@pytest.mark.parametrize("named", ["containers/x.cdf", "containers/child.cdf"])
def test_a_cdf_may_use_the_folder_of_an_edf_that_leads_to_it(here: Path, named: str) -> None:
    folder = here / "exp" / "containers"
    folder.mkdir()
    (here / "exp" / "id").write_text("x")
    (folder / "x.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: ../id, dest: /id}]\n")
    (folder / "child.cdf").write_text("cdf: 1\nextends: x.cdf\n")
    edf(here, f"{{cdf: {named}}}")
    (here / "exp" / "broken.edf").write_text("services: [")
    assert check_files([folder / "x.cdf"]) == []
    (here / "exp" / "e.edf").unlink()
    assert [one.code for one in check_files([folder / "x.cdf"])]


@pytest.mark.parametrize("name", ["x.edf", "x.cdf", "x.yml", "hosts"])
@pytest.mark.parametrize("link", ["file", "folder"])
def test_no_line_is_shown_of_what_a_link_in_a_projects_folder_leads_to(
    here: Path, capsys: pytest.CaptureFixture[str], name: str, link: str
) -> None:
    """Neither where it is wrong, nor in a warning about what is right."""
    right = f"command: [login, '${{PASS}}{MARK}']"
    texts = [f"a: b: {MARK}\n", f"{MARK}\n", f"cdf: {MARK}\nservices: {MARK}\n"]
    texts += [f"edf: 1\nname: x\nservices: {{a: {{image: x, environment: {{A: '${{A}}{MARK}'}}, {right}}}}}\n"]
    texts += [f"cdf: 1\nimage: x\nenvironment: {{A: '${{A}}{MARK}'}}\n{right}\n"]
    (here / "exp" / ("sub" if link == "folder" else name)).symlink_to(
        here / "victim" if link == "folder" else here / "victim" / name
    )
    for words in texts:
        (here / "victim" / name).write_text(words)
        run(["validate", "--allow", "outside", f"sub/{name}" if link == "folder" else name])
        said = capsys.readouterr()
        assert MARK not in said.out + said.err, words


@pytest.mark.parametrize("name", ["e.edf", "a.cdf", "Dockerfile", "robots.yml", "hosts"])
def test_no_line_is_shown_of_what_a_link_into_a_repository_leads_to(
    here: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """It lies in the folder, and holds the token in a clone's address."""
    (here / "exp" / ".git").mkdir(exist_ok=True)
    (here / "exp" / name).symlink_to(f".git/{name}")
    for words in (f"a: b: {MARK}\n", f"{MARK}\n", f"[remote]\n\turl = {MARK}\n", f"cdf: {MARK}\nservices: {MARK}\n",
                  f"edf: 1\nname: x\nservices: {{a: {{image: x, environment: {{A: '${{A}}{MARK}'}}}}}}\n"):  # fmt: skip
        (here / "exp" / ".git" / name).write_text(words)
        run(["validate", "--allow", "outside", name])
        said = capsys.readouterr()
        assert MARK not in said.out + said.err, words


def test_no_line_of_a_lock_below_such_a_link_is_shown(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "victim" / "e.edf").write_text("edf: 1\nname: demo\nservices: {a: {image: busybox}}\n")
    (here / "victim" / "e.lock").write_text(f"lock: {MARK}\n")
    (here / "exp" / "sub").symlink_to(here / "victim")
    assert run(["validate", "--allow", "outside", "sub/e.edf"]) == 5
    said = capsys.readouterr()
    assert MARK not in said.out + said.err and "is not valid" in said.out


def test_an_inventory_that_a_project_names_says_no_site(here: Path) -> None:
    """At a site other keys of the user's are at hand, and other robots."""
    (here / "exp" / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 192.0.2.1, srprov_site: west}}}\n")
    with pytest.raises(DefinitionError) as refused:
        load_inventory(["inv.yml"], unnamed=["inv.yml"])
    assert "ssh options or a site" in refused.value.problems[0].message
    assert load_inventory(["inv.yml"]).hosts["r1"].site == "west", "the user's own may"
