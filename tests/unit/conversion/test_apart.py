"""What Compose files in folders apart have together, key by key: one of them may be a stranger's."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml

from srprov.cli.main import run
from srprov.conversion import table

CANARY = "nobodys-business"
OWN = "services: {own: {image: x, user: '1', configs: [c], secrets: [s], volumes: ['data:/v', 'bound:/b:ro']}}\n"
THINGS = (
    f"configs: {{c: {{content: {CANARY}}}}}\n"
    "secrets: {s: {file: ./token}}\n"
    "volumes: {data: {}, bound: {driver: local, driver_opts: {type: none, o: bind, device: ./maps}}}\n"
)
KEYS = sorted({one.split(".")[2] for one in table.TABLE if one.startswith("services.*.")})


@pytest.fixture(params=["beside", "below"])
def theirs(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the folder of a stranger's file: beside that of the user's own, `lab`, or a clone in it."""
    monkeypatch.chdir(tmp_path)
    folder = "stranger" if request.param == "beside" else "lab/vendor"
    for place in ("lab/maps", folder):
        Path(place).mkdir(parents=True)
    Path("lab/token").write_text(CANARY)
    Path("lab/maps/hall").write_text(CANARY)
    Path("lab/mine.yml").write_text(OWN + THINGS)
    return folder


def importing(theirs: str, text: str, *words: str, first: bool = False) -> int:
    """Import a stranger's file with the user's own."""
    Path(theirs, "compose.yml").write_text(f"{text}\n")
    mine, away = Path("lab/mine.yml"), os.path.relpath("lab", theirs if first else "lab")
    mine.write_text(mine.read_text().replace(" ./", f" {away}/").replace("'./", f"'{away}/"))
    files = ["lab/mine.yml", f"{theirs}/compose.yml"]
    return run(["import", "compose", *(files[::-1] if first else files), *words, "-o", "new"])


def refused(said: pytest.CaptureResult[str], key: str) -> None:
    """Look that nothing was written, and that the way to say so is told."""
    assert f"--join {key}\n" in said.out and not Path("new").exists(), said


def test_every_key_of_a_service_is_looked_at() -> None:
    assert {"command", "entrypoint", "image", "build", "volumes", "environment", "secrets", "user"} <= {*KEYS}


@pytest.mark.parametrize("key", [one for one in KEYS if one != "extends"])
def test_no_key_of_the_users_own_service_is_taken_away(
    theirs: str, capsys: pytest.CaptureFixture[str], key: str
) -> None:
    """What is taken away leaves no place in what the files are together."""
    assert importing(theirs, f"services: {{own: {{{key}: !reset null}}}}") == 5
    if key != "image":  # without one, Compose refuses it
        said = capsys.readouterr()
        refused(said, "services.own")
        assert f"{theirs}/compose.yml:1 ({key})" in said.out


VALUES = (
    "command: [sh]", "entrypoint: [sh]", "image: y", "environment: {LD_PRELOAD: /v/x.so}", "volumes: ['data:/w']",
    "working_dir: /v", "healthcheck: {test: [CMD, sh]}", "labels: {l: x}", "user: root", "privileged: true",
    "network_mode: host", "profiles: [off]", "configs: [c]", "secrets: [s]", "cap_add: [ALL]", "devices: [/dev/x]",
    "build: {dockerfile_inline: FROM y}", "ports: ['1:1']", "extra_hosts: [h=1.2.3.4]", "hostname: h", "scale: 2",
    "volumes: !override []", "environment: !override {A: b}", "deploy: {replicas: 2}",
)  # fmt: skip


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("value", VALUES)
def test_nothing_is_put_into_the_users_own_service(
    theirs: str, capsys: pytest.CaptureFixture[str], value: str, first: bool
) -> None:
    """It would have what that one is given: a program that runs there reads it, an image as well."""
    assert importing(theirs, f"services: {{own: {{{value}}}}}", first=first) == 5
    said = capsys.readouterr()
    if "device" not in said.err:
        refused(said, "services.own")


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("configs.c", "configs: {c: {content: theirs}}"),
        ("configs.c", "configs: {c: {content: theirs}}"),
        ("configs.c", "configs: {c: {name: x}}"),
        ("secrets.s", "secrets: {s: {file: ./theirs}}"),
        ("secrets.s", "secrets: {s: {name: x}}"),
        ("volumes.bound", "volumes: {bound: {driver_opts: {type: none, o: bind, device: ./theirs}}}"),
        ("volumes.data", "volumes: {data: {driver_opts: {type: none, o: bind, device: /}}}"),
        ("volumes.data", "volumes: {data: }"),
    ],
)
def test_nothing_of_the_users_is_said_otherwise(
    theirs: str, capsys: pytest.CaptureFixture[str], key: str, text: str, first: bool
) -> None:
    """The user's own service would run, or read, what the stranger put in its place."""
    assert importing(theirs, f"services: {{t: {{image: x}}}}\n{text}", first=first) == 5
    refused(capsys.readouterr(), key)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("services.own", "services: !override {t: {image: x}, own: {image: x}}"),
        ("services.own", "services: !override {t: {image: x}}"),
        ("services.own", "services: {t: {image: x}, own: !reset null}"),
        ("services.own", "services: {t: {image: x}, <<: {own: !reset null}}"),
        ("configs.c", "services: {t: {image: x}}\nconfigs: !override {c: {content: theirs}}"),
        ("volumes.data", "services: {t: {image: x}}\nvolumes: !override {data: {}, bound: {}}"),
    ],
)
def test_no_kind_of_things_is_taken_away_at_once(
    theirs: str, capsys: pytest.CaptureFixture[str], key: str, text: str
) -> None:
    assert importing(theirs, text) == 5
    refused(capsys.readouterr(), key)


USES = (
    ("configs.c", "configs: [c]"), ("configs.c", "configs: [{source: c, target: /x}]"),
    ("secrets.s", "secrets: [s]"), ("secrets.s", "secrets: [{source: s, target: x}]"),
    ("volumes.data", "volumes: ['data:/x']"), ("volumes.data", "volumes: [{type: volume, source: data, target: /x}]"),
    ("volumes.bound", "volumes: ['bound:/x']"), ("volumes.bound", "volumes: ['bound:/x:ro']"),
)  # fmt: skip


@pytest.mark.parametrize("how", ["first", "last", "included", "extended"])
@pytest.mark.parametrize(("key", "use"), USES)
def test_no_service_of_another_file_has_what_the_users_own_names(
    theirs: str, capsys: pytest.CaptureFixture[str], key: str, use: str, how: str
) -> None:
    """A name is easily guessed, or asked for; the value of a secret, too, is its user's to give."""
    text = f"services: {{t: {{image: x, {use}}}}}"
    if how in ("first", "last"):
        assert importing(theirs, text, first=how == "first") == 5
        refused(capsys.readouterr(), key)
        assert importing(theirs, text, "--join", key, first=how == "first") == 0, capsys.readouterr()
    elif theirs != "stranger":
        Path(theirs, "compose.yml").write_text(f"{text}\n")
        by = "include: [vendor/compose.yml]\n"
        if how == "extended":
            by = "services: {t: {extends: {file: vendor/compose.yml, service: t}}}\n"
        services = OWN if how == "included" else OWN.replace("services: {", by.rstrip("}\n") + "}}, ")
        Path("lab/mine.yml").write_text(services + THINGS + (by if how == "included" else ""))
        assert run(["import", "compose", "lab/mine.yml", "-o", "new"]) == 5
        refused(capsys.readouterr(), key)
        assert run(["import", "compose", "lab/mine.yml", "--join", key, "-o", "new"]) == 0, capsys.readouterr()


def test_what_a_file_extends_and_includes_is_its_own_word(theirs: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Who extends a service says which; no one need be asked again."""
    if theirs == "stranger":
        return
    Path(theirs, "compose.yml").write_text("services: {t: {image: x, entrypoint: [sh]}}\n")
    Path("lab/mine.yml").write_text(
        "services: {own: {extends: {file: vendor/compose.yml, service: t}, secrets: [s]}}\n"
        f"include: [vendor/compose.yml]\n{THINGS}"
    )
    assert run(["import", "compose", "lab/mine.yml", "-o", "new"]) == 0
    assert "the service 'own' has parts" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["variable", "link", "hard link"])
def test_what_is_included_has_nothing_of_the_users_variables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    """Its own `.env` may be a link to any file of the user's that reads like one."""
    monkeypatch.chdir(tmp_path)
    Path("vendor").mkdir()
    Path("vendor/compose.yml").write_text("services: {t: {image: x, environment: {X: '${DB_PASSWORD}'}}}\n")
    Path("mine.yml").write_text("services: {own: {image: x}}\ninclude: [vendor/compose.yml]\n")
    Path("private.env" if kind != "variable" else ".env").write_text(f"DB_PASSWORD={CANARY}\n")
    if kind == "link":
        Path("vendor/.env").symlink_to("../private.env")
    elif kind == "hard link":
        os.link("private.env", "vendor/.env")
    assert run(["import", "compose", "mine.yml", "-o", "new"]) == 5
    said = capsys.readouterr()
    assert CANARY not in said.out + said.err and not Path("new").exists()
    if kind == "variable":  # whoever includes it gives them
        Path("mine.yml").write_text("include: [{path: vendor/compose.yml, env_file: .env}]\n")
        assert run(["import", "compose", "mine.yml", "-o", "new"]) == 0, capsys.readouterr()
        assert CANARY in Path("new/experiment.edf").read_text()


@pytest.mark.parametrize(
    "use", ["volumes: ['./vendor/conf:/c:ro']", "volumes: ['./vendor/conf:/c']", "build: vendor/conf"]
)
def test_no_link_in_an_included_project_leads_out_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], use: str
) -> None:
    """The user's own file names what lies there; where a link there leads is the stranger's word."""
    monkeypatch.chdir(tmp_path)
    for place in ("private", "vendor/real"):
        Path(place).mkdir(parents=True)
        Path(place, "Dockerfile").write_text("FROM x\n")
    Path("vendor/compose.yml").write_text("services: {t: {image: x}}\n")
    Path("mine.yml").write_text(f"services: {{own: {{image: x, {use}}}}}\ninclude: [vendor/compose.yml]\n")
    Path("vendor/conf").symlink_to("../private")
    assert run(["import", "compose", "mine.yml", "-o", "new"]) == 5
    assert "lies outside" in capsys.readouterr().out and not Path("new").exists()
    Path("vendor/conf").unlink()
    Path("vendor/conf").symlink_to("real")
    assert run(["import", "compose", "mine.yml", "-o", "new"]) == 0, capsys.readouterr()


@pytest.mark.parametrize("named", ["lab/maps/hall", "lab/maps", "lab", "/", "a second name"])
def test_no_file_is_left_out_as_a_secrets_by_the_word_of_a_file_apart(
    theirs: str, capsys: pytest.CaptureFixture[str], named: str
) -> None:
    """The user's own service began without the rules that lay there, and no report said so."""
    if named.startswith("a "):
        named = f"{theirs}/floor"
        os.link("lab/maps/hall", named)
    Path("lab/mine.yml").write_text("services: {own: {image: x, volumes: ['./maps:/m:ro']}}\n")
    secrets = f"secrets: {{x: {{file: {os.path.abspath(named)}}}}}"
    for first in (False, True):
        assert importing(theirs, f"services: {{t: {{image: x}}}}\n{secrets}", first=first) != 0
        assert "calls it a secret's" in capsys.readouterr().err and not Path("new").exists()
    if "floor" not in named:
        mine = "services: {own: {image: x, volumes: ['./maps:/m:ro']}}\nsecrets: {y: {file: ./maps/hall}}\n"
        Path("lab/mine.yml").write_text(mine)
        assert importing(theirs, "services: {t: {image: x}}") == 0
        assert not [*Path("new").rglob("hall")]


TAKEN = (
    "services: {t: {image: y, hostname: licence.lab}}",
    "services: {t: {image: y, networks: {default: {aliases: [licence.lab]}}}}",
    "services: {t: {image: y, container_name: licence.lab}}",
    "services: {t: {image: y}, u: {image: y, links: ['t:licence.lab']}}",
    "services: {t: {image: y, hostname: Licence.Lab}}",
    "services: {licence.lab: {image: y}}",
)


@pytest.mark.parametrize("text", TAKEN)
@pytest.mark.parametrize("own", ["extra_hosts: [licence.lab=10.0.0.9]", "environment: {L: 'http://licence.lab/'}"])
def test_no_service_takes_the_name_of_a_host_that_the_users_own_asks(
    theirs: str, capsys: pytest.CaptureFixture[str], text: str, own: str
) -> None:
    """What it sends to a host elsewhere went to the stranger's container; `extra_hosts` were left out for it."""
    Path("lab/mine.yml").write_text(f"services: {{own: {{image: x, {own}}}}}\n")
    for first in (True, False):
        code, said = importing(theirs, text, first=first), capsys.readouterr()
        entry = Path("new/experiment.edf").read_text() if code == 0 else ""
        assert (
            code == 5 or "licence.lab=10.0.0.9" in entry or "licence.lab" not in entry.lower().replace("//licence", "")
        )
        if code == 5:
            assert "--join services." in said.out
        else:
            Path("new").rename(f"kept-{first}")


@pytest.mark.parametrize("text", [TAKEN[0], TAKEN[4]])
def test_no_service_takes_such_a_name_that_stands_in_a_file_alone(
    theirs: str, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    Path("lab/app.conf").write_text("server = http://licence.lab/\n")
    Path("lab/mine.yml").write_text("services: {own: {image: x, volumes: ['./app.conf:/app.conf:ro']}}\n")
    assert importing(theirs, text, first=False) == 5
    refused(capsys.readouterr(), "services.t")
    assert importing(theirs, text, "--join", "services.t", first=False) == 0


@pytest.mark.parametrize(
    ("own", "text"),
    [
        ("environment: {L: 'http://licence.lab/'}", "services: {t: {image: y, hostname: licence.lab}}"),
        ("extra_hosts: [vault=192.0.2.5]", "services: {vault: {image: y}}"),
    ],
)
def test_no_service_of_another_robots_file_takes_such_a_name(
    theirs: str, capsys: pytest.CaptureFixture[str], own: str, text: str
) -> None:
    """The overlay is that of all robots."""
    Path("lab/mine.yml").write_text(f"services: {{own: {{image: x, {own}}}}}\n")
    Path("map").write_text(f"lab/mine.yml: r1\n{theirs}/compose.yml: r2\n")
    key = "r2:services.vault" if "vault" in text else "r2:services.t"
    assert importing(theirs, text, "--robot-map", "map") == 5
    refused(capsys.readouterr(), key)
    assert importing(theirs, text, "--robot-map", "map", "--join", key) == 0, capsys.readouterr()


def test_files_of_one_folder_ask_each_other_and_of_several_not_even_exports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    asks, asked = "services: {own: {image: x, extra_hosts: ['t=10.0.0.9']}}\n", "services: {t: {image: y}}\n"
    exported = "x-srprov: {discovery: ros1, discovery_servers: [t], told: {}}\n"
    for number, (folders, more) in enumerate([(("lab", "lab"), ""), (("one", "two"), exported), (("one", "two"), "")]):
        files = [f"{folder}/{name}.yml" for folder, name in zip(folders, "ab", strict=True)]
        for file, text in zip(files, (asks, asked), strict=True):
            Path(file).parent.mkdir(exist_ok=True)
            Path(file).write_text(f"{text}{more}")
        Path("map").write_text("".join(f"{file}: r{at}\n" for at, file in enumerate(files)))
        code = run(["import", "compose", *files, "--robot-map", "map", "-o", f"new{number}"])
        assert code == (5 if number else 0), capsys.readouterr()


CALLED = [
    ("services: {db: {image: x}}", "services: {DB: {image: y}}", ""),
    ("services: {db: {image: x}}", "services: {t: {image: y, hostname: db}}", ""),
    ("services: {db: {image: x}}", "services: {t: {image: y, container_name: Db}}", ""),
    ("services: {db: {image: x}}", "services: {t: {image: y, networks: {default: {aliases: [db]}}}}", ""),
    ("services: {db: {image: x}}", "services: {t: {image: y}, u: {image: y, links: ['t:db']}}", ""),
    ("services: {db: {image: x, hostname: vault}}", "services: {vault: {image: y}}", ""),
    ("services: {db: {image: x, container_name: vault}}", "services: {vault: {image: y}}", ""),
    (
        "services: {a: {image: x}, db: {image: x, networks: {default: {aliases: [vault]}}}}",
        "services: {vault: {image: y}}",
        "",
    ),
    (
        "services: {a: {image: x, extra_hosts: [v.lab=10.9.9.9]}}",
        "services: {t: {image: y, hostname: v.lab, scale: 2}}",
        "",
    ),
    (
        "services: {a: {image: x, extra_hosts: [v.lab=10.9.9.9]}}",
        "services: {t: {image: y, hostname: v.lab, network_mode: host}}",
        "",
    ),
    ("services: {db: {image: x}}", "services: {db: {image: y}}", "map"),
    ("services: {db: {image: x}}", "services: {t: {image: y, hostname: db}}", "map"),
]


@pytest.mark.parametrize(("mine", "text", "how"), CALLED)
def test_no_service_has_a_name_of_one_of_a_file_apart(
    theirs: str, capsys: pytest.CaptureFixture[str], mine: str, text: str, how: str
) -> None:
    """Who asks by it may do so in a file that nobody reads: then the stranger's container was told the password."""
    Path("lab/mine.yml").write_text(f"{mine}\n")
    Path("map").write_text(f"lab/mine.yml: r1\n{theirs}/compose.yml: r2\n")
    words = ["--robot-map", "map"] if how else []
    for first in (True, False):
        assert importing(theirs, text, *words, first=first) == 5
        assert "which is apart" in capsys.readouterr().out and not Path("new").exists()
    both = (
        f"services.{next(iter(yaml.safe_load(mine)['services']))}",
        *(f"services.{one}" for one in yaml.safe_load(text)["services"]),
    )
    robots = ("r1:", "r2:") if how else ("",)
    keys = [f"{robot}{one}" for robot in robots for one in dict.fromkeys((*both, "services.db"))]
    joins = [word for one in keys for word in ("--join", one)]
    importing(theirs, text, *words, *joins)
    assert "which is apart" not in capsys.readouterr().out


def test_a_service_of_two_files_is_refused_once(theirs: str, capsys: pytest.CaptureFixture[str]) -> None:
    """It was said, too, that it has its own name."""
    Path("lab/mine.yml").write_text("services: {own: {image: x}}\n")
    assert importing(theirs, "services: {own: {init: true}}") == 5
    said = capsys.readouterr().out
    assert "the service 'own' is of " in said and "0 dropped, 1 refused" in said


@pytest.mark.parametrize("joined", ["a", "b"])
def test_a_service_that_is_joined_lets_no_other_of_its_file_be_asked_elsewhere(
    theirs: str, capsys: pytest.CaptureFixture[str], joined: str
) -> None:
    """Of several services of a file only the first was looked at."""
    asks = "{image: x, extra_hosts: [vault=10.9.9.9]}"
    Path("lab/mine.yml").write_text(f"services: {{a: {asks}, b: {asks}}}\n")
    text = "services: {vault: {image: y}}"
    assert importing(theirs, text, "--join", f"services.{joined}") == 5
    refused(capsys.readouterr(), "services.vault")
    assert importing(theirs, text, "--join", "services.vault") == 0, capsys.readouterr()


@pytest.mark.parametrize(
    ("camera", "mine", "key"),
    [
        ("image: y", "hostname: vault", "vault"),
        ("image: y", "networks: {default: {aliases: [eye, vault]}}", "vault"),
        ("hostname: web", "image: x", "web"),
        ("hostname: eye", "image: x, extra_hosts: [vault=10.9.9.9]", "vault"),
    ],
)
def test_what_files_say_of_a_service_that_is_joined_lets_no_other_one_have_its_names(
    theirs: str, capsys: pytest.CaptureFixture[str], camera: str, mine: str, key: str
) -> None:
    """A service of the stranger's file that came later was asked in the place of the user's own."""
    Path("lab/mine.yml").write_text(f"services: {{camera: {{{mine}}}, web: {{image: x}}}}\n")
    text = f"services: {{camera: {{{camera}}}, vault: {{image: y}}}}"
    assert importing(theirs, text, "--join", "services.camera") == 5
    refused(capsys.readouterr(), f"services.{key}")
    assert importing(theirs, text, "--join", "services.camera", "--join", f"services.{key}") == 0


@pytest.mark.parametrize("says", ["hostname: NAME", "container_name: NAME", "networks: {default: {aliases: [NAME]}}"])
@pytest.mark.parametrize(
    ("name", "asks"),
    [("vault.lab", "environment: {L: 'http://vault.lab/'}"), ("db", "image: x"), ("vv", "extra_hosts: [vv=10.9.9.9]")],
)
def test_no_service_that_is_extended_brings_such_a_name(
    theirs: str, capsys: pytest.CaptureFixture[str], says: str, name: str, asks: str
) -> None:
    """It is the word of the file that says it, which the user's own does not open."""
    own = f"{{extends: {{file: {os.path.relpath(theirs, 'lab')}/compose.yml, service: nav}}}}"
    Path("lab/mine.yml").write_text(f"services: {{db: {{image: x, {asks}}}, nav: {own}}}\n".replace("x, image: x", "x"))
    Path(theirs, "compose.yml").write_text(f"services: {{nav: {{image: y, {says.replace('NAME', name)}}}}}\n")
    words = ["import", "compose", "lab/mine.yml", "-o", "new"]
    code = run(words)
    if theirs == "stranger":  # what lies beside is not extended at all
        assert code == 5 and "apart" not in capsys.readouterr().out
        return
    assert code == 5
    refused(capsys.readouterr(), "services.nav")
    assert run([*words, "--join", "services.nav", "--join", "services.db"]) == 0, capsys.readouterr()


@pytest.mark.parametrize("thing", ["services.camera", "configs.c"])
def test_what_is_joined_on_one_robot_is_not_on_another(
    theirs: str, capsys: pytest.CaptureFixture[str], thing: str
) -> None:
    """The user joined two files of his own; a stranger's service of that name, on another robot, was not looked at."""
    Path("drivers").mkdir()
    Path("more").mkdir()
    config = "configs: {c: {content: FROM}}\n" if thing.startswith("configs") else ""
    camera = "{image: x, hostname: vault.lab}" if not config else "{image: x, configs: [c]}"
    Path("lab/mine.yml").write_text("services: {camera: {init: true}}\n" + config)
    Path("drivers/compose.yml").write_text(f"services: {{camera: {camera}}}\n" + config)
    Path("more/pc.yml").write_text("services: {nav: {image: x, environment: {L: 'http://vault.lab'}}}\n" + config)
    Path("map").write_text(f"drivers/compose.yml: r1\nlab/mine.yml: r1\nmore/pc.yml: r2\n{theirs}/compose.yml: r2\n")
    text = f"services: {{t: {camera}}}\n{config}".replace("{t:", "{camera:")
    files = ["drivers/compose.yml", "more/pc.yml", "--robot-map", "map", "--join", "r1:services.camera"]
    assert importing(theirs, text, *files, "--join", f"r1:{thing}") == 5
    refused(capsys.readouterr(), f"r2:{thing}")


def test_what_files_apart_open_to_each_other_is_told(theirs: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Compose kept the user's database, without a password, on a network of its own."""
    Path("lab/mine.yml").write_text(
        "services: {db: {image: x, networks: [back]}}\nnetworks: {back: {internal: true}}\n"
    )
    assert importing(theirs, "services: {t: {image: y}}") == 0
    told = capsys.readouterr().out
    assert "services of files in folders apart reach each other" in told and "import it by itself" in told
    Path("new").rename("apart")
    assert importing(theirs, "services: {t: {image: y}}", "--root", ".") == 0
    assert "in folders apart" not in capsys.readouterr().out


def test_no_export_says_how_services_of_another_file_find_each_other(
    theirs: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """They had the variables of its kind of discovery, and asked the stranger's service for each other."""
    text = "services: {t: {image: x}}\nx-srprov: {discovery: ros1, discovery_servers: [t], told: {t: []}}"
    assert importing(theirs, text) == 5
    refused(capsys.readouterr(), "x-srprov")
    assert importing(theirs, text, "--join", "x-srprov") == 0, capsys.readouterr()


def test_no_network_takes_away_a_host_of_another_file(theirs: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("lab/mine.yml").write_text("services: {own: {image: x, extra_hosts: ['db=10.0.0.9']}}\n")
    text = "services: {t: {image: x, networks: [n]}}\nnetworks: {n: {ipam: {config: [{subnet: 0.0.0.0/0}]}}}"
    assert importing(theirs, text) == 0, capsys.readouterr()
    assert "db=10.0.0.9" in Path("new/experiment.edf").read_text()


@pytest.mark.parametrize("word", ["own", "services.", "networks.n", "services"])
def test_what_is_joined_is_named_by_its_key(theirs: str, capsys: pytest.CaptureFixture[str], word: str) -> None:
    """A service's name alone would join a secret of that name, too."""
    assert importing(theirs, "services: {t: {image: x}}", "--join", word) != 0
    assert f"--join {word}: is the key of nothing" in capsys.readouterr().err


@pytest.mark.parametrize("target", ["{away}/maps/hall", "l/../{away}/maps", "{there}/lab/maps"])
def test_no_link_of_one_file_s_folder_leads_to_what_another_one_has_copied(
    theirs: str, capsys: pytest.CaptureFixture[str], target: str
) -> None:
    """Who copied the experiment, or an export, by scp or zip had the user's file in what the stranger's mounts."""
    away, ctx = os.path.relpath("lab", f"{theirs}/ctx"), Path(theirs, "ctx")
    ctx.mkdir()
    ctx.joinpath("l").symlink_to(".")
    ctx.joinpath("floor").symlink_to(target.format(away=away, there="../" * len(ctx.parts) + "files"))
    Path("lab/mine.yml").write_text("services: {own: {image: x, volumes: ['./maps:/m:ro']}}\n")
    text = "services: {t: {image: x, volumes: ['./%s/ctx:/c:ro']}}"
    for first in (False, True):
        here = "." if first else os.path.relpath(theirs, "lab")
        assert importing(theirs, text % here, first=first) != 0
        assert "leads out of the folder" in capsys.readouterr().err and not Path("new").exists()
    ctx.joinpath("floor").unlink()
    ctx.joinpath("floor").symlink_to("l/../compose.yml")
    assert importing(theirs, text % ".", first=True) == 0, capsys.readouterr()
