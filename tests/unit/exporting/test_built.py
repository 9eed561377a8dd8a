"""What a builder is given in an export: the very text that permissions were asked for, by the name that it takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.exporting.model import Export
from tests.unit.exporting.clusters import on_cluster
from tests.unit.exporting.exports import classes, contents, document, experiment, notes, twin

TEXT = "services: {a: {cdf: a.cdf}}"
FILES = {
    "a_dot_cdf": "cdf: 1\ndockerfile: {context: ctx, dockerfile: a.dockerfile, args: {V: 2}, target: one}\n",
    "ctx__a_dot_dockerfile": "ARG V=1\nFROM busybox AS one\nFROM one\nADD http://127.0.0.1/x /x\n",
    "ctx__Dockerfile": "# syntax=stranger.example/frontend\nFROM srprov/other:1\nADD http://127.0.0.1/x /x\n",
    "ctx__y": "y",
}


def exported(tool: str, edf: Path) -> Export:
    return twin(edf) if tool == "compose" else on_cluster(tool, edf)


@pytest.mark.parametrize("tool", ["compose", "swarm", "kubernetes"])
def test_nothing_is_built_but_the_dockerfile_that_was_looked_at(tool: str, tmp_path: Path) -> None:
    """`build.sh` built what else was called `Dockerfile`, all stages, by other values: nobody had been asked."""
    made = exported(tool, experiment(tmp_path, TEXT, **FILES))
    found = contents(made)
    assert found["build/a/Dockerfile"] == b'ARG V="2"\nFROM busybox AS one\n'
    assert found["build/a/y"] == b"y"
    orders = [text for path, text in found.items() if path in ("build.sh", "compose.yml")]
    assert not any(word in text for text in orders for word in (b"a.dockerfile", b"one", b"args", b" -f "))
    assert not any("ADD" in note or "srprov/other" in note for note in made.notes)


@pytest.mark.parametrize("tool", ["compose", "swarm", "kubernetes"])
def test_a_link_that_is_called_so_is_left_out(tool: str, tmp_path: Path) -> None:
    edf = experiment(tmp_path, TEXT, **FILES)
    (tmp_path / "ctx" / "Dockerfile").unlink()
    (tmp_path / "ctx" / "Dockerfile").symlink_to("y")
    (one,) = (file for file in exported(tool, edf).files if file.path == "build/a/Dockerfile")
    assert (one.link, one.content[:4]) == (None, b"ARG ")


@pytest.mark.parametrize("tool", ["compose", "swarm", "kubernetes"])
@pytest.mark.parametrize(
    "name", ["Containerfile", "containerfile", "dockerfile", "Dockerfile.dockerignore", "Dockerfile.rego"]
)
def test_nothing_is_exported_that_a_builder_takes_before_that(tool: str, name: str, tmp_path: Path) -> None:
    """podman and podman-compose look for a Containerfile first, and Docker for a file of what it does not send."""
    edf = experiment(tmp_path, TEXT, **FILES)
    (tmp_path / "ctx" / name).write_text(FILES["ctx__Dockerfile"])
    (tmp_path / "ctx" / "below").mkdir()
    (tmp_path / "ctx" / "below" / name).write_text("x")
    made = exported(tool, edf)
    found = contents(made)
    assert f"build/a/{name}" not in found
    assert found[f"build/a/below/{name}"] == b"x"
    told = [note.partition(" is left out: ")[0] for note in made.notes if "nobody looked at it" in note]
    assert told == [f"a: {one}" for one in sorted({"Dockerfile", name})]


def test_a_folder_of_such_a_name_is_what_a_build_copies_from(tmp_path: Path) -> None:
    """`COPY dockerfile/entry.sh /` was in every export that could not be built."""
    files = {"ctx__Dockerfile": "FROM busybox\nCOPY dockerfile/entry.sh /\n", "ctx__y": "y"}
    edf = experiment(tmp_path, "services: {a: {cdf: ctx/Dockerfile}}", **files)
    (tmp_path / "ctx/dockerfile").mkdir()
    (tmp_path / "ctx/dockerfile/entry.sh").write_text("x")
    made = twin(edf)
    assert contents(made)["build/ctx/dockerfile/entry.sh"] == b"x"
    assert not [note for note in made.notes if "left out" in note]


def test_what_a_build_takes_of_the_environment_is_told(tmp_path: Path) -> None:
    """The EDF's own value for the container hid that the image is built with that of whoever runs Compose."""
    text = "services:\n  a: {cdf: a.cdf, environment: {TOKEN: none}}\n  b: {cdf: a.cdf}\n  c: {cdf: c.cdf}\n"
    files = {
        "a_dot_cdf": "cdf: 1\nbase: busybox\nenvironment: [TOKEN]\nrun: echo $TOKEN >/x\n",
        "c_dot_cdf": "cdf: 1\nextends: a.cdf\nenvironment: [OTHER, TOKEN=1]\n",
    }
    made = twin(experiment(tmp_path, text, **files))
    written = document(made)["services"]
    assert [written[name]["build"]["args"] for name in "abc"] == [["TOKEN"], ["TOKEN"], ["OTHER"]]
    told = "{} is taken from the environment of whoever runs Compose, into the image"
    for name, variable in (("a", "TOKEN"), ("b", "TOKEN"), ("c", "OTHER")):
        assert notes(made)[f"services.{name}.environment"] == told.format(variable)
        assert classes(made)[f"services.{name}.environment"] == "adapted"
    assert contents(made)["README.md"].decode().count(", into the image") == 3


def test_the_dockerfile_of_a_cdf_is_not_said_to_be_left_out(tmp_path: Path) -> None:
    """It is in the export as `Dockerfile`, whatever it is called."""
    files = {"ctx__Containerfile": "FROM busybox\nCOPY y /\n", "ctx__y": "y", "ctx__Dockerfile": "FROM other\n"}
    cdf = "cdf: 1\ndockerfile: Containerfile\n"
    edf = experiment(tmp_path, "services: {a: {cdf: ctx/a.cdf}}", **files)
    (tmp_path / "ctx/a.cdf").write_text(cdf)
    made = twin(edf)
    assert contents(made)["build/a/Dockerfile"].startswith(b"FROM busybox")
    assert [note for note in made.notes if "left out" in note] == [
        "a: Dockerfile is left out: a builder would go by it, and nobody looked at it"
    ]
