"""What a CDF can take is in the container that runs: code of a repository that moves, values for ARG, packages."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
import yaml

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


SAY = """\
cdf: 1
base: busybox
repositories: [{{git: "file://{code}", ref: main, path: /opt/code, run: ./say.sh > built}}]
files: [{{src: words, dest: /opt/words}}, {{src: query, dest: /bin/dpkg-query}}]
run: [sleep 0]
command: [sh, -c, "cat /opt/code/built /opt/words; /opt/code/say.sh; ls -a /opt/code; sleep 86400"]
stop_signal: SIGKILL
"""
QUERY = """\
#!/bin/sh
echo "apt ii  links $(ls /sys/class/net | wc -l)"
echo "apt ii  writes $(touch /x && echo 1)"
echo 'apt ii  x;reboot 1'
"""
ARGS = "cdf: 1\ndockerfile: {context: ., dockerfile: docker/Dockerfile, args: {WHO: 'a \"$b\" \\c'}, target: run}\n"
DOCKERFILE = 'FROM busybox AS run\nARG WHO=nobody\nENV WHO="$WHO"\nCOPY words /\nFROM run\nRUN false\n'


def _experiment(folder: Path, code: Code) -> Path:
    """Write one with a CDF that takes code, a CDF from a repository, and a Dockerfile with values."""
    (folder / "docker").mkdir(parents=True)
    (folder / "words").write_text("of the file\n", encoding="utf-8")
    (folder / "query").write_text(QUERY, encoding="utf-8")
    (folder / "query").chmod(0o755)
    (folder / "say.cdf").write_text(SAY.format(code=code.folder), encoding="utf-8")
    (folder / "args.cdf").write_text(ARGS, encoding="utf-8")
    (folder / "docker" / "Dockerfile").write_text(DOCKERFILE, encoding="utf-8")
    services = {
        "a": {"cdf": "say.cdf"},
        "b": {"cdf": {"git": f"file://{code.folder}", "path": "cdfs/b.cdf"}},
        "c": {**busybox("sh", "-c", 'cat words; echo "$WHO"; sleep 86400'), "cdf": "args.cdf"},
    }
    del services["c"]["image"]
    path = folder / "say.edf"
    path.write_text(edf("say", services, placement={"slots_per_robot": 3}), encoding="utf-8")
    return path


def test_what_cdfs_take_is_in_their_containers_and_a_lock_holds_it(lab: Lab, tmp_path: Path) -> None:
    """The robot has no git and no way to the repository. A last stage that would fail is not built.

    What a build ended with is recorded afterwards: by a container that sees no network and is not there any more.
    """
    code = Code(tmp_path / "code")
    code.commit("1")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    path = _experiment(tmp_path / "one", code)
    words = (str(path), "-i", inventory, "--allow", "git", "--allow", "outside")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    refused = lab.srprov("apply", words[0], "-i", inventory, "--yes", env=own)
    assert refused.code == 9 and f"a: git (file://{code.folder}, main: fetched here" in refused.err, refused
    assert not (tmp_path / "cache" / "srprov" / "git").exists(), "nothing is fetched before it is allowed"

    locked = lab.srprov("lock", *words, env=own)
    assert locked.code == 0 and "+ busybox:latest: sha256:" in locked.out, locked
    code.commit("2")
    done = lab.srprov("apply", *words, "--yes", "--settle", "0", "--locked", env=own)
    assert done.code == 0 and "not pinned" not in done.out, done
    assert log_of(lab, ROBOT, "srprov.say.a") == [
        *("version 1", "of the file", "version 1", ".", "..", "built", "cdfs", "say.sh")
    ]
    assert log_of(lab, ROBOT, "srprov.say.b") == ["of 1"]
    assert log_of(lab, ROBOT, "srprov.say.c") == ["of the file", 'a "$b" \\c']
    assert lab.inspect(ROBOT, "srprov.say.c")["Config"]["Labels"]["srprov.instance"] == "say"
    before = lab.containers(ROBOT)
    recorded = lab.srprov("lock", *words, env=own)
    assert recorded.code == 0 and recorded.out.count(f" on {ROBOT}: ") == 3, recorded
    assert lab.containers(ROBOT) == before
    written = yaml.safe_load((tmp_path / "one" / "say.lock").read_text(encoding="utf-8"))["packages"]
    told = {one["image"]: one.get("apt", []) for one in written}
    assert told.pop(_image(lab, ROBOT, "srprov.say.a")) == ["links=1"] and list(told.values()) == [[], []], written
    again = lab.srprov("plan", *words, "--detailed-exitcode", "--locked", env=own)
    assert again.code == 0, again


@pytest.mark.soak
def test_a_branch_that_moved_is_seen_and_a_changed_file_changes_the_layers_after_it(lab: Lab, tmp_path: Path) -> None:
    """Equal CDFs in two folders have one tag. A plan file has all that it needs."""
    code = Code(tmp_path / "code")
    first = code.commit("1")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    path, twin = _experiment(tmp_path / "one", code), _experiment(tmp_path / "two", code)
    words = ("-i", inventory, "--allow", "git", "--allow", "outside")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    kept = str(tmp_path / "plan.json")
    made = lab.srprov("plan", str(path), *words, "-o", kept, env=own)
    assert made.code == 0 and f"main of file://{code.folder} is commit {first[:12]} now" in made.out, made
    done = lab.srprov("apply", kept, *words, "--yes", "--settle", "0", env=own)
    assert done.code == 0, done
    image = _image(lab, ROBOT, "srprov.say.a")
    other = lab.srprov("plan", str(twin), *words, "--adopt", "--json", env=own)
    assert {step["module"] for step in other.json["steps"]} == {"file"}, "nothing but the record has another source"

    (path.parent / "words").write_text("of the changed file\n", encoding="utf-8")
    assert lab.srprov("apply", str(path), *words, "--yes", "--settle", "0", env=own).code == 0
    changed = _image(lab, ROBOT, "srprov.say.a")
    old, new = _history(lab, ROBOT, image), _history(lab, ROBOT, changed)
    later = 6  # copy of the file, run, stop signal, command, label, end of the mark
    assert changed != image and old[later:] == new[later:] and not set(old[:later]) & set(new[:later])

    code.commit("2")
    moved = lab.srprov("apply", str(path), *words, "--yes", "--settle", "0", env=own)
    assert moved.code == 0, moved
    assert log_of(lab, ROBOT, "srprov.say.a")[:3] == ["version 2", "of the changed file", "version 2"]
    assert log_of(lab, ROBOT, "srprov.say.b") == ["of 2"]


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
        ' python3 -c "import idna; print(idna.__version__)"; node -p "require(process.argv[1])(3)" is-odd;'
        " sleep 86400']\n",
        encoding="utf-8",
    )
    (tmp_path / "words").write_text("words\n", encoding="utf-8")
    (tmp_path / "all.edf").write_text(edf("all", {"a": {"cdf": "all.cdf"}}), encoding="utf-8")
    allowed = ("--allow", "git", "--allow", "outside", "--yes", "--settle", "5")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    lock = ("lock", str(tmp_path / "all.edf"), "-i", inventory, *allowed[:4])
    nothing = lab.srprov(*lock, env=own)
    assert nothing.code == 0 and "the packages in it are not in the lock: no robot has" in nothing.out, nothing
    done = lab.srprov("apply", str(tmp_path / "all.edf"), "-i", inventory, *allowed, env=own)
    assert done.code == 0, done
    assert log_of(lab, ROBOT, "srprov.all.a") == ["tree", "words", "version 1", "3.7", "true"]
    assert lab.srprov(*lock, env=own).code == 0
    (one,) = yaml.safe_load((tmp_path / "all.lock").read_text(encoding="utf-8"))["packages"]
    there = lab.shell(ROBOT, "docker", "exec", "srprov.all.a", "dpkg-query", "-W", "-f", "${Version}", "tree").out
    assert f"tree={there}" in one["apt"] and not any(name.startswith("libc6=") for name in one["apt"])
    assert one["pip"] == ["idna==3.7"] and "is-odd@3.0.1" in one["npm"], one
