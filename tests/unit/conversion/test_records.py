"""What lies in a record of srprov's own, or among an export's secrets, gets into nothing that is imported."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.own_records import KEPT_OUT

CANARY = "hunter2-hunter2"
ONE = "services: {a: {image: x, %s}}\n"
MARKS = {"results/journal.jsonl": "", "results/trials/x": "", "results/token": f"PW={CANARY}\n"}
RUN = {f"results/sessions/1/{name}": f"PW={CANARY}\n" for name in ("events.jsonl", "environment.json", "hardware.json")}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    _write({"out/secrets/.gitignore": KEPT_OUT, "out/secrets/db": f"PW={CANARY}\n", **MARKS, **RUN})
    return tmp_path


def _write(files: dict[str, str]) -> None:
    for name, text in files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)


def _imported() -> str:
    return "".join(one.read_text() for one in Path("exp").rglob("*") if one.is_file())


@pytest.mark.parametrize(
    "text",
    [
        ONE % "volumes: ['./out/secrets/db:/maps/a:ro']",
        ONE % "volumes: ['./out/secrets:/maps']",
        ONE % "volumes: ['./results/sessions:/maps:ro']",
        ONE % "volumes: ['./results/trials:/maps']",
        ONE % "volumes: ['./results/token:/maps/a:ro']",
        ONE % "volumes: ['./results/sessions/1/hardware.json:/maps/a:ro']",
        ONE % "volumes: ['./link:/maps/a:ro']",
        ONE % "volumes: ['v1:/m']" + "volumes: {v1: {driver_opts: {type: none, o: bind, device: ./results/trials}}}\n",
        ONE % "env_file: out/secrets/db",
        ONE % "env_file: [{path: link, format: raw}]",
        ONE % "label_file: out/secrets/db",
        ONE % "configs: [c]" + "configs: {c: {file: ./out/secrets/db}}\n",
        ONE % "build: {dockerfile: out/secrets/db}",
        ONE % "build: results/trials",
        ONE % "extends: {file: out/secrets/db, service: b}",
        "include: [out/secrets/db]\n",
        "include: [{path: d.yml, env_file: results/token}]\n",
    ],
)
def test_nothing_of_one_is_copied_read_or_shown(here: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    """Its marks would stay behind, so nobody would be asked when the experiment is applied."""
    Path("link").symlink_to("out/secrets/db")
    _write({"c.yml": text, "d.yml": ONE % "", "results/trials/Dockerfile": "FROM busybox\n"})
    assert run(["import", "compose", "c.yml", "--root", ".", "-o", "exp"]) != 0
    told = capsys.readouterr()
    assert "srprov's own" in told.out + told.err and "c.yml:" in told.out + told.err
    assert CANARY not in told.out + told.err and not Path("exp").exists()


def test_no_link_has_variables_read_from_one(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path(".env").symlink_to("out/secrets/db")
    Path("c.yml").write_text(ONE % "environment: {MAP: '${PW}'}")
    assert run(["import", "compose", "c.yml", "-o", "exp"]) == 5
    assert CANARY not in capsys.readouterr().err and not Path("exp").exists()
    assert run(["import", "compose", "c.yml", "--env-file", "out/secrets/db", "-o", "exp"]) == 0


@pytest.mark.parametrize("mount", ["./:/ws:ro", "./out:/ws:ro", "./out:/ws"])
@pytest.mark.parametrize("more", ["", "secrets: {t: {file: ./out/secrets/.gitignore}}\n"])
def test_a_folder_that_holds_one_is_copied_without_it(here: Path, mount: str, more: str) -> None:
    """A project can call a mark a secret, which is not copied, and all that is known by it is copied then."""
    _write({"out/map": "a map", "c.yml": ONE % f"volumes: ['{mount}']" + more})
    assert run(["import", "compose", "c.yml", "-o", "exp"]) == 0
    assert CANARY not in _imported() and "a map" in _imported()


def test_no_second_name_of_what_is_in_one_is_imported(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An archive makes one where it is unpacked beside an export: both names lie in the project then."""
    os.link("out/secrets/db", "map")
    for text in (ONE % "volumes: ['./map:/map:ro']", ONE % "env_file: map"):
        Path("c.yml").write_text(text)
        assert run(["import", "compose", "c.yml", "-o", "exp"]) == 5
        assert CANARY not in capsys.readouterr().err and not Path("exp").exists()


def test_a_definition_of_swarmrobs_has_nothing_of_one(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "version: '1'\nservices: {a: {image: x, volumes: ['./out/secrets/db:/map']}}\n"
    Path("s.yml").write_text(text)
    code = run(["import", "swarmrob", "s.yml", "-o", "exp"])
    assert CANARY not in (_imported() if Path("exp").exists() else ""), (code, capsys.readouterr())


def test_a_project_that_lies_in_one_has_its_files(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a bundle that was unpacked, or an export that is kept beside what it was made from."""
    files = {"c.yml": ONE % "env_file: v.env, volumes: ['./maps:/maps:ro', '.:/ws:ro']", "v.env": "A=b\n"}
    _write({f"results/{name}": text for name, text in {**files, "maps/floor": "a map"}.items()})
    monkeypatch.chdir("results")
    assert run(["import", "compose", "c.yml", "-o", "../exp"]) == 0
    assert Path("../exp/files/maps/floor").read_text() == "a map"
