"""Each value of a normal project knows the file, line and column where it was written, whatever became of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.importing.normal import Normal, Refused
from srprov.importing.read import normalise

MAIN = """\
x-common: &common
  restart: always
  environment: {SHARED: "1"}
services:
  talker:
    <<: *common
    image: ros:${TAG:-humble}
    ports:
      - "80-81:90-91"
      - 7400
    env_file: own.env
    extends: {file: sub/base.yml, service: base}
  listener:
    image: x
    depends_on: [talker]
volumes:
  maps: {}
"""
BASE = """\
services:
  base:
    volumes:
      - ./params:/params:ro
      - maps:/maps
    labels:
      kind: base
"""
OVER = """\
services:
  listener:
    environment:
      LATE: ${WORD}
    ports: !override ["1:1"]
"""


@pytest.fixture
def normal(tmp_path: Path) -> Normal:
    (tmp_path / "sub").mkdir()
    for name, text in (("c.yml", MAIN), ("sub/base.yml", BASE), ("d.yml", OVER), ("own.env", "# c\nOWN=5\nTWO=$OWN\n")):
        (tmp_path / name).write_text(text)
    (tmp_path / ".env").write_text("WORD='w'\n")
    return normalise(
        [tmp_path / "c.yml", tmp_path / "d.yml"], project="p", settings={"UNUSED": "1"}, root=str(tmp_path.resolve())
    )


PLACES = [
    (("services", "talker"), "c.yml:5:3"),
    (("services", "talker", "image"), "c.yml:7:5"),
    (("services", "talker", "restart"), "c.yml:2:3"),
    (("services", "talker", "environment", "SHARED"), "c.yml:3:17"),
    (("services", "talker", "environment", "OWN"), "own.env:2:1"),
    (("services", "talker", "ports", 1), "c.yml:9:9"),
    (("services", "talker", "ports", 1, "target"), "c.yml:9:9"),
    (("services", "talker", "ports", 2), "c.yml:10:9"),
    (("services", "talker", "volumes", 0, "source"), "sub/base.yml:4:9"),
    (("services", "talker", "labels", "kind"), "sub/base.yml:7:7"),
    (("services", "talker", "no such key", 3), "c.yml:5:3"),
    (("services", "listener", "depends_on", "talker", "condition"), "c.yml:15:18"),
    (("services", "listener", "environment", "LATE"), "d.yml:4:7"),
    (("volumes", "maps", "name"), "c.yml:17:3"),
]


@pytest.mark.parametrize(("path", "place"), PLACES, ids=str)
def test_a_value_knows_its_place(normal: Normal, tmp_path: Path, path: tuple[str | int, ...], place: str) -> None:
    assert str(normal.position_of(path)) == f"{tmp_path}/{place}"


def test_every_value_of_the_document_has_a_place(normal: Normal, tmp_path: Path) -> None:
    assert all(str(place).startswith(f"{tmp_path}/") and place.line > 0 for place in normal.positions.values())
    assert ("services", "talker", "networks", "default") in normal.positions


def test_each_variable_is_listed_with_its_source(normal: Normal, tmp_path: Path) -> None:
    found = [(one.name, one.source, one.value, str(one.at)) for one in normal.variables]
    assert found == [
        ("TAG", "default", "humble", f"{tmp_path}/c.yml:7:12"),
        ("WORD", f"{tmp_path}/.env", "w", f"{tmp_path}/d.yml:4:13"),
        ("OWN", f"{tmp_path}/own.env", "5", f"{tmp_path}/own.env:3:1"),
    ]


def notes(folder: Path, text: str) -> list[str]:
    """Return the notes on a file, without the folder."""
    (folder / "c.yml").write_text(text)
    found = normalise([folder / "c.yml"], project="p").warnings
    return [f"{str(one.at).removeprefix(f'{folder}/')}: {one.message}" for one in found]


SAID = [
    ("environment: {A: 010}", "c.yml:1:43: service 'a': A is '8' to Compose, since '010' is a number to it"),
    ("environment: {A: '010', B: 5, C: 1.5, D: true, E: no}", ""),
    (
        "environment: [A]",
        "c.yml:1:40: service 'a': A has no value; Compose would take it from its caller's environment",
    ),
    ("volumes: ['/tmp:/t:r']", "c.yml:1:36: 'r' is no mode of a mount; Compose drops it, and the mount is writable"),
    ("volumes: ['/tmp:/t:ro,z', '/a:/b']", ""),
    (
        "volumes: ['m:/d']",
        "c.yml:1:36: 'm:/d': one letter before a colon is a drive of Windows to Compose, not the volume 'm'",
    ),
]


@pytest.mark.parametrize(
    ("field", "said"),
    SAID,
)
def test_what_one_would_not_guess_is_told(tmp_path: Path, field: str, said: str) -> None:
    assert notes(tmp_path, f"services: {{a: {{image: x, {field}}}}}\n") == ([said] if said else [])


def test_a_file_that_compose_would_read_too_is_told(tmp_path: Path) -> None:
    for name in ("compose.yml", "compose.override.yml", "other.yml"):
        (tmp_path / name).write_text("services: {a: {image: x}}\n")
    one, both, other = (["compose.yml"], ["compose.yml", "compose.override.yml"], ["other.yml"])
    told = [len(normalise([tmp_path / name for name in names]).warnings) for names in (one, both, other)]
    assert told == [1, 0, 0]
    assert "compose.override.yml" in normalise([tmp_path / "compose.yml"]).warnings[0].message


def test_a_version_is_told(tmp_path: Path) -> None:
    assert notes(tmp_path, "version: '3'\nservices: {}\n") == ["c.yml:1:1: `version` means nothing to Compose any more"]


def test_all_variables_without_a_value_are_told_at_once(tmp_path: Path) -> None:
    (tmp_path / "c.yml").write_text("services:\n  a:\n    image: $A\n    labels: ['x=${B}', '${C:?why}']\n")
    with pytest.raises(Refused) as caught:
        normalise([tmp_path / "c.yml"])
    found = [(f"{one.location.line}:{one.location.column}", one.hint) for one in caught.value.problems]
    assert found == [
        ("3:12", "give one: --set A=VALUE"),
        ("4:14", "give one: --set B=VALUE"),
        ("4:24", "give one: --set C=VALUE"),
    ]
