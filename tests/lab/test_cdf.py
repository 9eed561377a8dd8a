"""What a CDF can take is in the container that runs: code of a repository that moves, values for ARG, packages."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import log_of

pytestmark = pytest.mark.lab

ROBOT = "robot1"


class Code:
    """A repository on this machine."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self.git("init", "-q", "-b", "main")

    def git(self, *words: str) -> str:
        run = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *words]
        return subprocess.run(run, cwd=self.folder, capture_output=True, check=True, text=True).stdout.strip()

    def commit(self, version: str) -> str:
        (self.folder / "say.sh").write_text(f"#!/bin/sh\necho version {version}\n", encoding="utf-8")
        (self.folder / "say.sh").chmod(0o755)
        (self.folder / "cdfs").mkdir(exist_ok=True)
        (self.folder / "cdfs" / "own.txt").write_text(f"of {version}\n", encoding="utf-8")
        (self.folder / "cdfs" / "b.cdf").write_text(
            "cdf: 1\nbase: busybox\nfiles: [{src: own.txt, dest: /}]\ncommand: [sh, -c, 'cat /own.txt; sleep 86400']\n"
            "stop_signal: SIGKILL\n",
            encoding="utf-8",
        )
        self.git("add", "-A")
        self.git("commit", "-qm", version)
        return self.git("rev-parse", "HEAD")


def _image(lab: Lab, robot: str, container: str) -> str:
    return str(lab.inspect(robot, container)["Config"]["Image"])


def _history(lab: Lab, robot: str, image: str) -> list[str]:
    return lab.shell(robot, "docker", "history", "-q", "--no-trunc", image).out.split()


def test_code_of_a_repository_is_in_the_image_and_a_branch_that_moved_is_seen(lab: Lab, tmp_path: Path) -> None:
    """The robot has no git and no way to the repository. Equal CDFs in two folders have one tag."""
    code = Code(tmp_path / "code")
    first = code.commit("1")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "words").write_text("of the file\n", encoding="utf-8")
        (tmp_path / folder / "say.cdf").write_text(
            f"cdf: 1\nbase: busybox\nrepositories:\n- git: file://{code.folder}\n  ref: main\n  path: /opt/code\n"
            "  run: ./say.sh > built\nfiles: [{src: words, dest: /opt/words}]\nrun: [sleep 0]\n"
            "command: [sh, -c, 'cat /opt/code/built /opt/words; /opt/code/say.sh; ls -a /opt/code; sleep 86400']\n"
            "stop_signal: SIGKILL\n",
            encoding="utf-8",
        )
        services = {"a": {"cdf": "say.cdf"}, "b": {"cdf": {"git": f"file://{code.folder}", "path": "cdfs/b.cdf"}}}
        text = edf("say", services, placement={"slots_per_robot": 2})
        (tmp_path / folder / "say.edf").write_text(text, encoding="utf-8")
    words = (str(tmp_path / "one" / "say.edf"), "-i", inventory, "--allow", "git", "--allow", "outside")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    refused = lab.srprov("apply", words[0], "-i", inventory, "--yes", env=own)
    assert refused.code == 9 and f"a: git (file://{code.folder}, main: fetched here" in refused.err, refused
    assert not (tmp_path / "cache" / "srprov" / "git").exists(), "nothing is fetched before it is allowed"

    done = lab.srprov("apply", *words, "--yes", "--settle", "0", env=own)
    assert done.code == 0 and f"main of file://{code.folder} is commit {first[:12]} now" in done.out, done
    assert log_of(lab, ROBOT, "srprov.say.a") == [
        "version 1",
        "of the file",
        "version 1",
        ".",
        "..",
        "built",
        "cdfs",
        "say.sh",
    ]
    assert log_of(lab, ROBOT, "srprov.say.b") == ["of 1"]
    image = _image(lab, ROBOT, "srprov.say.a")
    again = lab.srprov("plan", *words, "--detailed-exitcode", env=own)
    assert again.code == 0, again
    other = lab.srprov("plan", str(tmp_path / "two" / "say.edf"), *words[1:], "--adopt", "--json", env=own)
    assert {step["module"] for step in other.json["steps"]} == {"file"}, "nothing but the record has another source"

    (tmp_path / "one" / "words").write_text("of the changed file\n", encoding="utf-8")
    assert lab.srprov("apply", *words, "--yes", "--settle", "0", env=own).code == 0
    changed = _image(lab, ROBOT, "srprov.say.a")
    old, new = _history(lab, ROBOT, image), _history(lab, ROBOT, changed)
    later = 6  # copy of the file, run, stop signal, command, label, end of the mark
    assert changed != image and old[later:] == new[later:] and not set(old[:later]) & set(new[:later])

    code.commit("2")
    moved = lab.srprov("apply", *words, "--yes", "--settle", "0", env=own)
    assert moved.code == 0, moved
    assert log_of(lab, ROBOT, "srprov.say.a")[:3] == ["version 2", "of the changed file", "version 2"]
    assert log_of(lab, ROBOT, "srprov.say.b") == ["of 2"]


def test_a_dockerfile_is_built_with_args_up_to_a_stage(lab: Lab, tmp_path: Path) -> None:
    """Also from a plan file, which says nothing of either: both are in the build context."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    (tmp_path / "docker").mkdir()
    (tmp_path / "docker" / "Dockerfile").write_text(
        'FROM busybox AS run\nARG WHO=nobody\nENV WHO="$WHO"\nCOPY greeting /\nFROM run\nRUN false\n', encoding="utf-8"
    )
    (tmp_path / "greeting").write_text("hello", encoding="utf-8")
    args = "{WHO: 'a \"$b\" \\c'}"
    (tmp_path / "t.cdf").write_text(
        f"cdf: 1\ndockerfile: {{context: ., dockerfile: docker/Dockerfile, args: {args}, target: run}}\n",
        encoding="utf-8",
    )
    service = {**busybox("sh", "-c", 'cat greeting; echo " $WHO"; sleep 86400'), "cdf": "t.cdf"}
    del service["image"]
    (tmp_path / "args.edf").write_text(edf("args", {"a": service}), encoding="utf-8")
    plan = str(tmp_path / "plan.json")
    made = lab.srprov("plan", str(tmp_path / "args.edf"), "-i", inventory, "-o", plan)
    assert made.code == 0, made
    done = lab.srprov("apply", plan, "-i", inventory, "--yes", "--settle", "0")
    assert done.code == 0, done
    assert log_of(lab, ROBOT, "srprov.args.a") == ['hello a "$b" \\c']
    labels = lab.inspect(ROBOT, "srprov.args.a")["Config"]["Labels"]
    assert labels["srprov.instance"] == "args"


@pytest.mark.soak
def test_packages_of_every_kind_a_repository_and_files_make_one_image(lab: Lab, tmp_path: Path) -> None:
    """apt, pip and npm from the mirrors of this machine; npm installs Debian's own first."""
    code = Code(tmp_path / "code")
    code.commit("1")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    (tmp_path / "all.cdf").write_text(
        "cdf: 1\nbase: debian:bookworm\n"
        "packages: {apt: [tree], pip: ['idna==3.7'], npm: ['is-odd@3.0.1']}\n"
        f"repositories: [{{git: 'file://{code.folder}', path: /opt/code}}]\n"
        "files: [{src: words, dest: /opt/}]\nstop_signal: SIGKILL\n"
        "command: [sh, -c, 'tree --version | head -c 4; echo; cat /opt/words; /opt/code/say.sh;"
        ' python3 -c "import idna; print(idna.__version__)"; node -p "require(`is-odd`)(3)"; sleep 86400\']\n',
        encoding="utf-8",
    )
    (tmp_path / "words").write_text("words\n", encoding="utf-8")
    (tmp_path / "all.edf").write_text(edf("all", {"a": {"cdf": "all.cdf"}}), encoding="utf-8")
    allowed = ("--allow", "git", "--allow", "outside", "--yes", "--settle", "5")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = lab.srprov("apply", str(tmp_path / "all.edf"), "-i", inventory, *allowed, env=own)
    assert done.code == 0, done
    assert log_of(lab, ROBOT, "srprov.all.a") == ["tree", "words", "version 1", "3.7", "true"]
