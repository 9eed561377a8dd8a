"""Files that a Compose project calls secrets', or that are the user's own, are never copied, nor are their values."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.record.memory import note_secret_files

CANARY = "hunter2-hunter2"
MOUNT = "services: {a: {image: x, volumes: ['./keys:/keys:ro']}"
USE = ", up: {image: x, profiles: [up], secrets: [t]}"
SECRET = "secrets: {t: {file: ./keys/token}}\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("keys/token", "sub/keys/token"):
        Path(name).parent.mkdir(parents=True)
        Path(name).write_text(CANARY)
    Path("keys/map").write_text("a map")
    return tmp_path


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"c.yml": f"{MOUNT}{USE}}}\n{SECRET}"}, ("--profile", "other")),
        ({"c.yml": f"{MOUNT}}}\n{SECRET}"}, ()),
        ({"c.yml": f"{MOUNT}}}\n{SECRET}", "d.yml": "secrets: {t: {file: ./other}}\n"}, ()),
        ({"c.yml": f"{MOUNT}}}\nsecrets: {{t: !reset null}}\n", "b.yml": SECRET}, ()),
        ({"c.yml": f"{MOUNT}}}\nsecrets: {{t: {{file: '${{DIR:-./keys}}/token'}}}}\n"}, ()),
    ],
    ids=["the profile is off", "unused", "another one over it", "taken back", "variable"],
)
def test_a_secret_that_no_service_has_is_not_copied(here: Path, files: dict[str, str], words: tuple[str, ...]) -> None:
    for name, text in files.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    named = [name for name in files if "/" not in name]
    assert run(["import", "compose", *sorted(named), *words, "-o", "out"]) == 0
    assert [one.name for one in Path("out").rglob("keys/*")] == ["map"]


@pytest.mark.parametrize("kept", ["keys/token", ".git/config", "../.aws/credentials"])
def test_no_second_name_of_a_file_of_the_users_own_is_imported(
    here: Path, capsys: pytest.CaptureFixture[str], kept: str
) -> None:
    """As an archive makes one that is unpacked there, by a hard link."""
    for name in (".git/config", "../.aws/credentials"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(f"url={CANARY}\n")
    note_secret_files([str(here / "keys/token")])
    Path("pub").mkdir()
    os.link(kept, "pub/x.env")
    Path("pub/map").write_text("a map")
    Path("c.yml").write_text("services: {a: {image: x, volumes: ['./pub:/pub:ro']}}\n")
    known = kept == "keys/token"  # it is left out; what may be anything has to be looked at
    assert run(["import", "compose", "c.yml", "-o", "out"]) == (0 if known else 5)
    assert [one.name for one in Path("out").rglob("pub/*")] == ["map"] * known
    Path("c.yml").write_text("services: {a: {image: x, env_file: pub/x.env}}\n")
    assert run(["import", "compose", "c.yml", "-o", "other"]) == 5
    shown = capsys.readouterr()
    assert CANARY not in shown.out + shown.err and "pub/x.env" in shown.err


def test_no_second_name_of_a_file_beside_a_project_is_imported(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stranger's archive, unpacked among the user's own files, has one."""
    Path("pub/maps").mkdir(parents=True)
    Path("notes").write_text(CANARY)
    os.link("notes", "pub/maps/floor")
    Path("pub/c.yml").write_text("services: {a: {image: x, volumes: ['./maps:/maps:ro']}}\n")
    assert run(["import", "compose", "pub/c.yml", "-o", "out"]) == 5
    told = capsys.readouterr()
    assert "pub/maps/floor" in told.err and "another name" in told.err and not Path("out").exists()
    assert run(["import", "compose", "pub/c.yml", "--root", ".", "-o", "out"]) == 0, capsys.readouterr()


def test_a_secret_of_a_file_that_is_extended_is_not_copied(here: Path) -> None:
    Path("sub/d.yml").write_text(f"services: {{b: {{image: x}}}}\n{SECRET}")
    extended = "services: {a: {extends: {file: sub/d.yml, service: b}, volumes: [%s]}}\n"
    Path("c.yml").write_text(extended % "'./sub:/sub:ro'")
    assert run(["import", "compose", "c.yml", "--root", ".", "-o", "out"]) == 0
    assert not [*Path("out").rglob("token")]


def test_a_secret_of_a_file_that_is_included_is_not_copied(here: Path) -> None:
    Path("more").mkdir()
    Path("more/d.yml").write_text(SECRET.replace("./", "../"))
    Path("c.yml").write_text(f"include: [more/d.yml]\n{MOUNT}}}\n")
    assert run(["import", "compose", "c.yml", "--root", ".", "-o", "out"]) == 0
    assert [one.name for one in Path("out").rglob("keys/*")] == ["map"]


def test_a_folder_that_is_a_secret_is_not_copied(here: Path) -> None:
    Path("sub/map").write_text("a map")
    Path("c.yml").write_text(
        "services: {a: {image: x, volumes: ['./sub:/sub:ro']}}\nsecrets: {t: {file: ./sub/keys}}\n"
    )
    assert run(["import", "compose", "c.yml", "-o", "out"]) == 0
    assert [one.name for one in Path("out/files/sub").iterdir()] == ["map"]


OWN = "ansible_become_password: hunter2-hunter2\n"
ASKS = "services: {a: {image: x, environment: {GREETING: '${ansible_become_password}'}}}\n"
INNER = "include: [{path: inner.yml, env_file: group_vars/all.yml}]\n"
LABELS = "services: {a: {image: x, label_file: group_vars/all.yml}}\n"


@pytest.mark.parametrize("text", [INNER, ASKS, LABELS, LABELS.replace("label_file", "env_file")])
@pytest.mark.parametrize("own", [OWN, f"all:\n  vars:\n    {OWN}", "ansible_become_password=hunter2-hunter2\n"])
def test_no_password_of_robots_becomes_a_variable(
    here: Path, capsys: pytest.CaptureFixture[str], text: str, own: str
) -> None:
    """Under another name nobody knows it again, and a container had it unasked; what the user names himself is read."""
    Path("group_vars").mkdir()
    Path("group_vars/all.yml").write_text(own)
    Path("inner.yml").write_text(ASKS)
    Path("c.yml").write_text(text)
    if text == ASKS:
        Path(".env").symlink_to("group_vars/all.yml")
    assert run(["import", "compose", "c.yml", "-o", "out"]) == 5
    told = capsys.readouterr()
    assert "holds a password of robots" in told.err and CANARY not in told.out + told.err
    assert not Path("out").exists()
    if text == ASKS:
        assert run(["import", "compose", "c.yml", "--env-file", "group_vars/all.yml", "-o", "out"]) == 0


VALUE = "services: {a: {image: x, environment: {GREETING: '${TOKEN}'}}}\n"


@pytest.mark.parametrize(
    "files",
    [
        {"c.yml": f"services: {{a: {{image: x, env_file: keys/token}}{USE}}}\n{SECRET}"},
        {"c.yml": f"services: {{a: {{image: x, label_file: keys/token}}}}\n{SECRET}"},
        {"c.yml": f"services: {{a: {{image: x, env_file: ../here/keys/../keys/token}}}}\n{SECRET}"},
        {"c.yml": "services: {a: {image: x, env_file: keys/token}}\n", "d.yml": SECRET},
        {"c.yml": f"include: [{{path: sub/d.yml, env_file: keys/token}}]\n{SECRET}", "sub/d.yml": VALUE},
        {"c.yml": f"include: [sub/d.yml]\n{VALUE}", "sub/d.yml": "secrets: {t: {file: ../.env}}\n"},
        {"c.yml": "services: {a: {image: x, env_file: keys/token}}\nsecrets: {t: {file: ./keys}}\n"},
        {"c.yml": f"services: {{a: {{image: x, env_file: pub.env}}}}\n{SECRET}"},
    ],
    ids=["variables", "labels", "another way", "another file", "included", ".env", "a folder", "a second name"],
)
def test_no_value_of_a_secret_becomes_a_variable(
    here: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], files: dict[str, str]
) -> None:
    """What mounts the file does not get it; so it is with what names it as a file of variables."""
    Path("keys/token").write_text(f"TOKEN={CANARY}\n")
    Path(".env").write_text(f"TOKEN={CANARY}\n")
    os.link("keys/token", "pub.env")
    for name, text in files.items():
        Path(name).write_text(text.replace("../here", f"../{tmp_path.name}"))
    named = [name for name in files if "/" not in name]
    assert run(["import", "compose", *named, "--root", ".", "-o", "out"]) == 5
    told = capsys.readouterr()
    assert "is the file of a secret" in told.err and CANARY not in told.out + told.err and not Path("out").exists()


def test_a_secret_of_one_robot_s_files_is_no_variable_of_another_one_s(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("keys/token").write_text(f"TOKEN={CANARY}\n")
    Path("c.yml").write_text(f"services: {{b: {{image: x, secrets: [t]}}}}\n{SECRET}")
    Path("d.yml").write_text("services: {a: {image: x, env_file: keys/token}}\n")
    Path("map.yml").write_text("{c.yml: robot1, d.yml: robot2}\n")
    assert run(["import", "compose", "c.yml", "d.yml", "--robot-map", "map.yml", "-o", "out"]) == 5
    assert "d.yml:1" in capsys.readouterr().err and not Path("out").exists()


def test_what_the_user_names_himself_is_read_for_variables_in_the_files(here: Path) -> None:
    Path("keys/token").write_text(f"TOKEN={CANARY}\n")
    Path("c.yml").write_text(VALUE + SECRET)
    assert run(["import", "compose", "c.yml", "--env-file", "keys/token", "-o", "out"]) == 0
    assert CANARY in Path("out/experiment.edf").read_text()


def test_the_file_of_a_secret_stays_one_in_what_is_imported(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An experiment had it read here; now the project has a Compose file, which names no secret."""
    Path("keys/token").write_text(f"TOKEN={CANARY}\n")
    note_secret_files([str(here / "keys/token")])
    Path("c.yml").write_text(f"{MOUNT}}}\n")
    assert run(["import", "compose", "c.yml", "-o", "out"]) == 0
    assert [one.name for one in Path("out").rglob("keys/*")] == ["map"]
    Path("d.yml").write_text("services: {a: {image: x, env_file: keys/token}}\n")
    assert run(["import", "compose", "d.yml", "-o", "other"]) == 5
    assert "or a secret" in capsys.readouterr().err
    (here / "built").mkdir()
    Path("built/Dockerfile").write_text("FROM busybox\nCOPY . /ws\n")
    Path("built/token").write_text(CANARY)
    note_secret_files([str(here / "built/token")])
    Path("s.yml").write_text("version: '1'\nservices: {a: {image: built}}\n")
    assert run(["import", "swarmrob", "s.yml", "built/Dockerfile", "-o", "swarm"]) == 0
    assert list(Path("swarm").rglob("Dockerfile")) and not list(Path("swarm").rglob("token"))
