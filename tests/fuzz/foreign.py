"""Further files and answers that others write: projects of other tools, robots that are looked at, bundles, runs."""

from __future__ import annotations

import base64
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from srprov.cli.compare import margins_of
from srprov.cli.replay import _pair
from srprov.controller.snapshot import _robots, _without_secrets
from srprov.controller.snapshot_check import Checker
from srprov.controller.snapshot_look import look
from srprov.conversion import report, swarmrob
from srprov.conversion.compose import Wanted, draft
from srprov.conversion.folder import write
from srprov.definitions.model import Host, Inventory
from srprov.errors import SrprovError
from srprov.evidence import replay
from srprov.evidence.compare import compare
from srprov.evidence.verify import verify
from srprov.record.runs import kept_runs, trials_run
from srprov.report.page import page
from srprov.report.read import of_run
from srprov.snapshot import report as snapshot_report
from srprov.snapshot.gitscript import ASKED
from srprov.snapshot.hider import Hider
from srprov.snapshot.questions import END, QUESTIONS
from srprov.wire import AnyQuery, EngineQuery, Reply
from tests.unit.evidence.bundles import Content, as_it_is, packed, unpacked, with_manifest
from tests.unit.report.pages import Page
from tests.unit.report.records import run as a_run
from tests.unit.report.records import write as write_record

COMPOSE = """\
name: shop
include: [{path: more.yml, project_directory: sub}]
services:
  web:
    image: "web:${TAG:-1}"
    build: {context: img, dockerfile_inline: "FROM busybox\\nRUN true\\n", args: {A: "1"}}
    environment: {A: "$$x ${B-y}", C: null}
    env_file: [web.env]
    ports: ["8080:80", "127.0.0.1:53:53/udp"]
    volumes: ["./conf:/conf:ro", data:/data, "/opt/x:/x", "~/y:/y"]
    configs: [{source: c, target: /c}]
    secrets: [s]
    depends_on: {db: {condition: service_healthy}}
    healthcheck: {test: [CMD, "true"], interval: 1m30s}
    deploy: {replicas: 2, resources: {limits: {cpus: "0.5", memory: 64m}}}
  db: {extends: {file: more.yml, service: base}, command: sleep 9, tmpfs: [/run], stop_grace_period: 5s}
volumes: {data: {}}
configs: {c: {content: "x"}}
secrets: {s: {file: ./s.txt}}
"""
MORE = "services:\n  base: {image: 'db:1', labels: {a: b}, ulimits: {nofile: 10}, sysctls: [a.b=1]}\n"
ENV = "TAG=2\nexport B='x'\nD=\"a\\n${TAG}\"\n"
SWARMROB = """\
version: '3'
services:
  a:
    image: hub/talker
    environment: ["A=$B", "C=x_1"]
    depends_on: [b]
    devices: ["/dev/video0:/dev/video0"]
    volumes: ["/srv/a:/a"]
  b: {image: "b:1", deploy: {placement: {constraints: ["node.hostname == r1"]}}}
"""
_PATCH = "diff --git a/x b/x\nindex 1..2 100644\n--- a/x\n+++ b/x\n@@ -1 +1 @@\n-a\n+b\n"
_SAID = {
    "system": "/etc/os-release:ID=debian\n/etc/os-release:VERSION_CODENAME=bookworm\nmachine x86_64\nid 0\nros humble\n"
    "has setpriv\nhas prlimit\nhas git\nhas timeout\nhas base64\n",
    "packages": "ii \tcurl\tamd64\t7.88-1\tno\toptional\t\tlibc6 (>= 2.3), a | b:any\n"
    "ii \tlibc6\tamd64\t2\tyes\trequired\t\t\n",
    "states": "Package: libc6\nAuto-Installed: 1\n",
    "sources": "/etc/apt/sources.list:deb [arch=amd64 signed-by=/etc/apt/keyrings/a.gpg] https://a.example/x y main\n"
    "/etc/apt/sources.list.d/b.sources:Types: deb\n/etc/apt/sources.list.d/b.sources:URIs: https://b.example/\n"
    "/etc/apt/sources.list.d/b.sources:Suites: z\n",
    "metadata": "dist /usr/lib/python3/dist-packages/a-1.0.dist-info\0Name: a\nVersion: 1.0\n\0"
    '{"url": "https://h/x.git", "vcs_info": {"vcs": "git", "commit_id": "' + "1" * 40 + '"}}\0',
    "repositories": "0 0 d /opt/code/.git\0",
    "workspaces": "/opt/ws/install/setup.bash\0/opt/v/pyvenv.cfg\0",
    "files": f"{'0' * 64} /etc/netplan/a.yaml\0",
}
"""Question -> what a robot says to it; `sources` and what follows come as base64."""
_GIT = {
    "commit": "1" * 40 + "\n", "branch": "main\n", "remotes": "remote.origin.url\nhttps://u:p@h.example/x.git\0",
    "pushed": "refs/remotes/origin/main\n", "patch": _PATCH, "untracked": "a\0b/\0", "flags": "H x\0h y\0",
}  # fmt: skip
_POLICY = "curl:\n  Installed: 7\n  Candidate: 7\n  Version table:\n *** 7 500\n"
_POLICY += "        500 https://a.example/x y/main amd64\n"
_ORIGINS = " 500 https://a.example/x y/main amd64 Packages\n     release v=1,o=Other,a=y,n=y,l=O,c=main,b=amd64\n"
_BOX = json.dumps(
    {
        "Id": "a" * 64, "Name": "/cam", "Created": "2026-11-01T00:00:00Z",
        "GraphDriver": {"Name": "overlay2", "Data": {"UpperDir": "/var/lib/docker/overlay2/a/diff"}},
        "Config": {"Hostname": "h", "Env": ["A=1", "TOKEN=abcdefgh12345678"], "Cmd": ["run", "--password", "x"],
                   "Image": "cam:1", "Labels": {"a": "b"},
                   "Healthcheck": {"Test": ["CMD", "true"], "Interval": 1000000000}},
        "HostConfig": {"NetworkMode": "bridge", "Memory": 5, "NanoCpus": 5, "CapAdd": ["CAP_NET_ADMIN"],
                       "Tmpfs": {"/t": ""},
                       "PortBindings": {"80/tcp": [{"HostIp": "", "HostPort": "8080"}]}, "Ulimits": [{"Name": "nofile",
                       "Soft": 1, "Hard": 2}], "DeviceRequests": [{"Count": -1, "Capabilities": [["gpu"]]}],
                       "Devices": [{"PathOnHost": "/dev/a", "PathInContainer": "/dev/a", "CgroupPermissions": "rwm"}],
                       "LogConfig": {"Type": "journald", "Config": {"tag": "x"}},
                       "RestartPolicy": {"Name": "on-failure", "MaximumRetryCount": 3}},
        "Mounts": [{"Type": "bind", "Source": "/srv/x", "Destination": "/x", "RW": False, "Propagation": "rprivate"}],
        "NetworkSettings": {"Networks": {"bridge": {"IPAMConfig": {"IPv4Address": "10.0.0.1"}}}},
    }
)  # fmt: skip
_IMAGE = json.dumps({"RepoDigests": ["cam@sha256:" + "0" * 64], "RepoTags": ["cam:1"], "Config": {"Env": ["P=1"]}})
_LISTED = json.dumps(
    [{"Id": "a" * 64, "ImageID": f"sha256:{'b' * 64}", "Names": ["/cam"], "State": "running", "Labels": {}}]
)
_CHANGES = "12\t.\n/a\n/a/b\n"


def _coded(text: str | bytes) -> str:
    return base64.b64encode(text.encode("utf-8", "replace") if isinstance(text, str) else text).decode()


class _Robot:
    """A robot that says what is usual, but for one answer."""

    def __init__(self, changed: str, content: bytes) -> None:
        self.said = {
            **_SAID, **_GIT, "policy": _POLICY, "origins": _ORIGINS, "box": _BOX, "image": _IMAGE, "listed": _LISTED,
            "changes": _CHANGES, "key": "x",
        }  # fmt: skip
        self.changed, self.content = changed, content

    def _says(self, name: str) -> bytes:
        return self.content if name == self.changed else self.said[name].encode()

    def _plain(self, name: str) -> Reply:
        return Reply(status=0, out=self._says(name).decode("utf-8", "replace"))

    def ask(self, queries: Sequence[AnyQuery]) -> list[Reply]:
        return [self._answer(one) for one in queries]

    def _answer(self, query: AnyQuery) -> Reply:
        if isinstance(query, EngineQuery):
            kinds = {"/containers/json": "listed", "/info": "image"}
            ends = {"/json": "image" if query.path.startswith("/images") else "box"}
            name = kinds.get(query.path) or next(kind for end, kind in ends.items() if query.path.endswith(end))
            return Reply(status=200, out=self._plain(name).out)
        for question in QUESTIONS:
            if query.command == question.command:
                if question.name in ("system", "packages", "states"):
                    return self._plain(question.name)
                return Reply(status=0, out=_coded(self._says(question.name) + END.encode()))
        if "find . -xdev -mindepth 1" in query.command:
            return self._plain("changes")
        if "git --no-pager" in query.command:
            said = (f"{name} {_coded(self._says(name) + bytes(1) + b'0')}" for name, *_ in ASKED)
            return Reply(status=0, out="\n".join(said))
        if "apt-cache" in query.command:
            return self._plain("policy" if " curl" in query.command else "origins")
        return Reply(status=0, out=f"/etc/apt/keyrings/a.gpg {_coded(self._says('key'))}\n")


def _snapshot(changed: str) -> Callable[[Path, bytes], None]:
    def use(folder: Path, content: bytes) -> None:
        seen = look(_Robot(changed, content), "robot1")  # type: ignore[arg-type]  # it asks, and does nothing else
        robots = _robots([seen])
        hider = Hider(value for robot in robots for one in robot.services for value in one.hidden)
        robots, definitions = _without_secrets(robots, hider)
        draft = folder / "snapshot"
        draft.mkdir()
        robots, definitions = Checker(draft, robots, definitions, hider).checked("snapshot")
        told = snapshot_report.markdown(snapshot_report.document("snapshot", robots, definitions, {}))
        assert all(line.isprintable() for line in told.split("\n"))
        for one in draft.rglob("*"):
            if one.is_file() and one.suffix in (".edf", ".cdf"):
                assert all(line.isprintable() for line in one.read_text().split("\n"))
        assert "abcdefgh12345678" not in "".join(one.read_text() for one in draft.glob("*.edf")) or changed == "image"

    return use


def _imported(name: str) -> Callable[[Path, bytes], None]:
    """Return what imports a project of which one file is another."""

    def use(folder: Path, content: bytes) -> None:
        place = folder / "project"
        for path, text in {"compose.yml": COMPOSE, "more.yml": MORE, ".env": ENV, "web.env": ENV, "conf/a": "x",
                           "s.txt": "x", "map.yml": "compose.yml: robot1\n", "img/a": "x"}.items():  # fmt: skip
            (place / path).parent.mkdir(parents=True, exist_ok=True)
            (place / path).write_text(text)
        (folder / "away").mkdir()
        for link in ("configs", "web.dockerfile"):
            (place / link).symlink_to(folder / "away")
        (place / "sub").mkdir()
        (place / name).write_bytes(content)
        files = [str(place / "compose.yml")]
        for one in ("", str(place / "map.yml")) if name == "map.yml" else ("",):
            try:
                _written(draft(Wanted(files=files, folder="taken", robot_map=one, root=str(place))), files)
            except SrprovError as error:
                assert len(str(error)) < 200_000
        assert os.listdir(folder / "away") == []

    return use


def _written(made: Any, files: Sequence[str]) -> None:
    for text in (report.as_text(made), report.as_markdown(made, files), report.as_sarif(report.told(made))):
        assert isinstance(text, str)
    if not made.refused:
        write(made, "taken", files)
        shutil.rmtree("taken")


def _swarmrob(_folder: Path, content: bytes) -> None:
    Path("swarmrob.yml").write_bytes(content)
    try:
        _written(swarmrob.draft(["swarmrob.yml"], "taken", {"B": "1"}), ["swarmrob.yml"])
    except SrprovError as error:
        assert len(str(error)) < 200_000


class Kept:
    """A run and its bundle, made once by whoever starts the fuzzer."""

    def __init__(self, folder: Path) -> None:
        """Take the folder where `make` put them."""
        self.run, self.bundle = folder / "run", folder / "race.zip"
        self.content: Content = unpacked(self.bundle)

    @staticmethod
    def make(folder: Path) -> None:
        """Make a run and its bundle."""
        from srprov.evidence.make import bundle
        from tests.trial_folders import run_folder, write_experiment

        bundle(run_folder(folder / "run", write_experiment(folder / "experiment")), folder / "race.zip")

    def bundled(self, name: str) -> Callable[[Path, bytes], None]:
        """Return what verifies, compares and unpacks the bundle with another file."""

        def use(folder: Path, content: bytes) -> None:
            path = str(packed(with_manifest({**self.content, name: content}), folder / "b.zip"))
            bundle = as_it_is(Path(path))
            try:
                details = [text for one in verify(path).findings for text in one.details]
                assert all(text.isprintable() for text in details), details
            except SrprovError as error:
                assert error.exit_code == 5
            for work in (
                lambda: compare([path], [str(self.bundle)], {}),
                lambda: replay.unpack(bundle, folder / "again"),
                lambda: list(replay.differences(replay.read(bundle), {}, _nothing())),
            ):
                try:
                    work()
                except SrprovError as error:
                    assert error.exit_code in (5, 9)

        return use

    def recorded(self, name: str) -> Callable[[Path, bytes], None]:
        """Return what reads a run's folder with another file."""

        def use(folder: Path, content: bytes) -> None:
            run = folder / "run"
            shutil.copytree(self.run, run)
            (run / name).write_bytes(content)
            for work in (
                lambda: trials_run(run),
                lambda: list(kept_runs(folder)),
                lambda: compare([str(run)], [str(self.bundle)], {}),
            ):
                try:
                    work()
                except SrprovError as error:
                    assert error.exit_code in (5, 9), error

        return use

    def surfaces(self) -> Mapping[str, tuple[str, Callable[[Path, bytes], None]]]:
        """Return what is mutated of them: name -> (text, what is done with it)."""
        trial = sorted(one for one in self.content if one.endswith("/trial.json"))[0].rpartition("/")[0]
        home = "sessions/1"
        names = ("journal.jsonl", "bundle.json", "ro-crate-metadata.json", "manifest-sha256.txt", "trials.csv",
                 f"{home}/inputs.json", f"{home}/facts.json", f"{home}/assignment.json", f"{home}/inputs/race.edf",
                 f"{home}/inputs/inventory.yml", f"{trial}/trial.json", f"{trial}/collected.json",
                 f"{trial}/containers.json")  # fmt: skip
        found = {f"bundle {one}": (self.content[one].decode(), self.bundled(one)) for one in names}
        for one in ("journal.jsonl", "trials.csv", "metrics.csv", f"{home}/inputs.json", f"{home}/facts.json"):
            found[f"run {one}"] = ((self.run / one).read_text(), self.recorded(one))
        return found


def _nothing() -> Any:
    from srprov.facts.model import Snapshot

    return Snapshot(facts={}, observed={}, unreachable={})


def _mapped(_folder: Path, content: bytes) -> None:
    hosts = {name: Host(name=name, address=name) for name in ("r1", "r2", "spare")}
    inventory = Inventory(hosts=hosts, groups={"all": tuple(hosts)})
    text = content.decode("utf-8", "replace")
    try:
        replay.mapped(inventory, ("r1", "r2"), dict(map(_pair, text.split("\n"))))
    except SrprovError as error:
        assert error.exit_code == 5


def _margins(_folder: Path, content: bytes) -> None:
    try:
        margins_of(tuple(content.decode("utf-8", "replace").split("\n")))
    except SrprovError as error:
        assert error.exit_code == 5


_RECORD = {name: one if isinstance(one, str) else json.dumps(one) for name, one in a_run(3, failed=True).items()}


def _paged(name: str) -> Callable[[Path, bytes], None]:
    """Return what makes a page of a record with a mutated file, and looks whether it is still whole and harmless."""

    def use(folder: Path, content: bytes) -> None:
        record = write_record(folder / "record", _RECORD)
        (record / name).write_bytes(content)
        try:
            made = Page(page(of_run(record)))
        except SrprovError as error:
            assert error.exit_code == 5, error
            return
        assert made.faults == [] and not made.names & {"script", "img", "iframe", "@style", "@src", "@onclick"}

    return use


def foreign(folder: Path) -> Mapping[str, tuple[str, Callable[[Path, bytes], None]]]:
    """Return name -> (text, what is done with a mutated one); the folder has what `Kept.make` put there."""
    answers = {**_SAID, **_GIT, "policy": _POLICY, "origins": _ORIGINS, "box": _BOX, "image": _IMAGE}
    answers |= {"listed": _LISTED, "changes": _CHANGES, "key": "x"}
    return {
        **{f"compose {name}": (text, _imported(name)) for name, text in {
            "compose.yml": COMPOSE, "more.yml": MORE, ".env": ENV, "web.env": ENV, "map.yml": "compose.yml: robot1\n",
        }.items()},
        "swarmrob": (SWARMROB, _swarmrob),
        **{f"snapshot {name}": (text, _snapshot(name)) for name, text in answers.items()},
        "replay map": ("r1=spare\nr2=r1", _mapped),
        "margins": ("steps=5%\nticks=1\nsuccess=0.1", _margins),
        **{f"page {name}": (text, _paged(name)) for name, text in _RECORD.items() if not name.startswith("inputs/")},
        **Kept(folder).surfaces(),
    }  # fmt: skip
