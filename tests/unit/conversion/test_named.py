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
def test_a_file_names_nothing_that_lies_beside_another_one_of_the_users(
    together: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    """It may be a stranger's, and what the user lays over it lies among his own files."""
    (together / "compose.yml").write_text(f"{text}\n")
    (together / "more.yml").write_text("services: {a: {image: '${A:-x}'}}\n")
    for files in (["stranger/compose.yml", "lab/mine.yml"], ["lab/base.yml", "stranger/compose.yml"]):
        assert run(["import", "compose", *files, "-o", "new"]) == 5
        said = capsys.readouterr()
        assert not Path("new").exists() and CANARY not in said.out + said.err and "lies outside" in said.out + said.err


@pytest.mark.parametrize("text", NAMES)
def test_a_clone_below_the_users_folder_names_nothing_of_that_folder(
    together: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    """It lies in his folder, too; the nearest folder counts."""
    (together / "compose.yml").write_text(f"{text}\n")
    (together / "more.yml").write_text("services: {a: {image: '${A:-x}'}}\n")
    Path("mine.yml").write_text("services: {a: {environment: {RATE: '5'}}}\n")
    refused_as_outside(["stranger/compose.yml", "mine.yml"], capsys)


def test_of_a_folder_below_a_file_names_nothing_further_up_either(
    together: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The user's own file, which comes first, says where relative paths begin; that one may name what is below."""
    (together / "compose.yml").write_text("services: {a: {image: x, volumes: ['./lab/notes.txt:/n:ro']}}\n")
    Path("base.yml").write_text("services: {own: {image: x, volumes: ['./stranger/Dockerfile:/d:ro']}}\n")
    assert run(["import", "compose", "base.yml", "stranger/compose.yml", "-o", "new"]) == 5
    said = capsys.readouterr().out
    assert "stranger/compose.yml:1" in said and "lies outside of the folder of the file that says so" in said
    (together / "compose.yml").write_text("services: {a: {image: x}}\n")
    assert run(["import", "compose", "base.yml", "stranger/compose.yml", "-o", "new"]) == 0, capsys.readouterr().err


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


def test_no_file_of_variables_is_read_by_a_link_out_of_a_folder_of_another_file(
    together: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The user's own file may name both; where the link leads is the word of who wrote what lies in that folder."""
    (together / "compose.yml").write_text("services: {a: {image: x}}\n")
    (together / "own.env").write_text("A=1\n")
    Path("vars.env").write_text(f"B={CANARY}\n")
    text = "services: {own: {image: x, env_file: ./stranger/linked.env}}\ninclude: [./stranger/compose.yml]\n"
    Path("base.yml").write_text(text)
    for target, code in (("../vars.env", 5), ("own.env", 0)):
        (together / "linked.env").unlink(missing_ok=True)
        (together / "linked.env").symlink_to(target)
        assert run(["import", "compose", "base.yml", "-o", "new"]) == code, capsys.readouterr()
    assert CANARY not in Path("new/experiment.edf").read_text()


def test_a_file_is_known_by_what_it_is_and_not_by_how_it_is_called(
    together: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By a link, the name of a file that is included ends in the user's folder, and the file does not."""
    (together / "d" / "e").mkdir(parents=True)
    (together / "d" / "lab").mkdir()
    (together / "l").symlink_to("d/e")
    (together / "d" / "lab" / "mine.yml").write_text(f"{NAMES[0].replace('../lab', '../../../lab')}\n")
    (together / "compose.yml").write_text("services: {b: {image: x}}\ninclude: [l/../lab/mine.yml]\n")
    (together / "lab").symlink_to("d/lab")
    for included in ("l/../lab/mine.yml", "l/../../lab/mine.yml", "d/lab/mine.yml"):
        (together / "compose.yml").write_text(f"services: {{b: {{image: x}}}}\ninclude: [{included}]\n")
        assert run(["import", "compose", "stranger/compose.yml", "lab/mine.yml", "-o", "new"]) == 5
        said = capsys.readouterr()
        assert not Path("new").exists() and CANARY not in said.out + said.err


def test_a_file_names_what_lies_beside_itself(together: Path) -> None:
    """Relative paths begin in the folder of the first one, whichever file they stand in."""
    (together / "map.yaml").write_text("a map")
    (together / "compose.yml").write_text("services: {a: {image: x, volumes: ['./map.yaml:/m:ro']}}\n")
    mine = "env_file: ../lab/vars.env, volumes: ['../lab/notes.txt:/n:ro']"
    Path("lab/mine.yml").write_text(f"services: {{a: {{{mine}}}}}\n")
    files = ["stranger/compose.yml", "lab/mine.yml", "--join", "services.a"]
    assert run(["import", "compose", *files, "-o", "new"]) == 0
    assert Path("new/files/lab/notes.txt").read_text() == CANARY
    assert Path("new/files/stranger/map.yaml").read_text() == "a map"


OWN = (
    "configs: {own: {file: ../lab/notes.txt}}",
    f"configs: {{own: {{content: {CANARY}}}}}",
    "volumes: {own: {driver: local, driver_opts: {type: none, o: bind, device: ../lab/own}}}",
    "volumes: {own: {driver: local, driver_opts: {type: none, o: 'bind,ro', device: ../lab/notes.txt}}}",
)


@pytest.mark.parametrize("said", OWN)
@pytest.mark.parametrize("mode", ["", ":ro"])
def test_a_name_that_the_users_own_file_gives_a_file_gives_it_to_no_service_of_another(
    together: Path, capsys: pytest.CaptureFixture[str], said: str, mode: str
) -> None:
    """It is in his file, where it may be named; which of the services has it is a stranger's word."""
    use = "configs: [own]" if said.startswith("configs") else f"volumes: ['own:/n{mode}']"
    (together / "compose.yml").write_text(f"services: {{a: {{image: x, {use}}}}}\n")
    mine = Path("lab/mine.yml")
    mine.write_text(f"services: {{own: {{image: x, {use}}}}}\n{said}\n")
    for files in (["stranger/compose.yml", "lab/mine.yml"], ["lab/mine.yml", "stranger/compose.yml"]):
        text = mine.read_text()
        if files[0] != "stranger/compose.yml":
            mine.write_text(text.replace("../lab/", "./"))
        assert run(["import", "compose", *files, "-o", "new"]) == 5
        told = capsys.readouterr()
        assert "stranger/compose.yml:1" in told.out + told.err and "another file" in told.out + told.err
        assert not Path("new").exists()
        mine.write_text(text)
    # whose file it is may give it to that service, and whoever calls the whole project his
    assert run(["import", "compose", "stranger/compose.yml", "lab/mine.yml", "--root", ".", "-o", "whole"]) == 0
    files = ["stranger/compose.yml", "lab/mine.yml", "--join", f"{said.partition(':')[0]}.own"]
    assert run(["import", "compose", *files, "-o", "joined"]) == 0, capsys.readouterr()
    mine.write_text(f"services: {{own: {{image: x, {use}}}, a: {{{use}}}}}\n{said}\n")
    files = ["stranger/compose.yml", "lab/mine.yml", "--join", "services.a"]
    assert run(["import", "compose", *files, "-o", "new"]) == 0, capsys.readouterr()


def test_a_service_and_a_volume_of_several_files_are_told(together: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What a stranger's says runs in the user's own service has that one's files and secrets."""
    used = "services: {a: {image: x, volumes: ['data:/d']}, own: {entrypoint: [sh, -c, ls]}}"
    (together / "compose.yml").write_text(f"{used}\n")
    Path("lab/mine.yml").write_text("services: {own: {image: x, volumes: ['data:/d']}}\nvolumes: {data: {}}\n")
    files = ["stranger/compose.yml", "lab/mine.yml"]
    assert run(["import", "compose", *files, "-o", "new"]) == 5
    told = capsys.readouterr().out
    assert "'own' is of lab/mine.yml:1 (image, volumes) and stranger/compose.yml:1 (entrypoint)" in told
    joined = ["--join", "services.own", "--join", "volumes.data"]
    assert all(" ".join(joined[at : at + 2]) in told for at in (0, 2)) and not Path("new").exists()
    assert run(["import", "compose", *files, *joined, "-o", "new"]) == 0
    told = capsys.readouterr()
    for what in ("the service 'own'", "the volume 'data'"):
        line = next(one for one in (told.out + told.err).splitlines() if f"{what} has parts" in one)
        assert all(one in line for one in files)
    assert "the service 'a'" not in told.out + told.err
    assert run(["import", "compose", *files, "--root", ".", "-o", "whole"]) == 0
    assert "has parts" not in capsys.readouterr().out


@pytest.mark.parametrize("form", ["text", "markdown", "json", "sarif"])
def test_a_note_and_what_to_look_at_is_in_every_form(
    together: Path, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    (together / "compose.yml").write_text("services: {own: {entrypoint: [sh, -c, ls]}}\n")
    Path("lab/mine.yml").write_text("services: {own: {image: x}}\n")
    files = ["lab/mine.yml", "stranger/compose.yml", "--join", "services.own"]
    assert run(["import", "compose", *files, "-o", "new", "--format", form]) == 0
    for told in (capsys.readouterr().out, Path("new/import-report.md").read_text()):
        assert "the service 'own' has parts" in told and "where one of them is a stranger's, look at what" in told


ASKING = ("{A: '${A}'}", "{A: '${A:-none}'}", "{A: '${A:+some}'}", "[A]", "{A: }")


@pytest.mark.parametrize("environment", ASKING)
def test_what_stands_beside_the_users_own_file_is_worth_nothing_to_another_one(
    together: Path, capsys: pytest.CaptureFixture[str], environment: str
) -> None:
    """Nobody names `.env`: it is read for the first file, and a stranger's that is laid over it asks for a password."""
    Path("lab/.env").write_text(f"A={CANARY}\n")
    (together / "compose.yml").write_text(f"services: {{b: {{image: x, environment: {environment}}}}}\n")
    for files in (["lab/base.yml", "stranger/compose.yml"], ["lab/base.yml", "lab/../stranger/compose.yml"]):
        assert run(["import", "compose", *files, "-o", "new"]) == 5
        said = capsys.readouterr()
        assert not Path("new").exists() and CANARY not in said.out + said.err
        assert "stranger/compose.yml:1" in said.err and "is of lab/.env, beside which this file does not" in said.err
    (together / "compose.yml").write_text("services: {b: {image: x, env_file: ../stranger/b.env}}\n")
    (together / "b.env").write_text("B=${A}\nA\n")
    assert run(["import", "compose", "lab/base.yml", "stranger/compose.yml", "-o", "new"]) == 5
    assert CANARY not in capsys.readouterr().err and not Path("new").exists()


def test_what_stands_beside_a_strangers_file_says_nothing_of_what_the_user_names(
    together: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """His own file, laid over it, ships one of his folders; the stranger's `.env` says that it is all of them."""
    (together / "compose.yml").write_text("services: {a: {image: '${IMAGE}'}}\n")
    (together / ".env").write_text("IMAGE=x\nMAPS=../lab\n")
    Path("lab/maps").mkdir()
    Path("lab/maps/hall").write_text("a map")
    Path("lab/mine.yml").write_text("services: {a: {volumes: ['${MAPS:-../lab/maps}:/m:ro']}}\n")
    files = ["stranger/compose.yml", "lab/mine.yml"]
    files += ["--join", "services.a"]
    assert run(["import", "compose", *files, "-o", "new"]) == 5
    said = capsys.readouterr().err
    assert "lab/mine.yml:1" in said and "--env-file stranger/.env" in said and not Path("new").exists()
    assert run(["import", "compose", *files, "--set", "MAPS=../lab/maps", "-o", "new"]) == 0, capsys.readouterr().err
    assert Path("new/files/lab/maps/hall").exists() and not Path("new/files/lab/notes.txt").exists()


def test_a_file_of_variables_that_is_named_is_for_all_files(together: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`.env`, which nobody names, is for the files of its own folder."""
    Path("lab/.env").write_text("A=1\n")
    Path("lab/base.yml").write_text("services: {a: {image: 'x:${A}'}}\ninclude: [own/more.yml]\n")
    Path("lab/own/more.yml").write_text("services: {c: {image: 'x:${A}'}}\n")
    (together / "compose.yml").write_text("services: {b: {image: 'x:${A}'}}\n")
    assert run(["import", "compose", "lab/base.yml", "-o", "one"]) == 5
    assert "lab/own/more.yml:1" in capsys.readouterr().err
    assert run(["import", "compose", "lab/base.yml", "--root", "lab", "-o", "one"]) == 0, capsys.readouterr().err
    files = ["lab/base.yml", "stranger/compose.yml"]
    assert run(["import", "compose", *files, "--env-file", "lab/.env", "-o", "two"]) == 0, capsys.readouterr().err
    assert Path("two/experiment.edf").read_text().count("x:1") == 3


@pytest.mark.parametrize("text", NAMES)
def test_a_file_that_is_included_names_nothing_further_up(
    together: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    """The user's own file includes a stranger's, as a submodule has it: that is no word on what lies beside his own."""
    (together / "compose.yml").write_text(f"{text}\n")
    (together / "more.yml").write_text("services: {a: {image: '${A:-x}'}}\n")
    Path("mine.yml").write_text("services: {own: {image: x}}\ninclude: [stranger/compose.yml]\n")
    refused_as_outside(["mine.yml"], capsys)


@pytest.mark.parametrize("text", [NAMES[0], NAMES[1], NAMES[3], NAMES[6], NAMES[8]])
def test_a_service_that_is_extended_has_nothing_from_further_up(
    together: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (together / "compose.yml").write_text(f"{text}\n")
    Path("mine.yml").write_text("services: {own: {extends: {file: stranger/compose.yml, service: a}}}\n")
    refused_as_outside(["mine.yml"], capsys)


def test_who_includes_a_file_says_where_its_project_is(together: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Then it may name what lies there, and no file that is included may say so of itself."""
    (together / "compose.yml").write_text("services: {a: {image: x, volumes: ['./lab/own:/n:ro']}}\n")
    Path("mine.yml").write_text("include: [{path: stranger/compose.yml, project_directory: .}]\n")
    assert run(["import", "compose", "mine.yml", "-o", "new"]) == 0, capsys.readouterr().err
    assert Path("new/files/lab/own/file").read_text() == CANARY
    (together / "on.yml").write_text("include: [{path: compose.yml, project_directory: ..}]\n")
    Path("mine.yml").write_text("include: [stranger/on.yml]\n")
    assert run(["import", "compose", "mine.yml", "-o", "other"]) == 5
    assert "'..' lies outside" in capsys.readouterr().err


def test_no_second_name_of_a_file_of_the_users_is_in_what_an_included_file_mounts(
    together: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (together / "maps").mkdir()
    (together / "maps" / "floor").hardlink_to("lab/notes.txt")
    (together / "compose.yml").write_text("services: {a: {image: x, volumes: ['./maps:/m:ro']}}\n")
    Path("mine.yml").write_text("services: {own: {image: x}}\ninclude: [stranger/compose.yml]\n")
    assert run(["import", "compose", "mine.yml", "-o", "new"]) != 0
    assert "hard link" in capsys.readouterr().err and not Path("new").exists()


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
def test_a_folder_with_none_of_the_files_is_no_whole_project(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["import", "compose", "docker/compose.yml", "--root", "src", "-o", "new"]) == 5
    assert "none of the files lies in it" in capsys.readouterr().err and not Path("new").exists()


def test_what_is_included_may_be_the_whole_project(ros_project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Then that has nothing of the user's own file, and its variables by `--env-file` alone."""
    Path("docker/compose.yml").write_text("services: {nav: {image: 'x:${TAG}', volumes: ['../src:/s:ro']}}\n")
    own = ros_project.parent
    (own / ".env").write_text("TAG=8\n")
    (own / "mine.yml").write_text("include: [nav/docker/compose.yml]\n")
    words = ["import", "compose", str(own / "mine.yml"), "--root", ".", "-o"]
    assert run([*words, "new"]) == 5
    assert "TAG is of" in capsys.readouterr().err
    words[-1:] = ["--env-file", str(own / ".env"), "-o"]
    assert run([*words, "new"]) == 0, capsys.readouterr().err
    assert list(Path("new/files").rglob("node.py"))
    assert "x:8" in Path("new/experiment.edf").read_text()
    (own / "private.txt").write_text(CANARY)
    Path("docker/compose.yml").write_text("services: {nav: {image: x, volumes: ['../../private.txt:/p:ro']}}\n")
    assert run([*words, "other"]) == 5
    assert "lies outside" in capsys.readouterr().out and not Path("other").exists()


@pytest.mark.usefixtures("ros_project")
def test_both_names_of_a_file_may_be_in_a_whole_project(capsys: pytest.CaptureFixture[str]) -> None:
    Path("docker/conf/init.sql").hardlink_to("db/init.sql")
    Path("docker/compose.yml").write_text("services: {a: {image: x, volumes: ['./conf:/c:ro']}}\n")
    assert run(["import", "compose", "docker/compose.yml", "-o", "new"]) == 5
    assert "hard link" in capsys.readouterr().err
    assert run(["import", "compose", "docker/compose.yml", "--root", ".", "-o", "new"]) == 0, capsys.readouterr().err
    assert list(Path("new/files").rglob("init.sql"))
