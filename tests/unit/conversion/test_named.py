"""Names in a stranger's project that lead to files of the user's: no import follows them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.cli.main import run

CANARY = "nobodys-business"
COMPOSE = "services: {a: {image: x, environment: {A: '${A}'}}}\n"
SWARMROB = "version: '1'\nservices: {a: {image: private}}\n"


@pytest.fixture
def private(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder of the user's, beside the project, which is the current one."""
    monkeypatch.chdir(tmp_path)
    away = tmp_path / "home" / "private"
    away.mkdir(parents=True)
    for name, text in {
        "Dockerfile": "FROM busybox\n",
        "key": CANARY,
        "notes.yml": f"{CANARY}: 1\n",
        "vars.env": f"A={CANARY}\n",
        "more.yml": "services: {a: {image: x}}\n",
    }.items():
        (away / name).write_text(text)
    project = tmp_path / "project"
    project.mkdir()
    (project / "compose.yml").write_text(COMPOSE)
    (project / "swarm.yml").write_text(SWARMROB)
    (project / "built").symlink_to(away)
    (tmp_path / "own.env").write_text("A=1\n")
    (project / "Dockerfile").symlink_to(away / "Dockerfile")
    for name in ("notes.yml", "vars.env", "more.yml"):
        (project / name).symlink_to(away / name)
    return away


@pytest.mark.parametrize("kind", ["link", "second name"])
def test_no_line_of_what_version_control_keeps_is_shown(
    private: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    """It lies in the project's own folder, and an archive may have given it another name there."""
    (Path("project") / ".git").mkdir()
    kept, named = Path("project/.git/config"), Path("project/more-compose.yml")
    kept.write_text(f"[remote]\n\t{CANARY} = 1\n")
    if kind == "link":
        named.symlink_to(".git/config")
    else:
        named.hardlink_to(kept)
    assert run(["import", "compose", str(named), "-o", "new"]) == 5
    said = capsys.readouterr()
    assert CANARY not in said.out + said.err and "into a repository" in said.out + said.err


@pytest.mark.parametrize(
    "words",
    [
        ("compose", "project/notes.yml"),
        ("compose", "project/compose.yml", "--set", "A=1", "project/more.yml"),
        ("compose", "project/compose.yml", "--set", "A=1", "project/built/more.yml"),
        ("compose", "project/compose.yml", "--env-file", "project/vars.env"),
        ("compose", "project/more.yml", "--env-file", "own.env"),  # a file of the user's, further up
        ("compose", "project/built/more.yml"),
        ("compose", "project/compose.yml", "--set", "A=1", "--robot-map", "project/notes.yml"),
        ("swarmrob", "project/notes.yml"),
        ("swarmrob", "project/swarm.yml", "project/Dockerfile"),
        ("swarmrob", "project/swarm.yml", "project/built/Dockerfile"),
        ("swarmrob", "project/built/Dockerfile", "project/swarm.yml"),
    ],
)
def test_a_link_in_a_project_is_not_followed_out_of_it(
    private: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    """Its lines were shown, or all that lies beside it was copied into the experiment."""
    assert run(["import", *words, "-o", "out"]) == 5
    told = capsys.readouterr()
    assert f"name that: {private}/" in told.err and CANARY not in told.out + told.err
    assert not Path("out").exists()


def test_what_the_user_names_himself_is_read(private: Path) -> None:
    """So is a link that leads to another file of its folder."""
    Path("project/now.yml").symlink_to("compose.yml")
    assert run(["import", "compose", "project/now.yml", "--env-file", f"{private}/vars.env", "-o", "one"]) == 0
    assert CANARY in Path("one/experiment.edf").read_text()
    assert run(["import", "swarmrob", "project/swarm.yml", f"{private}/Dockerfile", "-o", "two"]) == 0


@pytest.mark.parametrize("tool", [("compose", "compose.yml"), ("swarmrob", "swarm.yml")])
def test_nothing_beside_a_file_in_the_home_is_imported(
    private: Path, tool: tuple[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Keys lie there, and `volumes: [./.ssh:/s]` would make them files of the experiment."""
    project = private.parents[1] / "project"
    monkeypatch.setenv("HOME", str(project))
    assert run(["import", tool[0], str(project / tool[1]), "-o", "out"]) == 5
    assert "it lies in your home" in capsys.readouterr().err and not (private.parents[1] / "out").exists()


@pytest.mark.parametrize(
    "service",
    [
        "env_file: .git/credentials",
        "env_file: g/credentials",
        "label_file: .git/credentials",
        "volumes: ['./.git/credentials:/x:ro']",
        "volumes: ['./.git:/x']",
        "configs: [c]",
        "build: .git",
    ],
)
def test_nothing_that_version_control_keeps_is_imported(
    tmp_path: Path, service: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Values of an env file stand in the experiment afterwards, and nobody is asked for them any more."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "credentials").write_text(f"https://me:{CANARY}@example.org\n")
    (tmp_path / ".git" / "Dockerfile").write_text("FROM busybox\n")
    (tmp_path / "g").symlink_to(".git")
    of_image = "" if service.startswith("build") else "image: x, "
    (tmp_path / "compose.yml").write_text(
        f"services: {{a: {{{of_image}{service}}}}}\nconfigs: {{c: {{file: .git/credentials}}}}\n"
    )
    assert run(["import", "compose", "compose.yml", "--name", "x", "-o", "out"]) == 5
    told = capsys.readouterr()
    assert "lies outside" in told.out + told.err and CANARY not in told.out + told.err
    assert not Path("out").exists()


@pytest.fixture
def together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a stranger's project; beside it lies one of the user's, with a file that is laid over it."""
    monkeypatch.chdir(tmp_path)
    for name, text in {
        "lab/mine.yml": "services: {a: {environment: {RATE: '5'}}}\n",
        "lab/base.yml": "services: {own: {image: x}}\n",
        "lab/notes.txt": CANARY,
        "lab/vars.env": f"A={CANARY}\n",
        "lab/more.yml": f"services: {{a: {{image: x, labels: {{l: {CANARY}}}}}}}\n",
        "lab/own/file": CANARY,
        "lab/own/Dockerfile": f"FROM busybox\n# {CANARY}\n",
        "stranger/Dockerfile": "FROM busybox\n",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text(text)
    return tmp_path / "stranger"


NAMES = [
    "services: {a: {image: x, volumes: ['../lab/notes.txt:/n:ro']}}",
    "services: {a: {image: x, volumes: ['../lab/own:/n']}}",
    "services: {a: {image: x, volumes: [{type: bind, source: ../lab/own, target: /n}]}}",
    "services: {a: {image: x, env_file: ../lab/vars.env}}",
    "services: {a: {image: x, label_file: ../lab/vars.env}}",
    "services: {a: {image: x, configs: [c]}}\nconfigs: {c: {file: ../lab/notes.txt}}",
    "services: {a: {build: ../lab/own}}",
    "services: {a: {build: {context: ., dockerfile: ../lab/own/Dockerfile}}}",
    "services: {a: {extends: {file: ../lab/more.yml, service: a}}}",
    "services: {b: {image: x}}\ninclude: [../lab/more.yml]",
    "services: {b: {image: x}}\ninclude: [{path: more.yml, project_directory: ../lab}]",
    "services: {b: {image: x}}\ninclude: [{path: more.yml, env_file: ../lab/vars.env}]",
    "services: {a: {image: x, volumes: ['vol:/n']}}\n"
    "volumes: {vol: {driver: local, driver_opts: {type: none, o: bind, device: ../lab/own}}}",
]


def refused_as_outside(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Import files, and look that nothing is written, and no word of the user's own file is shown."""
    assert run(["import", "compose", *files, "-o", "new"]) == 5
    said = capsys.readouterr()
    assert not Path("new").exists() and CANARY not in said.out + said.err and "lies outside" in said.out + said.err


@pytest.mark.parametrize("text", NAMES)
def test_a_file_names_nothing_that_lies_beside_its_folder(
    together: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    """It may be a stranger's, in a folder among the user's own."""
    (together / "compose.yml").write_text(f"{text}\n")
    (together / "more.yml").write_text("services: {a: {image: '${A:-x}'}}\n")
    refused_as_outside(["stranger/compose.yml"], capsys)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("services: {a: {image: x, volumes: ['..:/w']}}", ".."),
        ("services: {a: {build: ..}}", ".."),
        ("services: {a: {image: x, configs: [c]}}\nconfigs: {c: {file: ../c}}", "../c"),
    ],
)
def test_a_path_that_begins_elsewhere_than_it_looks_is_shown_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], text: str, named: str
) -> None:
    """To who reads `.devcontainer/compose.yml`, `..` is the project, and to Compose what is around that."""
    (tmp_path / "project" / ".devcontainer").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "project")
    Path("compose.yml").write_text("services: {b: {image: x}}\n")
    Path(".devcontainer/compose.yml").write_text(f"{text}\n")
    files = ["compose.yml", ".devcontainer/compose.yml"]
    assert run(["import", "compose", *files, "--root", ".", "-o", "new"]) == 5
    where = os.path.normpath(tmp_path / "project" / named)
    assert f"'{named}' is {where}, as paths begin at the folder of the first file" in capsys.readouterr().out
    assert run(["import", "compose", files[1], "-o", "new"]) == 5
    assert f"'{named}' lies outside" in capsys.readouterr().out


def test_no_file_of_variables_is_read_by_a_link_out_of_its_folder(
    together: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (together / "compose.yml").write_text("services: {a: {image: x, env_file: ./linked.env}}\n")
    (together / "own.env").write_text("A=1\n")
    for target, code in (("../lab/vars.env", 5), ("own.env", 0)):
        (together / "linked.env").unlink(missing_ok=True)
        (together / "linked.env").symlink_to(target)
        assert run(["import", "compose", "stranger/compose.yml", "-o", "new"]) == code, capsys.readouterr()
    assert CANARY not in Path("new/experiment.edf").read_text()


def test_a_file_of_a_whole_project_names_what_lies_anywhere_in_it(together: Path) -> None:
    """Relative paths begin in the folder of the first one, whichever file they stand in."""
    (together / "map.yaml").write_text("a map")
    (together / "compose.yml").write_text("services: {a: {image: x, volumes: ['./map.yaml:/m:ro']}}\n")
    mine = "env_file: ../lab/vars.env, volumes: ['../lab/notes.txt:/n:ro']"
    Path("lab/mine.yml").write_text(f"services: {{a: {{{mine}}}}}\n")
    assert run(["import", "compose", "stranger/compose.yml", "lab/mine.yml", "--root", ".", "-o", "new"]) == 0
    assert Path("new/files/lab/notes.txt").read_text() == CANARY
    assert Path("new/files/stranger/map.yaml").read_text() == "a map"


@pytest.mark.parametrize("form", ["text", "markdown", "json", "sarif"])
def test_a_note_and_what_to_look_at_is_in_every_form(
    together: Path, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    Path("lab/more.yml").write_text("services: {more: {image: x}}\n")
    Path("map").write_text("lab/base.yml: r1\nlab/more.yml: r2\n")
    files = ["lab/base.yml", "lab/more.yml", "--robot-map", "map"]
    assert run(["import", "compose", *files, "-o", "new", "--format", form]) == 0
    for told in (capsys.readouterr().out, Path("new/import-report.md").read_text()):
        assert "all robots' services reach each other" in told and "import each robot's files by themselves" in told


def test_variables_are_for_all_files_of_a_whole_project(together: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those of `.env` beside the first as well."""
    Path("lab/.env").write_text("A=1\n")
    Path("lab/base.yml").write_text("services: {a: {image: 'x:${A}'}}\ninclude: [own/more.yml]\n")
    Path("lab/own/more.yml").write_text("services: {c: {image: 'x:${A}'}}\n")
    (together / "compose.yml").write_text("services: {b: {image: 'x:${A}'}}\n")
    files = ["lab/base.yml", "stranger/compose.yml", "--root", "."]
    for words in ([], ["--env-file", "lab/.env"]):
        assert run(["import", "compose", *files, *words, "-o", f"new{len(words)}"]) == 0, capsys.readouterr().err
        assert Path(f"new{len(words)}/experiment.edf").read_text().count("x:1") == 3


@pytest.fixture
def ros_project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project as ROS packages have it: Compose files in `docker`, what they build and mount beside that."""
    project = tmp_path / "nav"
    for name in ("docker", "src", "db", ".git"):
        (project / name).mkdir(parents=True)
    (project / "Dockerfile").write_text("FROM x\nCOPY src /src\n")
    (project / "src" / "node.py").write_text("print()\n")
    (project / "db" / "init.sql").write_text("select 1;\n")
    (project / ".git" / "config").write_text("token\n")
    (project / "docker" / ".env").write_text("TAG=7\n")
    (project / "db" / "db.yml").write_text(
        "services: {db: {image: 'x:${TAG}', volumes: ['../docker/conf:/c:ro', '../db/init.sql:/i.sql:ro']}}\n"
    )
    (project / "docker" / "conf").mkdir()
    (project / "docker" / "compose.yml").write_text(
        "include: [../db/db.yml]\n"
        "services:\n  nav: {build: {context: .., dockerfile: Dockerfile}, volumes: ['../src:/s:ro']}\n"
    )
    monkeypatch.chdir(project)
    return project


@pytest.mark.usefixtures("ros_project")
def test_the_folder_of_a_whole_project_is_named_by_the_user(capsys: pytest.CaptureFixture[str]) -> None:
    """`docker/compose.yml` builds with `..`, as many projects do."""
    assert run(["import", "compose", "docker/compose.yml", "-o", "new"]) == 5
    assert "where the whole project is your own, say which folder that is: --root DIR" in capsys.readouterr().err
    assert run(["import", "compose", "docker/compose.yml", "--root", ".", "-o", "new"]) == 0, capsys.readouterr().err
    made = {str(one.relative_to("new/files")) for one in Path("new/files").rglob("*") if one.is_file()}
    assert {"Dockerfile", "src/node.py", "db/init.sql", "docker/.env"} <= made and not any(
        ".git/" in one for one in made
    )
    assert "x:7" in Path("new/experiment.edf").read_text()


def test_nothing_around_a_whole_project_is_named(ros_project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (ros_project.parent / "private.txt").write_text(CANARY)
    Path("docker/compose.yml").write_text("services: {a: {image: x, volumes: ['../../private.txt:/p:ro']}}\n")
    assert run(["import", "compose", "docker/compose.yml", "--root", ".", "-o", "new"]) == 5
    assert "lies outside" in capsys.readouterr().out and not Path("new").exists()


@pytest.mark.usefixtures("ros_project")
def test_a_home_and_a_link_are_no_whole_project(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("up").symlink_to(tmp_path)
    assert run(["import", "compose", "docker/compose.yml", "--root", "up", "-o", "new"]) == 5
    assert "leads out of the folder" in capsys.readouterr().err
    monkeypatch.setenv("HOME", str(tmp_path))
    assert run(["import", "compose", "docker/compose.yml", "--root", "..", "-o", "new"]) == 5
    assert "it is your home" in capsys.readouterr().err


@pytest.mark.usefixtures("ros_project")
def test_both_names_of_a_file_may_be_in_a_whole_project(capsys: pytest.CaptureFixture[str]) -> None:
    Path("docker/conf/init.sql").hardlink_to("db/init.sql")
    Path("docker/compose.yml").write_text("services: {a: {image: x, volumes: ['./conf:/c:ro']}}\n")
    assert run(["import", "compose", "docker/compose.yml", "-o", "new"]) == 5
    assert "hard link" in capsys.readouterr().err
    assert run(["import", "compose", "docker/compose.yml", "--root", ".", "-o", "new"]) == 0, capsys.readouterr().err
    assert list(Path("new/files").rglob("init.sql"))
