"""Every kind of file and answer that others write: a real one, and what srprov does with it.

A surface writes a mutated text where it belongs, in a folder that is otherwise whole, and reads it as the verbs do.
Only srprov's own errors may come of it.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import shutil
import tarfile
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from srprov import disk
from srprov.cli.config import default_map
from srprov.cli.facts_ranges import check_ranges
from srprov.cli.facts_table import facts_table
from srprov.cli.main import _VERBS
from srprov.cli.problems import as_json, as_sarif, render_problems
from srprov.controller.bringing import Bringing, Home
from srprov.controller.history import read_history
from srprov.controller.saved import plan_file
from srprov.controller.source import named_instance, read_source
from srprov.definitions import check_files, labpolicy, load_experiment, load_inventory, select
from srprov.definitions.envfile import parse as parse_env
from srprov.definitions.model import Host
from srprov.errors import SrprovError, UsageError
from srprov.execution.collect import CollectFailed, Place, listings, place_of
from srprov.execution.listing import Entry
from srprov.facts.document import facts_document
from srprov.facts.host import parse_host
from srprov.facts.stored import read_document
from srprov.git.program import GitError
from srprov.git.tree import check_links, entries
from srprov.images.tag import plan_image
from srprov.importing.read import normalise
from srprov.modules import MODULES
from srprov.planning.markdown import plan_markdown
from srprov.planning.plan import plan_json
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.policy import KINDS
from srprov.planning.text import plan_text
from srprov.record import last_run
from srprov.record.journal import read as read_journal
from srprov.rendering.limited import render_texts
from srprov.robot_answers import TooManyError
from srprov.transport.openssh import host_keys, ssh_config
from srprov.trials.metrics import from_json
from srprov.trials.reading import read as read_container
from srprov.untrusted import json_or_none, parse_json
from srprov.wire import Reply
from tests.fakes import World
from tests.fuzz.foreign import foreign
from tests.fuzz.robots import answers
from tests.unit.assignment.worlds import robot
from tests.unit.definitions.examples import BASE, CDF, EDF, INVENTORY
from tests.unit.facts.robot_outputs import COMPUTER, replies
from tests.worlds import AS_IT_IS, Definitions, experiment, made, service

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LISTING = f"f 3 ./a/b\0\0l 0 ./l\0/etc/passwd\0H\0{'0' * 64}  ./a/b\0=0\0"
ENV = "# a\nexport FROM_FILE=1\nVERBOSE='off'\nA=\"b\\n\"\nHOME\n"
PLAYBOOK = (
    "{% for one in services %}\n- file: {{ folder ~ '/' ~ one.name }}\n  content: {{ robot.arch }}\n{% endfor %}\n"
    "- command: calibrate\n  argv: [calibrate, {{ host }}]\n  creates: /opt/done\n"
)
INI = "[robots]\nr[1:3] ansible_host=10.0.0.1 ansible_port=22\n[robots:vars]\nansible_user='x'\n[a:children]\nrobots\n"
KEYS = "r1,10.0.0.1 ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAA\n|1|c2FsdA==|aGFzaA== ssh-rsa AAAA\n@revoked * ssh-rsa AAAA\n"
SSH = "Host r1\n  HostName 10.0.0.1\n  Port 22\n  IdentityFile ~/.ssh/%h\nHost *\n  User robot\n"
CONFIG = 'inventory = "i.yml"\nforks = 3\n[apply]\nallow = ["gpu"]\nmax-fail = "25%"\n[tool.srprov]\ntimeout = 3.0\n'
POLICY = (
    "policy: 1\nallow: {all: [gpu], robots: [host-network]}\nlimits:\n  memory: {default: 512m, maximum: 2g}\n"
    "  cpus: {default: 1, maximum: 2}\n  pids: {default: 100, maximum: 200}\nregistries: [docker.io]\n"
)
LOCK = f"""\
lock: 1
srprov: 0.1.0
images:
- {{name: docker.io/library/busybox:1.36, digest: sha256:{"1" * 64}, platforms: [linux/arm64]}}
repositories:
- {{git: https://h/x.git, ref: main, commit: {"2" * 40}}}
files: {{a: {"3" * 64}}}
packages:
- {{image: "srprov/a:1", platform: linux/amd64, apt: [curl=1.0-1], pip: [a==1], npm: [b@1]}}
"""
TREE = f"100644 blob {'1' * 40}      12\ta/b\n100755 blob {'2' * 40} 3\tc\n120000 blob {'3' * 40} 3\ta/link\n"
DOCKERFILE = "ARG A=1\nFROM debian:bookworm AS one\nRUN echo \\\n  x\nFROM one\nHEALTHCHECK CMD true\n"
IGNORE = "# a\n*.pyc\n**/b*c*d\n!a/**\n[a-c]?\n"
RESULT = json.dumps({"unreachable": ["r7"], "steps": [{"number": 1, "id": "r1/container:a", "outcome": "failed"}]})
EVENTS = '{"event": "end", "step": 1, "outcome": "changed"}\n{"event": "begin", "step": 2}\n'
ASSIGNED = json.dumps({"assignment": {"a": "r1"}, "cost": 3.5, "costs": {"r1": 3.5}, "matrix": {"a": {"r1": 3.5}}})
JOURNAL = (
    '{"seq": 1, "utc": "2026-11-22T09:00:00.000+00:00", "event": "run", "same": {"a": "1"}}\n'
    '{"seq": 2, "event": "begin", "trial": "9f2c01ab34-r002", "attempt": 1}\n'
)
CONTAINER = json.dumps(
    {
        "State": {"Status": "exited", "ExitCode": 3, "StartedAt": "2026-11-22T09:00:00.1Z", "Health": {"Status": "x"}},
        "Mounts": [{"Destination": "/out", "Source": "/var/lib/docker/volumes/x/_data"}],
    }
)
COMPOSE = tuple(
    (Path(__file__).resolve().parents[1] / "cases" / "compose" / name / "compose.yml").read_text()
    for name in ("06-drone-sitl", "29-numbers-and-words", "32-durations-sizes", "36-warehouse-fleet", "42-macvlan")
)
RECORD = "20261121T090507Z-hello-4f1c09aa"


@dataclass(frozen=True)
class Surface:
    """One kind of file: real texts of it, and what is done with a mutated one."""

    seeds: tuple[str, ...]
    use: Callable[[Path, bytes], object]


def _checked(*names: str) -> None:
    problems = check_files(names)
    for render in (render_problems, as_json, as_sarif):
        assert isinstance(render(problems), str)


def _composed() -> None:
    normal = normalise([Path("compose.yml")], project="p", profiles=["*"])
    json.dumps(normal.document)
    assert all(place.line > 0 for place in normal.positions.values())


def _composed_with_env() -> None:
    Path("compose.yml").write_text("services: {a: {image: 'x:${A:-1}', environment: [A, B, C], env_file: .env}}\n")
    _composed()


def _file(name: str, *use: Callable[[], object]) -> Callable[[Path, bytes], None]:
    """Return what writes the text to a file of the folder, then does what is wanted with it, each."""

    def write(folder: Path, content: bytes) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
        for one in use:
            try:
                one()
            except SrprovError as error:
                assert error.exit_code in (4, 5, 6, 7, 8, 9), error.exit_code
                assert len(error.message) < 200_000

    return write


def _named() -> None:
    named_instance("experiment.edf")


def _loaded() -> None:
    definitions = load_experiment("experiment.edf", {"HOME": "/root"})
    for one in definitions.containers.values():
        if not one.image:
            plan_image(one, disk.listing, disk.read)


def _rendered() -> None:
    playbooks = load_experiment("experiment.edf", {}).experiment.playbooks
    context = {"host": "r1", "services": [{"name": "a"}], "robot": {"arch": "amd64"}, "folder": "/var/lib/srprov/a"}
    render_texts([(one, context) for one in playbooks])


def _inventory(name: str) -> Callable[[], object]:
    def use() -> None:
        inventory = load_inventory([name])
        for pattern in ("all", "@limit", "r*:!r1", "robots[0]"):
            select(inventory, pattern)

    return use


def _plan() -> None:
    found = read_source("plan.json")
    if isinstance(found, PlanFile):
        for text in (
            plan_text(found.plan, commands=True),
            plan_markdown(found.plan),
            json.dumps(plan_json(found.plan)),
        ):
            assert isinstance(text, str)
        dump(found)


def _facts() -> None:
    try:
        document = parse_json(Path("facts.json").read_text(encoding="utf-8"))
    except ValueError:
        return  # the verb says so
    snapshot = read_document(document)
    check_ranges(document["robots"])
    assert isinstance(facts_table(snapshot.facts, snapshot.unreachable), str)


def _engine(_folder: Path, content: bytes) -> None:
    said = content.decode("utf-8", "replace")
    for module in MODULES.values():
        with contextlib.suppress(TooManyError):  # that robot's failure
            module.parse([Reply(status=200, out=said)] * len(module.queries()))
    real = replies(COMPUTER)
    for index in range(len(real)):
        answers = [replace(one, out=said) if index == at else one for at, one in enumerate(real)]
        parse_host(Host(name="r1", address="r1"), answers, None)


def _keys() -> None:
    host_keys.known_keys(["keys"], "r1", "10.0.0.1")


def _ssh() -> None:
    text = Path("ssh_config").read_bytes().decode("utf-8", "replace")
    # with Include or Match OpenSSH itself reads it, and a `Match exec` of a fuzzer's is not for this machine
    if not ssh_config.needs_openssh(text, Path("ssh_config")):
        ssh_config.lookup("r1", "10.0.0.1", {}, Path("ssh_config"))


def _configured() -> None:
    default_map(_VERBS, Path(), {"HOME": os.getcwd()})


def _policy() -> None:
    os.chmod("policy.yml", 0o600)
    labpolicy.load("policy.yml", KINDS)


def _locked() -> None:
    read_source("experiment.edf")


def _tree(_folder: Path, content: bytes) -> None:
    with contextlib.suppress(GitError):
        links = {one.path: content for one in entries(content.replace(b"\n", b"\0"), 1 << 20) if one.is_link}
        check_links(links)


def _journal(_folder: Path, content: bytes) -> None:
    Path("journal.jsonl").write_bytes(content)
    with contextlib.suppress(UsageError):
        for event in read_journal(Path())[0]:
            assert isinstance(event["event"], str)


class _Robot:
    """A robot whose shells give one content."""

    host = "robot1"

    def __init__(self, content: bytes) -> None:
        self.left = [(content, b"")] * bool(content) + [(b"", b"srprov-end 0\n")]

    def do(self, work: Callable[[Any], Any]) -> Any:
        return work(self)

    def open_shell(self, _script: str) -> Any:
        return self

    def read(self) -> tuple[bytes, bytes]:
        return self.left.pop(0) if self.left else (b"", b"")

    @property
    def ended(self) -> bool:
        return not self.left

    def close(self) -> None:
        pass


def _listed(_folder: Path, content: bytes) -> None:
    with contextlib.suppress(CollectFailed):
        for entries in listings(_Robot(content), [Place(root="/v", path=".")]):
            assert all(one.path for one in entries or ())


def _collected(_folder: Path, content: bytes) -> None:
    """Bring a tar as a robot might send it, into a folder of its own."""
    home = Path(tempfile.mkdtemp(dir="."))
    (home / "decoy").write_text("mine")
    listed = [Entry(f"a/{'x' * 120}", "f", 3, hashlib.sha256(b"abc").hexdigest()), Entry("b", "l", link="/etc/passwd")]
    bringing = Bringing(_Robot(content), Place(root="/v", path="."), home / "in", Home(home / "parts"))
    with contextlib.suppress(CollectFailed):
        for one in bringing.once(listed):
            assert not one.name or (home / "in" / one.name).read_text() == "abc"
    assert {one.name for one in home.iterdir()} <= {"in", "parts", "decoy"}
    shutil.rmtree(home)


def _trial(_folder: Path, content: bytes) -> None:
    text = content.decode("utf-8", "replace")
    inspected = json_or_none(text)
    read_container(inspected)
    place_of(inspected, "/out/a")
    from_json(text, "/State/ExitCode")


def _tar() -> str:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:", format=tarfile.PAX_FORMAT) as tar:
        for name, kind in (("./a", tarfile.DIRTYPE), ("./a/" + "x" * 120, tarfile.REGTYPE), ("./l", tarfile.SYMTYPE)):
            member = tarfile.TarInfo(name)
            member.type, member.linkname = kind, "/etc/passwd" if kind == tarfile.SYMTYPE else ""
            member.size = 3 if kind == tarfile.REGTYPE else 0
            tar.addfile(member, io.BytesIO(b"abc"))
    return stream.getvalue().decode("latin-1")


def _env(_folder: Path, content: bytes) -> None:
    parse_env(content.decode("utf-8", "replace"), "a.env", {})


def _plan_text() -> str:
    world = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", depends_on={"a": "started"}, command=("x",)))
    planned = made(world, Definitions(experiment=what, containers={}), AS_IT_IS)
    return dump(plan_file(replace(planned, definitions=None)))


def _facts_text() -> str:
    return json.dumps(facts_document({"r1": robot("r1", load1=1.0), "r2": robot("r2")}, {"r3": "away"}))


def surfaces(kept: Path) -> Mapping[str, Surface]:
    """Return every surface by name; `kept` is a folder where `Kept.make` put a run and its bundle."""
    edfs = tuple((EXAMPLES / name / "experiment.edf").read_text() for name in ("hello", "chatter-ros", "race"))
    cdf = (EXAMPLES / "chatter-ros" / "ros.cdf").read_text()
    edf = _file("experiment.edf", lambda: _checked("experiment.edf"), _named, _loaded)
    result = f"runs/{RECORD}/result.json"
    whole = (lambda: _checked("experiment.edf"), _loaded)

    def recorded() -> None:
        last_run(Path("runs"), "hello")

    return {
        "edf": Surface((EDF, *edfs), edf),
        "cdf": Surface((CDF, cdf), _file("talker.cdf", lambda: _checked("talker.cdf"), *whole)),
        "base": Surface((BASE,), _file("base.cdf", *whole)),
        "dockerfile": Surface((DOCKERFILE,), _file("built/Dockerfile", lambda: _checked("built/Dockerfile"), *whole)),
        "dockerignore": Surface((IGNORE,), _file("built/.dockerignore", *whole)),
        "env_file": Surface((ENV,), _file("talker.env", *whole)),
        "compose": Surface(COMPOSE, _file("compose.yml", _composed)),
        "compose_env": Surface((ENV.replace("HOME\n", ""),), _file(".env", _composed_with_env)),
        "env": Surface((ENV,), _env),
        "playbook": Surface((PLAYBOOK,), _file("p.yml", lambda: _checked("experiment.edf"), _rendered)),
        "inventory": Surface((INVENTORY,), _file("i.yml", lambda: _checked("i.yml"), _inventory("i.yml"))),
        "ini": Surface((INI,), _file("hosts", lambda: _checked("hosts"), _inventory("hosts"))),
        "limit": Surface(("r1\n# a\nrobots\n",), _file("limit", _inventory("i.yml"))),
        "plan": Surface((_plan_text(),), _file("plan.json", _plan)),
        "result": Surface((RESULT,), _file(result, recorded)),
        "events": Surface((EVENTS,), _file(f"runs/{RECORD}/events.jsonl", recorded)),
        "history": Surface((ASSIGNED,), _file("h/1/assignment.json", lambda: read_history(Path("h")))),
        "facts": Surface(
            (json.dumps(facts_document({"r1": robot("r1", load1=1.0), "r2": robot("r2")}, {"r3": "away"})),),
            _file("facts.json", _facts),
        ),
        "engine": Surface(tuple(one.out for one in replies(COMPUTER) if one.out), _engine),
        "known_hosts": Surface((KEYS,), _file("keys", _keys)),
        "ssh_config": Surface((SSH,), _file("ssh_config", _ssh)),
        "srprov.toml": Surface((CONFIG,), _file("srprov.toml", _configured)),
        "pyproject": Surface((CONFIG,), _file("pyproject.toml", _configured)),
        "own configuration": Surface((CONFIG,), _file(".config/srprov/srprov.toml", _configured)),
        "lock": Surface((LOCK,), _file("experiment.lock", lambda: _checked("experiment.edf"), _locked)),
        "git tree": Surface((TREE,), _tree),
        "journal": Surface((JOURNAL,), _journal),
        "result tar": Surface((_tar(),), _collected),
        "result listing": Surface((LISTING,), _listed),
        "container": Surface((CONTAINER,), _trial),
        "policy": Surface((POLICY,), _file("policy.yml", _policy)),
        **{name: Surface((text,), use) for name, (text, use) in foreign(kept).items()},
        **{name: Surface(texts, use) for name, (texts, use) in answers().items()},
    }


def prepare(folder: Path) -> None:
    """Write a whole experiment with all that it may name; what was there goes."""
    for one in folder.iterdir():
        shutil.rmtree(one) if one.is_dir() and not one.is_symlink() else one.unlink()
    (folder / "config").mkdir()
    (folder / "config" / "a.yaml").write_text("a: 1\n")
    (folder / "built").mkdir()
    (folder / "built" / "Dockerfile").write_text(DOCKERFILE)
    (folder / "built" / "abcd").write_text("x")
    (folder / "talker.py").write_text("print('hello')\n")
    (folder / "talker.env").write_text(ENV)
    (folder / "talker.cdf").write_text(CDF)
    (folder / "base.cdf").write_text(BASE)
    (folder / "p.yml").write_text(PLAYBOOK)
    built = "  built: {cdf: built/Dockerfile}\n"
    own = f"playbooks: {{before: [p.yml]}}\n{EDF.replace('services:', f'services:{chr(10)}{built}'.rstrip(), 1)}"
    (folder / "experiment.edf").write_text(own)
    (folder / "i.yml").write_text(INVENTORY)
    (folder / "limit").write_text("robot1\n")
