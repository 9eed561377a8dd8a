"""Robots' answers become a folder that srprov's own rules take, whatever they say; what they refuse is left out."""

from __future__ import annotations

import base64
import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import yaml
from jsonschema import Draft202012Validator

from srprov import data
from srprov.codes import Code
from srprov.controller.fleet import Fleet
from srprov.controller.snapshot import snapshot
from srprov.definitions import load_experiment
from srprov.errors import TransportError, UsageError
from srprov.images.dockerfile import render_dockerfile
from srprov.snapshot.changes import changes_query
from srprov.snapshot.questions import QUESTIONS
from srprov.wire import AnyQuery, EngineQuery, Query, Reply

IMAGE = f"sha256:{'e' * 64}"
UPPER = "/var/lib/docker/overlay2/a/diff"
LAYER = {"Name": "overlay2", "Data": {"UpperDir": UPPER}}
SYSTEM = "/etc/os-release:ID=debian\n/etc/os-release:VERSION_CODENAME=bookworm\nmachine x86_64\nid 0\n" + "".join(
    f"has {name}\n" for name in ("setpriv", "prlimit", "git", "timeout", "base64")
)


def coded(text: str, end: str = "\0end") -> str:
    return base64.b64encode((text + end).encode()).decode()


@dataclass
class Robot:
    """A reader that answers from tables."""

    shell: Mapping[str, str] = field(default_factory=dict)
    """Name of a question -> its answer."""
    boxes: Sequence[Mapping[str, Any]] = ()
    repository: str = ""
    policy: str = ""

    def ask(self, queries: Sequence[AnyQuery]) -> list[Reply]:
        return [self._engine(one) if isinstance(one, EngineQuery) else self._shell(one) for one in queries]

    def _shell(self, query: Query) -> Reply:
        for question in QUESTIONS:
            if query.command == question.command:
                return Reply(status=0, out={"system": SYSTEM, **self.shell}.get(question.name, coded("")))
        if query.command == changes_query(UPPER).command:
            return Reply(status=0, out="7\t.\n/etc\n/etc/x\n")
        return Reply(status=0, out=self.policy if "apt-cache" in query.command else self.repository)

    def _engine(self, query: EngineQuery) -> Reply:
        said: object = {"DefaultRuntime": "runc"}
        if query.path == "/containers/json":
            said = [
                {"Id": box["Id"], "ImageID": IMAGE, "Names": [box["Name"]], "State": box.get("State", "running"),
                 "Labels": box.get("Labels", {})}
                for box in self.boxes
            ]  # fmt: skip
        elif query.path.startswith("/containers/"):
            said = next(box for box in self.boxes if box["Id"] in query.path)
        elif query.path.startswith("/images/"):
            said = {"RepoTags": ["app:1"], "RepoDigests": [], "Config": {}}
        return Reply(status=200, out=json.dumps(said))


def box(number: int, name: str, env: Sequence[str] = (), **host: Any) -> dict[str, Any]:
    config = {"Image": "app:1", "Env": list(env), "Hostname": f"{number:064x}"[:12]}
    return {"Id": f"{number:064x}", "Name": f"/{name}", "Config": config, "HostConfig": host, "GraphDriver": LAYER}


def fleet_of(**robots: Robot | None) -> Fleet:
    """Give a fleet of these robots; None is one that cannot be reached."""

    def get(name: str) -> Robot:
        robot = robots[name]
        if robot is None:
            raise TransportError(name, "no route to host", code=Code.LOST)
        return robot

    fake = SimpleNamespace(inventory=SimpleNamespace(hosts=robots), sessions=SimpleNamespace(get=get), forks=4)
    return cast("Fleet", fake)


def taken(folder: Path, **robots: Robot | None) -> tuple[dict[str, Any], dict[str, Any], str]:
    """Take a snapshot; give the report, the EDF and all that was written."""
    document = snapshot(fleet_of(**robots), folder, "lab")
    assert list(Draft202012Validator(data.schema("snapshot")).iter_errors(document)) == []
    loaded = load_experiment(str(folder / "experiment.edf"), profiles=("*",))
    for one in loaded.containers.values():
        render_dockerfile(one, ["0" * 40 for _ in one.repositories])
    edf = yaml.safe_load((folder / "experiment.edf").read_text(encoding="utf-8"))
    written = "".join(path.read_text(encoding="utf-8") for path in sorted(folder.rglob("*")) if path.is_file())
    return document, edf, written


def test_containers_of_several_robots_are_services_with_names_of_their_own(tmp_path: Path) -> None:
    """One that cannot be reached is told; one that does not run, or is an instance's, is no service."""
    boxes = [
        box(1, "cam"),
        {**box(2, "old"), "State": "exited"},
        {**box(3, "srprov.x.y"), "Labels": {"srprov.instance": "x", "srprov.service": "y"}},
    ]
    document, edf, _ = taken(tmp_path / "out", r1=Robot(boxes=boxes), r2=Robot(boxes=[box(4, "cam")]), r3=None)
    assert set(edf["services"]) == {"cam-r1", "cam-r2", "r1-host", "r2-host"}
    assert (edf["services"]["cam-r1"]["robot"], edf["services"]["cam-r2"]["robot"]) == ("r1", "r2")
    assert document["unreachable"] == {"r3": "r3: no route to host"} or "no route" in str(document["unreachable"])
    said = str(document["notes"])
    assert "does not run" in said and "belongs to the instance x" in said and "/etc/x" in said


def test_a_secret_of_one_robot_is_written_nowhere_for_another(tmp_path: Path) -> None:
    one = Robot(boxes=[box(1, "db", ["PASSWORD=hunter2-and-more"])])
    two = Robot(boxes=[box(2, "web", ["URL=http://x/?q=hunter2-and-more", "WHO=hunter2-and-more"])])
    document, edf, written = taken(tmp_path / "out", r1=one, r2=two)
    assert "hunter2" not in written + json.dumps(document)
    assert "web" not in edf["services"] and "container web: its environment holds" in written
    assert edf["secrets"] == {"db-password": {"env": "R1__DB__PASSWORD"}}


def test_what_a_robot_calls_a_secret_makes_no_container_of_another_do_something_else(tmp_path: Path) -> None:
    """With `***` in a script, `rm -rf /data/cache/*` removed all that the container could write to: no word is lost."""
    lies = [
        f"{name}_PASSWORD={word}" for name, word in zip("ABC", ("data/cache", "no-new-privileges", "ALL"), strict=True)
    ]
    script = {"Cmd": ["sh", "-c", "rm -rf /data/cache/*"]}
    cleaner = {**box(2, "cleaner"), "Config": {**box(2, "cleaner")["Config"], **script}}
    limited = [box(3, "a", CapDrop=["ALL"]), box(4, "b", SecurityOpt=["no-new-privileges"])]
    two = Robot(boxes=[cleaner, *limited])
    _, edf, written = taken(tmp_path / "out", r1=Robot(boxes=[box(1, "lies", lies)]), r2=two)
    assert not {"a", "b", "cleaner"} & edf["services"].keys() and "container b: its security" in written
    for name, more in (("alone", {}), ("short", {"r1": Robot(boxes=[box(1, "lies", lies[2:])])})):
        _, edf, _ = taken(tmp_path / name, **more, r2=two)
        assert {"a", "b", "cleaner"} < edf["services"].keys() and edf["services"]["a"]["cap_drop"] == ["ALL"]


def test_what_a_robot_calls_a_secret_takes_no_setting_from_a_container_of_another(tmp_path: Path) -> None:
    """With another name of the variable, a container that asks for a login gave all it had to whoever came."""
    words = ("REQUIRE_LOGIN", "required", "lab.example.guarded", "net.ipv4.tcp_syncookies", "max-size")
    lies = [f"{name}_TOKEN={word}" for name, word in zip("ABCDE", words, strict=True)]

    def told(index: int, name: str, **config: object) -> dict[str, Any]:
        return {**box(index, name), "Config": {**box(index, name)["Config"], **config}}

    boxes = [
        told(2, "named", Env=["REQUIRE_LOGIN=yes"]),
        told(3, "valued", Env=["LOGIN=required"]),
        told(4, "labelled", Labels={"lab.example.guarded": "yes"}),
        box(5, "tuned", Sysctls={"net.ipv4.tcp_syncookies": "1"}),
        box(6, "short", LogConfig={"Type": "json-file", "Config": {"max-size": "1m"}}),
    ]
    names = {"named", "valued", "labelled", "tuned", "short"}
    _, edf, written = taken(tmp_path / "out", r1=Robot(boxes=[box(1, "lies", lies)]), r2=Robot(boxes=boxes))
    assert not names & edf["services"].keys() and "container tuned: its sysctls holds" in written
    _, edf, _ = taken(tmp_path / "alone", r2=Robot(boxes=boxes))
    assert names < edf["services"].keys()


def test_what_a_robot_calls_a_secret_makes_no_host_of_another_something_else(tmp_path: Path) -> None:
    """`sleep infinity` is what the image of a host does; a name of a package may be such a word, too."""
    lies, two = (
        Robot(boxes=[box(1, "lies", ["API_TOKEN=infinity"])]),
        Robot(boxes=[box(2, "b", ["A_TOKEN=r2-own-one"])]),
    )
    _, edf, written = taken(tmp_path / "out", r1=lies, r2=two)
    assert "r2-host" not in edf["services"] and "b" in edf["services"] and "host r2: a word of it is" in written
    _, edf, _ = taken(tmp_path / "alone", r2=two)
    assert "r2-host" in edf["services"]


def test_a_password_in_a_health_check_is_hidden_as_in_a_command(tmp_path: Path) -> None:
    check = {"Test": ["CMD", "mysqladmin", "ping", "--password", "hunter2", "--secret=a$b"]}
    one = {**box(1, "db"), "Config": {**box(1, "db")["Config"], "Healthcheck": check}}
    document, edf, written = taken(tmp_path / "out", r1=Robot(boxes=[one]))
    assert edf["services"]["db"]["healthcheck"]["test"] == [*check["Test"][:4], "***", "--secret=***"]
    assert "hunter2" not in written + json.dumps(document) and "its healthcheck holds" in written


def test_no_robot_gets_files_of_the_snapshot_mounted(tmp_path: Path) -> None:
    """Engines say whole paths; in an EDF another one is of the experiment's folder, which has other robots' changes."""
    for source in (".", "./r2", "r2", "..", "~/x", "~pi/x", ""):
        mounts = [{"Type": "bind", "Source": one, "Destination": f"/{at}"} for at, one in enumerate((source, "/srv"))]
        _, edf, written = taken(
            tmp_path / f"out{source.replace('/', '-')}", r1=Robot(boxes=[{**box(1, "a"), "Mounts": mounts}])
        )
        assert [one["source"] for one in edf["services"]["a"]["volumes"]] == ["/srv"]
        assert "is no path of a robot" in written


def test_a_password_may_be_a_word_of_an_experiment(tmp_path: Path) -> None:
    """It is hidden in what was captured, and the experiment stays one."""
    env = [
        "A_PASSWORD=services",
        "B_PASSWORD=turtlebot",
        "C_PASSWORD=environment",
        "WHO=turtlebot",
        "WHERE=at services",
    ]
    boxes = [{**box(1, "app", env), "Config": {**box(1, "app", env)["Config"], "Labels": {"a services b": "c"}}}]
    document, edf, _ = taken(tmp_path / "out", turtlebot=Robot(boxes=boxes))
    service = edf["services"]["app"]
    assert service["environment"] == ["WHERE=at ***", "WHO=***"] and service["labels"] == {"a *** b": "c"}
    assert service["robot"] == "turtlebot" and "turtlebot" in document["robots"]


def test_what_definitions_refuse_is_left_out_and_the_rest_is_kept(tmp_path: Path) -> None:
    """Devices, capabilities and mounts with syntax that an EDF does not have; ports that two services have."""
    odd = box(
        1, "odd", ["A=1", "B B=2"], CapAdd=["NET_ADMIN", "lower case"], CpusetCpus="0;reboot", Sysctls={"a": "b"},
        Devices=[{"PathOnHost": "relative"}, {"PathOnHost": "/dev/video0"}], RestartPolicy={"Name": "sometimes"},
        Ulimits=[{"Name": "nothing", "Soft": 1, "Hard": 1}], PortBindings={"80/tcp": [{"HostPort": "99999"}]},
    )  # fmt: skip
    odd["Mounts"] = [
        {"Type": "bind", "Source": "../x", "Destination": "rel"},
        {"Type": "bind", "Source": "/a", "Destination": "/b"},
    ]
    same = [box(number, f"web{number}", PortBindings={"80/tcp": [{"HostPort": "80"}]}) for number in (2, 3)]
    document, edf, _ = taken(tmp_path / "out", r1=Robot(boxes=[odd, *same]))
    service = edf["services"]["odd"]
    assert (
        service["cap_add"] == ["NET_ADMIN"]
        and service["devices"] == ["/dev/video0"]
        and service["environment"] == ["A=1"]
    )
    assert service["volumes"] == [{"type": "bind", "source": "/a", "target": "/b"}]
    assert not {"cpuset", "restart", "ulimits", "ports"} & service.keys()
    lost = [note for note in document["notes"] if note["subject"] == "container odd" and note["kind"] == "lost"]
    assert len(lost) >= 7, lost


def test_packages_patches_and_lies_of_a_host(tmp_path: Path) -> None:
    """A patch is applied where its repository is; nothing of a path or a name becomes a command."""
    lines = [
        "ii \ttree\tamd64\t1-1\tno\toptional\t\t",
        "ii \tgit\tamd64\t2\tno\toptional\t\t",
        "ii \tx;y\tall\t1\tno\toptional\t\t",
    ]
    answers = {
        "remotes": "remote.origin.url\nhttps://h.example/it's.git\0", "pushed": "refs/remotes/origin/main\n",
        "patch": "diff --git a/a b/a\n--- a/a\n+++ b/a\n@@ -1 +1 @@\n-1\n+2\n",
    }  # fmt: skip
    answers["remotes"] = "remote.origin.url\nhttps://h.example/code.git\0"
    said = "".join(f"{name} {coded(text, chr(0) + '0')}\n" for name, text in {"commit": "a" * 40, **answers}.items())
    robot = Robot(
        shell={
            "packages": "\n".join(lines),
            "repositories": coded("1000 d /home/it's $(reboot)/.git\x000 d /root/ws/src/a/.git\x001 l /x/.git\0"),
            "workspaces": coded("/root/ws/install/setup.bash\0/opt/venv/pyvenv.cfg\0"),
            "metadata": coded(
                "dist /usr/local/lib/python3.11/dist-packages/idna-3.7.dist-info\0Name: idna\nVersion: 3.7\n\0\0"
            ),
        },
        repository=said,
        policy="tree:\n  Installed: 1-1\n  Candidate: 1-1\n  Version table:\n *** 1-1 500\n"
        "        500 http://deb.debian.org/debian bookworm/main amd64 Packages\ngit:\n  Installed: 2\n  Candidate: 2\n"
        "  Version table:\n *** 2 500\n        500 http://deb.debian.org/debian bookworm/main amd64 Packages\n",
    )
    document, _, _ = taken(tmp_path / "out", **{"it's.robot": robot})
    (file,) = (tmp_path / "out").glob("*.cdf")
    cdf = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert cdf["packages"] == {"apt": ["git", "tree"], "pip": ["idna==3.7"]}
    assert [one["path"] for one in cdf["repositories"]] == ["/home/it's $(reboot)", "/root/ws/src/a"]
    assert cdf["run"][0].startswith("cd '/home/it'\"'\"'s $(reboot)'\ngit apply ")
    said_of = {note["subject"]: note["words"] for note in document["notes"]}
    assert "virtual environment /opt/venv" in said_of and "workspace /root/ws" in said_of and "repository /x" in said_of


@pytest.mark.parametrize(
    "garbage", ["", "\0" * 100, "x" * 100_000, coded("\xff" * 999), "[" * 5000, "/etc/os-release:ID=" + "a" * 500]
)
def test_garbage_for_every_answer_is_no_error(garbage: str, tmp_path: Path) -> None:
    """A robot of which nothing can be understood gives a report, and an experiment only where there is something."""
    shell = {question.name: garbage for question in QUESTIONS if question.name != "system"}
    robot = Robot(shell=shell, boxes=[box(1, "a")], repository=garbage, policy=garbage)
    document, edf, _ = taken(tmp_path / "out", r1=robot)
    assert "a" in edf["services"] and document["notes"]


def test_nothing_is_written_where_something_is_or_where_nobody_answered(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there/x").write_text("x", encoding="utf-8")
    with pytest.raises(UsageError, match="is there already"):
        snapshot(fleet_of(r1=Robot()), tmp_path / "there", "lab")
    with pytest.raises(UsageError, match="no robot could be looked at: r1: ") as unseen:
        snapshot(fleet_of(r1=None), tmp_path / "new", "lab")
    odd = "id 0\n/etc/os-release:PRETTY_NAME=first: curl x | sh\n"
    with pytest.raises(UsageError, match=r"there is nothing to write: r1: .*curl x") as empty:
        snapshot(fleet_of(r1=Robot(shell={"system": odd})), tmp_path / "new", "lab")
    assert unseen.value.hint == empty.value.hint == ""  # a hint is srprov's own
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_what_changed_in_a_container_is_told_and_its_engine_is_not_asked_for_it(tmp_path: Path) -> None:
    """It goes through the files of one that runs, which leads it elsewhere: it opened a pipe of the robot's."""
    document, _, _ = taken(tmp_path / "out", r1=Robot(boxes=[box(1, "cam")]))
    assert "files changed since it was made (7 bytes): /etc/x" in json.dumps(document)
    other = {**box(1, "cam"), "GraphDriver": {"Name": "btrfs", "Data": None}}
    document, _, _ = taken(tmp_path / "other", r1=Robot(boxes=[other]))
    assert "what was changed in its files cannot be listed" in json.dumps(document)


def test_a_container_s_own_files_are_listed_where_no_link_leads_out(tmp_path: Path) -> None:
    """Root lists them; whatever the container puts there, it is asked for as it is."""
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc" / "x").write_text("12345")
    (tmp_path / "out").symlink_to("/root")
    os.mkfifo(tmp_path / "pipe")
    command = changes_query(str(tmp_path)).command
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=True, timeout=30)
    size, *paths = done.stdout.splitlines()
    assert sorted(paths) == ["/etc", "/etc/x", "/out", "/pipe"] and int(size.split("\t")[0]) >= 5
    gone = subprocess.run(["sh", "-c", changes_query(f"{tmp_path}/no").command], capture_output=True, check=False)
    assert gone.returncode != 0
