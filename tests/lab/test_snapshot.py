"""Robots that were set up by hand become an experiment, whatever they hold; no secret is told, nothing is changed."""

from __future__ import annotations

import base64
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from srprov import data
from srprov.snapshot.repositories import CLONES
from tests.lab import by_hand
from tests.lab.by_hand import PACKAGE, PASSWORD, TOKEN, WORKSPACE
from tests.lab.conftest import Done, Lab, part_of_lab
from tests.traps import START, TRAPS

pytestmark = pytest.mark.lab

ROBOT = "robot1"


@pytest.fixture
def hand(lab: Lab) -> Iterator[Lab]:
    """Give the lab; afterwards the robot has nothing of what was installed by hand."""
    yield lab
    by_hand.take_down(lab, ROBOT)


def texts(done: Done, folder: Path) -> str:
    """Give all that was printed and written."""
    files = [path.read_bytes().decode("utf-8", "replace") for path in sorted(folder.rglob("*")) if path.is_file()]
    return "\n".join([done.out, done.err, *map(str, sorted(folder.rglob("*"))), *files])


def notes(document: dict[str, object], kind: str) -> list[str]:
    """Give the notes of a kind, as text."""
    found = document["notes"]
    assert isinstance(found, list)
    return [f"{note['subject']}: {note['words']}" for note in found if note["kind"] == kind]


def test_a_robot_that_was_set_up_by_hand_becomes_an_experiment(
    hand: Lab, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Its containers and its host, with what could not be captured; the passwords are in no output."""
    repository = tmp_path / "code"
    commit = by_hand.set_up(hand, ROBOT, repository, tmp_path)
    inventory = part_of_lab(hand, [ROBOT], tmp_path / "lab.yml")
    folder = tmp_path / "taken"
    done = hand.srprov("snapshot", ROBOT, "-i", inventory, "-o", str(folder), "--json")
    assert done.code == 0, done
    assert list(Draft202012Validator(data.schema("snapshot")).iter_errors(done.json)) == []
    everything = texts(done, folder)
    for secret in (PASSWORD, TOKEN):
        assert secret not in everything and base64.b64encode(secret.encode()).decode()[:-4] not in everything
    assert hand.srprov("validate", str(folder / "experiment.edf")).code == 0

    edf = yaml.safe_load((folder / "experiment.edf").read_text(encoding="utf-8"))
    assert set(edf["services"]) == {"camera-front", "db", f"{ROBOT}-host"} and edf["placement"] == {
        "slots_per_robot": 3
    }
    camera, db = edf["services"]["camera-front"], edf["services"]["db"]
    digest = hand.inspect(ROBOT, "db")["Image"]
    assert camera.pop("image").startswith("busybox:latest@sha256:") and digest
    assert camera == {
        "network": "host", "command": ["sh", "-c", "exec sleep 86400"], "environment": ["ROS_DOMAIN_ID=7"],
        "secrets": ["camera-front-db_password"], "cap_add": ["SYS_NICE"], "devices": ["/dev/net/tun:/dev/lidar"],
        "ulimits": {"nofile": {"soft": 1024, "hard": 2048}}, "restart": "unless-stopped", "robot": ROBOT,
        "volumes": [{"type": "bind", "source": "/opt/data", "target": "/data", "read_only": True},
                    {"type": "volume", "source": "maps", "target": "/maps"}],
    }  # fmt: skip
    assert db["environment"] == ["TWO=a\nb"] and db["secrets"] == ["db-token"] and db["cpus"] == 0.5
    assert (db["mem_limit"], db["ports"], db["tmpfs"]) == ("67108864", ["127.0.0.1:5432:80"], ["/tmp:size=8m"])
    assert db["command"][-2:] == ["--password", "***"] and db["labels"] == {"team": "drive"}
    assert (
        db["stop_grace_period"] == "3s"
        and db["healthcheck"]["interval"] == "7s"
        and "***" in db["healthcheck"]["test"][1]
    )
    assert edf["secrets"]["camera-front-db_password"] == {"env": "ROBOT1__CAMERA_FRONT__DB_PASSWORD"}

    cdf = yaml.safe_load((folder / f"{ROBOT}.cdf").read_text(encoding="utf-8"))
    assert (
        cdf["base"] == "debian:bookworm" and "git" in cdf["packages"]["apt"] and PACKAGE not in cdf["packages"]["apt"]
    )
    places = {one["path"]: one for one in cdf["repositories"]}
    # a path of the robot's choice would be this machine's own folder
    clone = Path(f"{CLONES}/{ROBOT}{repository}")
    assert places[WORKSPACE] == {"git": f"file://{clone}", "ref": commit, "path": WORKSPACE}
    assert f"git clone --bare ssh://ROBOT{repository} {clone}" in str(notes(done.json, "adapted"))
    request.addfinalizer(lambda: shutil.rmtree(f"{CLONES}/{ROBOT}{tmp_path}", ignore_errors=True))
    subprocess.run(["git", "clone", "-q", "--bare", str(repository), str(clone)], check=True)
    assert places["/usr/src/srprov-pip/by-hand"]["ref"] == commit
    patch = (folder / ROBOT / "patches" / "0.patch").read_text(encoding="utf-8")
    assert "+speed: 2" in patch and "login.yaml" not in patch
    lost = "\n".join(notes(done.json, "lost"))
    for words in (f"package {PACKAGE}: is in none", "not tracked: not-tracked", "stopped: does not run", "/etc/changed",
                  "the volume maps holds"):  # fmt: skip
        assert words in lost, (words, lost)
    assert any("login.yaml" in one for one in notes(done.json, "secret"))
    assert any(one.startswith("workspace /home/robot/ws: of colcon") for one in notes(done.json, "adapted"))

    words = (f"{ROBOT}-host", "--profile", "host", "--allow", "git", "--allow", "outside")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    shown = hand.srprov("build", "--show", str(folder / "experiment.edf"), *words, env=own)
    assert shown.code == 0 and "git apply --whitespace=nowarn" in shown.out, shown
    again = hand.srprov("snapshot", ROBOT, "-i", inventory, "-o", str(folder))
    assert again.code == 5 and "is there already" in again.err, again

    kept = {name: hand.inspect(ROBOT, name) for name in ("Camera.Front", "db")}
    hand.shell(ROBOT, "docker", "rm", "-f", *kept)  # they have the ports
    own |= {one["env"]: "another-value" for one in done.json["secrets"]}
    applied = hand.srprov(
        "apply", str(folder / "experiment.edf"), "-i", inventory, "--yes", "--allow", "all", "--settle", "0", env=own
    )
    assert applied.code == 0, applied
    for name, service in (("Camera.Front", "camera-front"), ("db", "db")):
        new = hand.inspect(ROBOT, f"srprov.snapshot.{service}")
        for key in ("Devices", "Memory", "Ulimits", "Tmpfs", "RestartPolicy", "PortBindings"):
            same = new["HostConfig"].get(key) or None, kept[name]["HostConfig"].get(key) or None
            assert same[0] == same[1], (name, key, same)
        assert new["Image"] == kept[name]["Image"] and new["State"]["Running"], name


PLACE = "/home/robot/traps"
PIP = "/usr/local/lib/python3.11/dist-packages"
ODD = f"""\
set -e
cd {PLACE}
for one in "new
line" '$(touch $MARK)' '--upload-pack=x' "it's"; do mkdir -p -- "./$one" && cp -a plain/. "./$one/"; done
mkdir linked && ln -s ../plain/.git linked/.git
cp -a plain ext && git -C ext remote set-url origin 'ext::sh -c "touch $MARK"'
cp -a plain login && git -C login remote set-url origin 'https://robot:{PASSWORD}@h.example/code.git'
cp -a plain pipe && rm pipe/.git/index && mkfifo pipe/.git/index
cp -a plain borrowed && echo /root/traps/.git/objects >borrowed/.git/objects/info/alternates
cp -a plain elsewhere && git -C elsewhere config core.worktree /root/traps
chown -R robot: {PLACE}
mkdir -p /root/traps && cp -a plain/. /root/traps/ && chown -R root: /root/traps && chown robot: /root/traps/a
echo {TOKEN} >/root/traps/b
for one in 'idna-3.7:requests:3.7' 'x-1:x:1; touch /tmp/mark' 'evil-1:srprov-trap-evil:1'; do
  d={PIP}/srprov_trap_${{one%%:*}}.dist-info; mkdir $d; echo pip >$d/INSTALLER; one=${{one#*:}}
  printf 'Name: %s\\nVersion: %s\\n' "${{one%%:*}}" "${{one#*:}}" >$d/METADATA
done
ln -s /etc/shadow {PIP}/srprov_trap_evil-1.dist-info/direct_url.json
mkdir {PIP}/srprov_trap-1.dist-info && mkfifo {PIP}/srprov_trap-1.dist-info/INSTALLER
mkfifo /etc/apt/sources.list.d/srprov-trap.list
echo 'deb https://robot:{PASSWORD}@h.example/apt stable main' >/etc/apt/sources.list.d/srprov-trap2.list
docker pull -q busybox >/dev/null
docker run -d --name 'it_s.a-trap' -e 'TWO=a
services: {{x: 1}}
$(touch /tmp/mark)' -e 'DIR=/tmp/${{X}}' --label 'a:b=c
d' --workdir '/a "b' busybox sleep 86400 >/dev/null
"""
GONE = f"""rm -rf {PIP}/srprov_trap* /etc/apt/sources.list.d/srprov-trap*.list /tmp/mark*"""


@pytest.fixture
def trapped(lab: Lab) -> Iterator[Lab]:
    """Give the lab with a robot whose user laid every trap that there is."""
    made = "".join(
        f"mkdir -p {PLACE}/{name} && cd {PLACE}/{name} && export MARK=/tmp/mark-{name}\n{START}{trap}\n"
        for name, trap in {**TRAPS, "plain": ""}.items()
    )
    whole = f"export HOME=/root MARK=/tmp/mark\n{made}export MARK=/tmp/mark\n{ODD}"
    done = lab.shell(ROBOT, "sh", "-c", whole, check=False)
    try:
        assert done.code == 0, done
        lab.shell(ROBOT, "sh", "-c", "rm -f /tmp/mark*")
        yield lab
    finally:
        by_hand.take_down(lab, ROBOT)
        lab.shell(ROBOT, "sh", "-c", GONE, check=False)


def test_a_robot_full_of_traps_runs_none_of_them_and_is_left_as_it_was(trapped: Lab, tmp_path: Path) -> None:
    """Each is read or named; what others may not read is in no output, and the rest is captured all the same."""
    look = f"find {PLACE} /root/traps {PIP} /etc/apt -printf '%p %s %T@ %C@ %i\\n' | sort"
    before = trapped.shell(ROBOT, "sh", "-c", look).out
    inventory = part_of_lab(trapped, [ROBOT], tmp_path / "lab.yml")
    folder = tmp_path / "taken"
    done = trapped.srprov("snapshot", ROBOT, "-i", inventory, "-o", str(folder), "--json")
    assert done.code == 0, done
    assert trapped.shell(ROBOT, "sh", "-c", "ls /tmp/mark*", check=False).out == ""
    after = trapped.shell(ROBOT, "sh", "-c", look).out
    assert sorted(set(after.splitlines()) ^ set(before.splitlines())) == []
    assert list(Draft202012Validator(data.schema("snapshot")).iter_errors(done.json)) == []
    everything = texts(done, folder)
    assert PASSWORD not in everything and TOKEN not in everything and "root:" not in everything.replace("root:*", "")
    assert trapped.srprov("validate", str(folder / "experiment.edf")).code == 0

    robot = done.json["robots"][ROBOT]
    patched = {one["folder"].removeprefix(f"{PLACE}/") for one in robot["repositories"] if one["patch"]}
    assert patched >= TRAPS.keys() - {"required", "promisor", "split-index", "include"} | {
        "plain",
        "login",
        "it's",
        "$(touch $MARK)",
    }
    for path in sorted((folder / ROBOT / "patches").iterdir()):
        added = [line for line in path.read_text().splitlines() if line.startswith("+") and not line.startswith("+++")]
        assert "+2" in added, path
    said = {note["subject"].removeprefix("repository "): note["words"] for note in done.json["notes"]}
    for name, words in {
        "new\\nline": "has a path that no definition can name", "linked": "is a link", "ext": "is of a kind",
        "pipe": "has no files where git has them", "borrowed": "borrows objects",
        "include": "has settings that include other files",
    }.items():  # fmt: skip
        assert any(place.strip("'\"").endswith(name) and words in said[place] for place in said), (name, said)
    assert "belongs to root and has files of other users" in said["/root/traps"]
    every = "\n".join(notes(done.json, "lost") + notes(done.json, "secret"))
    for words in ("calls itself requests 3.7 inside", "has a name or version that no Python package has",
                  "its address holds a user or password"):  # fmt: skip
        assert words in every, every
    assert {"name": "srprov-trap-evil", "version": "1"} in robot["pip"], "and nothing of the file behind the link"
    edf = yaml.safe_load((folder / "experiment.edf").read_text(encoding="utf-8"))
    trap = edf["services"]["it_s-a-trap"]
    assert sorted(trap["environment"]) == ["DIR=/tmp/${X}", "TWO=a\nservices: {x: 1}\n$(touch /tmp/mark)"]
    assert set(edf["services"]) == {"it_s-a-trap", f"{ROBOT}-host"} and trap["working_dir"] == '/a "b'
