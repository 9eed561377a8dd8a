"""Robots in memory: what modules ask is answered as a real robot answers, what they command is really done.

`FakeRobot` implements `session.Session`, so the modules' own queries, parsers, scripts and engine bodies are what is
tested. A `World` holds several robots and one log of everything that was asked and done, in order; it also notes when a
service runs twice. Faults are injected by number: "the third command on this robot fails". Whatever the fake does not
know raises.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.other_names import USED
from srprov.errors import TransportError
from srprov.facts.probes import PROBES
from srprov.modules import MODULES
from srprov.modules.container_leftover import end_process
from srprov.modules.mount_place import LEADS_TO
from srprov.secret import Vault
from srprov.session import Measures, Progress, Pulse, Traffic, no_progress
from srprov.wire import AnyQuery, Command, CopyImage, CopyVolume, EngineCall, EngineQuery, Put, Query, Reply, Run
from tests.fake_engine import Behaviour, Container, Engine
from tests.fake_kernel import Disk, Kernel, shell_reply

__all__ = ["Behaviour", "Entry", "FakeRobot", "Fault", "World"]

_WHERE = re.compile(r"newline='\n'\nnumber=-1\nfor s in (.*); do")
_THERE = re.compile(r"\[ -e (\S+) \] \|\| echo ([0-9]+)")
_LEADS = re.compile(r"(?m)^r=\$\((?:readlink -f|leads_to) \S+\) && printf \"%s %s\\n\" ([0-9]+)")
_AS_PLANNED = re.compile(r"(?m)^as_planned (\S+) (\S+)\n")
_FILL = re.compile(r"to=\$\(docker volume .* (\S+)\) && tar -xf (\S+) .*--strip-components=1")
_TAKE_PLACE = re.compile(r"from=\$\(docker volume .* (\S+)\) && to=\$\(docker volume .* (\S+)\) && sync")
_EMPTIED = re.compile(
    r"\[ -d /var/lib/docker/\S+ \] \|\| \{ echo [^\n]* exit 50; \}; "
    r"\[ ! -d /var/lib/docker/(?:volumes/([^/\s]+)/_data|overlay2/[0-9a-f]{64}/diff) ] \|\| "
)
_TOLD = re.compile(r"docker (volume|container) inspect --format .* -- (\S+)\Z", re.DOTALL)
_HAVING = re.compile(r"ids=\$\(docker ps -aq --no-trunc --filter volume=(\S+)\) && .*", re.DOTALL)
_FILLED = re.compile(
    r"from=/var/lib/docker/volumes/(\S+)/_data to=/var/lib/docker/volumes/(\S+)/_data; (?:mv -T|chown)"
)
_IS_EMPTY = re.compile(r"\[ ! -d /var/lib/docker/volumes/(\S+)/_data \] \|\| echo ([0-9]+) ")
_LOGS = re.compile(r"docker logs --tail (\d+) (\S+) 2>&1")


@dataclass(frozen=True)
class Entry:
    """One thing that happened, for the log of a world."""

    host: str
    kind: str
    """`ask`, `command`, `done` (a command that succeeded), or `started` (a container's process)"""
    what: AnyQuery | Command | str
    seen: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """For `started`: robot/container -> (state with exit code, health) at that moment."""


@dataclass
class Fault:
    """What goes wrong with the n-th command (from 1)."""

    at: int
    how: str = "refuse"
    """`refuse`: nothing is done; `half`: a script stops in its middle; `lost` and `lost-after`: the robot is gone."""


@dataclass
class World:
    """Several robots and one log."""

    robots: dict[str, FakeRobot] = field(default_factory=dict)
    log: list[Entry] = field(default_factory=list)
    doubles: list[str] = field(default_factory=list)
    """Services that ran on two robots at once."""
    early: list[str] = field(default_factory=list)
    """Containers that started before their robot was joined to the overlay."""
    lock: threading.RLock = field(default_factory=threading.RLock)
    fault: Fault | None = None
    """Counted over all robots."""
    commands: int = 0
    vault: Vault = field(default_factory=Vault)
    """Values for the placeholders of secrets."""

    def add(self, *names: str, **options: Any) -> World:
        """Add robots; the n-th one has the address 10.0.0.n."""
        for name in names:
            address = options.get("address", f"10.0.0.{len(self.robots) + 1}")
            self.robots[name] = FakeRobot(name, self, **{**options, "address": address})
        return self

    def reader(self, name: str) -> FakeRobot:
        """Return a connection to a robot, as `Readers` wants it.

        Raises:
            TransportError: It is gone.
        """
        robot = self.robots[name]
        robot.check()
        return robot

    def sessions(self) -> dict[str, FakeRobot]:
        """Return the robots that can be reached."""
        return {name: robot for name, robot in self.robots.items() if not robot.gone}

    def done(self) -> list[Entry]:
        """Return the commands that were sent."""
        return [entry for entry in self.log if entry.kind == "command"]

    def running(self) -> list[tuple[str, str]]:
        """Return (service, host) of every running container."""
        return sorted(
            (c.service, h) for h, r in self.robots.items() for c in r.engine.containers.values() if c.state == "running"
        )

    def state(self) -> dict[str, Any]:
        """Return everything that robots hold, comparable."""
        return {name: robot.state() for name, robot in sorted(self.robots.items())}

    def note_start(self, host: str, container: Container) -> None:
        """Log the start of a process with all that could be seen of others then; note doubles."""
        seen = {
            f"{name}/{one.name}": (f"{one.state} {one.code}", robot.engine.health(one))
            for name, robot in self.robots.items()
            for one in robot.engine.containers.values()
        }
        links = [link for link in self.robots[host].kernel.links.values() if link.kind == "vxlan" and link.master]
        if "NetworkingConfig" in container.body and not links:
            self.early.append(f"{host}/{container.name} before its link")
        self.log.append(Entry(host, "started", container.name, seen))
        for other, robot in self.robots.items():
            twin = robot.engine.containers.get(container.name)
            if other != host and twin is not None and twin.state == "running":
                self.doubles.append(container.name)


class FakeLockChannel:
    """The lock's script on a fake robot: whoever is in `robot.holder` has the lock."""

    def __init__(self, robot: FakeRobot, claim: str) -> None:
        self.robot, self.claim = robot, claim
        self.first_answer = self.send("t")

    def send(self, letter: str) -> str:
        """Answer one letter."""
        with self.robot.world.lock:
            self.robot.check()
            mine = self.robot.holder is self
            if letter == "t" and (mine or self.robot.holder is None):
                self.robot.holder = self
                return "locked"
            if letter == "f" and mine:
                self.robot.holder = None
            if letter != "t" or self.robot.holder is None:
                return {"f": "free", "t": "busy"}.get(letter, letter)
            told = json.dumps({**json.loads(self.robot.holder.claim), "since": "2026-11-21T02:00:00Z"})
            return f"busy 2026-11-21T02:03:00Z {told}"

    def close(self) -> None:
        """Let go."""
        if self.robot.holder is self:
            self.robot.holder = None
            self.robot.released_while_busy |= self.robot.busy


class FakeRobot:
    """One robot. `engine`, `kernel` and `disk` can be looked at and changed by a test at any time."""

    def __init__(
        self,
        host: str,
        world: World | None = None,
        *,
        address: str = "10.0.0.1",
        api: str = "1.41",
        arch: str = "x86_64",
    ) -> None:
        self._host = host
        self.world = world or World()
        self.arch = arch
        self.kernel = Kernel(address)
        self.disk = Disk()
        self.engine = Engine(
            host=host,
            exists=self.disk.exists,
            add_bridge=self.kernel.add_bridge,
            del_bridge=self.kernel.del_bridge,
            started=lambda container: self.world.note_start(host, container),
            api=api,
        )
        self.fault: Fault | None = None
        self.commands = 0
        self.listening: list[str] = []
        """Lines of `ss`."""
        self.mounts = ""
        """Lines of its /proc/self/mountinfo."""
        self.used = ""
        """Its users' homes, and its disks in files, a line each."""
        self.leads = ""
        """Where it says that a link at every mounted path leads."""
        self.spelled = ""
        """Lines of its hosts file and of its users, as grep prints them."""
        self.gone = False
        self.holder: FakeLockChannel | None = None
        self.busy = False
        """A command is being done."""
        self.released_while_busy = False
        """Its lock was given back in the middle of a command."""
        self.before_command: Callable[[Command], None] = lambda _command: None
        self._traffic = Traffic(connections=1)

    @property
    def host(self) -> str:
        """The robot's name."""
        return self._host

    @property
    def identity(self) -> str:
        """Its name, and a key."""
        return f"{self._host} key"

    @property
    def traffic(self) -> Traffic:
        """What was used so far."""
        return self._traffic

    def measure(self) -> Measures | None:
        """Nothing without a shell."""
        return None

    def close(self) -> None:
        """End the connection: the robot ends what runs there and frees its lock."""
        self.gone, self.holder = True, None

    def open_lock_channel(self, script: str, words: Sequence[str], pulse: Pulse) -> FakeLockChannel:
        """Play the lock's script."""
        with self.world.lock:
            self.check()
            self._traffic.round_trips += 1
            return FakeLockChannel(self, words[0])

    def save_image(self, image: str, timeout_s: float) -> Iterator[bytes]:
        """Return an image as one piece."""
        yield image.encode()

    def container_log(
        self, container: str, *, tail: int, follow: bool, times: bool = False, since: str = ""
    ) -> Iterator[str]:
        """Return what the behaviour says."""
        one = self.engine.containers[container]
        yield from self.engine.behaviours.get(one.service, Behaviour()).log.splitlines()

    def check(self) -> None:
        """Raise TransportError when the robot is gone."""
        if self.gone:
            raise TransportError(self._host, "the connection was lost", hint="is the robot up?", code=Code.LOST)

    def state(self) -> dict[str, Any]:
        """Return all that it holds, without what differs from run to run."""
        return {
            "containers": {n: (c.state, c.code, c.body) for n, c in sorted(self.engine.containers.items())},
            "networks": dict(sorted(self.engine.networks.items())),
            "volumes": dict(sorted(self.engine.volumes.items())),
            "data": dict(sorted(self.engine.data.items())),
            "links": {n: vars(link).copy() for n, link in sorted(self.kernel.links.items())},
            "fdb": sorted(self.kernel.fdb),
            "filters": dict(sorted(self.kernel.filters.items())),
            "files": dict(sorted(self.disk.files.items())),
            "modes": dict(sorted(self.disk.modes.items())),
            "trees": dict(sorted(self.disk.trees.items())),
            "marks": sorted(self.disk.marks),
        }

    # -- the session ---------------------------------------------------------------------------------------------------

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        """Answer questions, one round trip."""
        with self.world.lock:
            self.check()
            self._traffic.round_trips += 1
            self.world.log += [Entry(self._host, "ask", query) for query in queries]
            return [self.engine.query(q) if isinstance(q, EngineQuery) else self._answer(q) for q in queries]

    def _answer(self, query: Query) -> Reply:
        command = query.command
        if match := _LOGS.fullmatch(command):
            one = self.engine.containers.get(match[2])
            text = self.engine.behaviours.get(one.service, Behaviour()).log if one else ""
            return shell_reply("" if one else f"Error: No such container: {match[2]}", text)
        if match := _TOLD.match(command):
            return self.engine.told(match[1], match[2])
        if match := _HAVING.fullmatch(command):
            return self.engine.having(match[1])
        if asked := _IS_EMPTY.findall(command):
            return Reply(status=0, out="".join(f"{n} {self.engine.data.get(name, '')[:1]}\n" for name, n in asked))
        if command.startswith("ss "):
            return Reply(status=0, out="".join(f"{line}\n" for line in self.listening))
        if asked := _THERE.findall(command):
            led = "".join(f"{n} {self.leads}\n" for _, n in asked) if self.leads else ""
            return Reply(status=0, out=led + "".join(f"{n}\n" for path, n in asked if not self.disk.exists(path)))
        if command == f"{LEADS_TO}\n:":
            return Reply(status=0)
        if asked := _LEADS.findall(command):
            return Reply(status=0, out="".join(f"{number} {self.leads}\n" for number in asked))
        if (content := self.disk.contents(command)) is not None:
            return Reply(status=0, out=content)
        if command == ":":
            return Reply(status=0)
        if command.startswith('grep -oE \'"source":'):
            return Reply(status=0, out=self.disk.maker(command))
        if command == USED.command:
            return Reply(status=0, out=self.used)
        if command == "cat /proc/self/mountinfo":
            return Reply(status=0, out=self.mounts)
        if command.startswith("first="):
            return Reply(status=0, out="")
        if match := _WHERE.match(command):  # tests/unit/controller/test_writers.py has it run
            return Reply(status=0, out="".join(f"{n} {path}\n" for n, path in enumerate(shlex.split(match[1]))))
        if command.startswith("timeout -k 2 10 sh -c "):
            words = shlex.split(command)
            return Reply(status=0, out=f"{self.disk.command(words[4 : words.index('</dev/null')])}\n")
        answers = {
            **{q.command: "" for module in MODULES.values() for q in module.queries() if isinstance(q, Query)},
            **{probe.command: self._probe(probe.name) for probe in PROBES},
            MODULES["file"].queries()[0].command: self.disk.hashes(),  # type: ignore[union-attr]
            MODULES["tree"].queries()[0].command: self.disk.list_trees(),  # type: ignore[union-attr]
            MODULES["secret"].queries()[0].command: self.disk.secrets(),  # type: ignore[union-attr]
            MODULES["vxlan"].queries()[1].command: self.kernel.show_fdb(),  # type: ignore[union-attr]
            MODULES["vxlan_filter"].queries()[0].command: self.kernel.show_filters(),  # type: ignore[union-attr]
        }
        assert command in answers, f"the fake robot knows no {command!r}"
        return Reply(status=0, out=answers[command])

    def _probe(self, name: str) -> str:
        here = f"connection 10.0.0.254 50000 {self.kernel.address} 22"
        routes = '[{"dst":"default","gateway":"10.0.0.254","dev":"eth0"},{"dst":"10.0.0.0/24","dev":"eth0"}]'
        return {
            "identity": f"clock {time.time():.9f}\nmachine {self.arch}\nbits 64\nid uid=0(root) gid=0(root)\n{here}\n",
            "files": (
                "/proc/loadavg:0.00 0.00 0.00 1/100 1000\n/proc/meminfo:MemTotal:       4000000 kB\n"
                "/proc/meminfo:MemAvailable:   4000000 kB\n/proc/sys/kernel/hostname:" + self._host + "\n"
                "/proc/uptime:5000.25 9000.00\n/proc/sys/kernel/osrelease:6.1.0-18-amd64\n"
                "/sys/class/net/eth0/speed:1000\n" + self.spelled + self.disk.records()
            ),
            "cpus": "4\n",
            "links": self.kernel.show_addresses(),
            "routes": routes,
            "disk": "Filesystem 1024-blocks Used Available Capacity Mounted on\n/dev/sda1 30000000 100 29999900 1% /\n",
        }.get(name, "")

    def execute(self, command: Command, progress: Progress = no_progress) -> Reply:
        """Do one thing."""
        self.busy = True
        try:
            return self._execute(command)
        finally:
            self.busy = False

    def _execute(self, command: Command) -> Reply:
        self.before_command(command)
        with self.world.lock:
            self.check()
            self.commands += 1
            self.world.commands += 1
            self._traffic.round_trips += 1
            self.world.log.append(Entry(self._host, "command", command))
            how = self._how()
            if how == "lost":
                self.gone = True
                self.check()
            if how == "refuse":
                return Reply(status=500, ok=False, err="injected failure")
            reply = self._do(command, half=how == "half")
            if how == "lost-after":
                self.gone = True
                self.check()
            if reply.ok:
                self.world.log.append(Entry(self._host, "done", command))
            return reply

    def execute_all(self, commands: Sequence[Run | Put]) -> Sequence[Reply]:
        """Do several things."""
        return [self.execute(one) for one in commands]

    def _how(self) -> str:
        for fault, count in ((self.fault, self.commands), (self.world.fault, self.world.commands)):
            if fault is not None and fault.at == count:
                return fault.how
        return ""

    def _do(self, command: Command, *, half: bool) -> Reply:
        if isinstance(command, EngineCall):
            reply = self.engine.call(command)
        elif isinstance(command, Put):
            if command.secret:
                command = replace(command, content=self.world.vault.content(command.secret), secret="")
            if half:
                self.disk.files[command.path + ".part"] = command.content[: len(command.content) // 2]
                return shell_reply("injected failure")
            self.disk.put(command)
            reply = shell_reply("")
        elif isinstance(command, CopyImage) and not command.source_host:  # from the cache of this machine
            self.engine.images[command.image] = {}
            reply = shell_reply("")
        elif isinstance(command, CopyImage):
            source = self.world.robots[command.source_host]
            there = command.image in source.engine.images
            if there:
                self.engine.images[command.image] = {}
            reply = shell_reply("" if there else f"{source.host}: its engine cannot give {command.image}")
        elif isinstance(command, CopyVolume):
            giver, there = self.world.robots[command.source_host].engine, command.into in self.engine.volumes
            data = giver.data.get(command.volume, "")
            assert not any(c.state == "running" and command.volume in str(c.body) for c in giver.containers.values())
            self.engine.data[command.into] = data[: len(data) // 2] if half else data
            reply = shell_reply("" if there and command.volume in giver.volumes else "no such volume")
        else:
            reply = self._script(command, half)
        return shell_reply("injected failure") if half and reply.ok else reply

    def _script(self, run: Run, half: bool) -> Reply:
        if run.script.startswith(LEADS_TO):  # tests/unit/modules/test_mount_place.py has it run by real shells
            planned = _AS_PLANNED.findall(run.script)
            if moved := [path for path, real in planned if (self.leads or path) != real]:
                return shell_reply(f"{moved[0]} leads to {self.leads or moved[0]}")
            run = replace(run, script=run.script[max(m.end() for m in _AS_PLANNED.finditer(run.script)) :])
        if (run,) == end_process(run.script.partition(" -id ")[2][:12]):
            return shell_reply("")  # a container in memory has no process that its engine could forget
        if run.script.startswith("for p in /proc/"):
            return shell_reply("injected failure" if half else "")  # no process outlives its container here
        if run.script.startswith("docker stop "):
            for name in re.findall(r"srprov\.\S+", run.script)[: 1 if half else None]:
                self.engine.call(EngineCall(method="POST", path=f"/containers/{name}/stop"))
            return shell_reply("")
        if run.script.startswith(
            "leads_to_no_engine() {"
        ):  # tests/unit/modules/test_mount_kind.py has it run by real shells
            return Reply(status=0)
        if match := _FILL.match(run.script):
            if not half:
                self.engine.data[match[1]] = hashlib.sha256(self.disk.files.pop(match[2])).hexdigest()
            return shell_reply("injected failure" if half else "")
        if _FILLED.match(run.script):  # tests/unit/execution/test_unfilled.py has it run by a real shell
            return shell_reply("injected failure" if half else "")  # images of the fake robot have nothing for volumes
        if match := _EMPTIED.match(run.script):  # tests/unit/execution/test_emptied.py has it run by a real shell
            if match[1] and not half:
                self.engine.data.pop(match[1], None)
            return shell_reply("injected failure" if half else "")
        if match := _TAKE_PLACE.match(run.script):
            return shell_reply("injected failure" if half else self.engine.rename_data(match[1], match[2]))
        if self.kernel.filter(run.script):
            return shell_reply("")
        said = self.disk.run(run.script)
        if said is not None:
            return shell_reply(said)
        lines = self.kernel.calls(run.script)
        for line in lines[: len(lines) // 2 + 1] if half else lines:
            if complaint := self.kernel.run(line):
                return shell_reply(complaint)
        return shell_reply("")
