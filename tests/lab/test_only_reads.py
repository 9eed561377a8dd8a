"""Whoever plans only reads: every byte that reaches a robot's shell and its engine is written down there, and judged.

The robot's root gets a login shell that keeps a copy of its command line and input before a real one sees them. Before
the engine's socket stands one of the test's: it hears whatever way srprov comes, by a stream of sshd or the docker CLI.
`tests/readonly.py` is the judge; tests/unit/test_readonly.py shows what it sees.
"""

from __future__ import annotations

import base64
import contextlib
import os
import shutil
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from srprov.lab import state
from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.readonly import commands, engine_requests, engine_violations, shell_violations

pytestmark = pytest.mark.lab

ROBOT = "robot9"
LISTENER = """\
#!/bin/sh
# Written by a test: the login shell of root, which writes down what it is told.
[ "$1" = -c ] || exec /bin/sh "$@"
printf '%s' "$2" >/var/log/told/$$.command
tee /var/log/told/$$.input | /bin/sh -c "$2"
"""
SET_UP = """\
mkdir -p /var/log/told
printf %s "$0" | base64 -d >/usr/local/bin/listener
chmod 755 /usr/local/bin/listener
cp -p /etc/passwd /etc/passwd.before
sed -i 's|^\\(root:.*\\):[^:]*$|\\1:/usr/local/bin/listener|' /etc/passwd
grep ^root: /etc/passwd
"""
CODE = """\
git init -q /root/code && cd /root/code && echo 1 >a && git add a && git -c user.name=a -c user.email=a@b.c commit -qm 1
git remote add origin https://h.example/code.git && git update-ref refs/remotes/origin/main HEAD && echo 2 >a
"""
TAKE_DOWN = "mv /etc/passwd.before /etc/passwd; rm -rf /var/log/told /usr/local/bin/listener"


@dataclass
class Told:
    """What a robot was told since the last look."""

    command_lines: list[str] = field(default_factory=list)
    shell: list[bytes] = field(default_factory=list)
    engine: list[bytes] = field(default_factory=list)

    def violations(self) -> list[str]:
        """Give everything that does not only read."""
        lines = [found for line in self.command_lines for found in shell_violations(line)]
        typed = [found for text in self.shell for found in shell_violations(text.decode("utf-8", "surrogateescape"))]
        return lines + typed + [found for sent in self.engine for found in engine_violations(sent)]


class Tap:
    """A socket in the place of the engine's, which hands everything on and keeps what clients say, per connection."""

    def __init__(self, lab: Lab, robot: str) -> None:
        booted = state.read_robot(lab.site, robot)
        assert booted is not None
        # a socket is found by its file, whatever namespace that is looked at from
        self.place = Path(f"/proc/{booted.init.pid}/root/run/docker.sock")
        self.real = self.place.with_name("docker.sock.real")
        self.place.rename(self.real)
        self.said: list[bytearray] = []
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(self.place))
        os.chown(self.place, 0, self.real.stat().st_gid)
        self.place.chmod(0o660)
        self.listener.listen(64)
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):  # closed: the test is over
            while True:
                client, _ = self.listener.accept()
                engine = socket.socket(socket.AF_UNIX)
                engine.connect(str(self.real))
                said = bytearray()
                self.said.append(said)
                threading.Thread(target=self._pump, args=(client, engine, said), daemon=True).start()
                threading.Thread(target=self._pump, args=(engine, client, bytearray()), daemon=True).start()

    def _pump(self, source: socket.socket, target: socket.socket, said: bytearray) -> None:
        with contextlib.suppress(OSError):
            while piece := source.recv(65536):
                said += piece
                target.sendall(piece)
        with contextlib.suppress(OSError):
            target.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        self.listener.close()
        self.real.rename(self.place)


class Listening:
    """The lab with a robot that writes down what it is told."""

    def __init__(self, lab: Lab, inventory: str, tap: Tap) -> None:
        self.lab, self.inventory, self.tap = lab, inventory, tap

    def told(self) -> Told:
        """Give what was written down, and begin anew."""
        show = "echo $(base64 -w0 $f.command) $(base64 -w0 $f.input) && rm $f.command $f.input"
        script = f"cd /var/log/told && for f in *.command; do f=${{f%.command}}; [ ! -e $f.input ] || {show}; done; :"
        heard = Told()
        for line in self.lab.shell(ROBOT, "sh", "-c", script).out.splitlines():
            command, _, sent = (base64.b64decode(part) for part in (line.partition(" ")))
            heard.command_lines.append(command.decode())
            if b"dial-stdio" not in command:  # else the engine heard it
                heard.shell.append(sent)
        heard.engine, self.tap.said = [bytes(said) for said in self.tap.said if said], []
        return heard


@pytest.fixture
def listening(lab: Lab, tmp_path: Path) -> Iterator[Listening]:
    """Give root of one robot the listening shell, and its own one back afterwards."""
    done = lab.shell(ROBOT, "sh", "-c", SET_UP, base64.b64encode(LISTENER.encode()).decode())
    assert done.out.strip().endswith(":/usr/local/bin/listener"), done
    tap = Tap(lab, ROBOT)
    try:
        yield Listening(lab, part_of_lab(lab, [ROBOT], tmp_path / "lab.yml"), tap)
    finally:
        tap.close()
        lab.shell(ROBOT, "sh", "-c", TAKE_DOWN)


def test_what_plans_only_reads_and_what_applies_does_not(listening: Listening, tmp_path: Path) -> None:
    """All verbs that look, on a bare robot and on one with the experiment; and the judge sees what `apply` does."""
    lab, inventory = listening.lab, listening.inventory
    path = tmp_path / "read.edf"
    one = busybox("sh", "-c", "echo up; exec sleep 86400", environment={"WORD": "it's $(reboot)"}, volumes=["log:/log"])
    for folder, text in (("conf", "a"), ("conf2", "b")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "app.yml").write_text(text)
    one["volumes"] += ["./conf:/conf", "./conf/app.yml:/app.yml"]
    path.write_text(edf("read", {"one": one}), encoding="utf-8")
    mounts = ["log:/log", "./conf2:/conf", "./conf2/app.yml:/app.yml"]
    changed = {**one, "volumes": mounts, "environment": {"WORD": "other"}}
    path.with_name("changed.edf").write_text(edf("read", {"one": changed}), encoding="utf-8")
    path.with_name("other.edf").write_text(edf("other", {"one": one}), encoding="utf-8")
    looks = [
        ("validate", str(path)),
        ("facts", "-i", inventory),
        ("doctor", "-i", inventory),
        ("assign", str(path), "-i", inventory, "--explain"),
        ("export", "compose", str(path), "-i", inventory, "-o", str(tmp_path / "exported")),
        ("plan", str(path), "-i", inventory, "-v"),
        ("plan", str(path), "-i", inventory, "--format", "markdown"),
        ("plan", str(path), "-i", inventory, "-o", str(tmp_path / "plan.json"), "--reassign"),
        ("lock", str(path.with_name("other.edf")), "-i", inventory, "--update", "busybox"),
        ("status", str(path), "-i", inventory),
        ("status", str(path), "-i", inventory, "--volumes"),
        ("images", "-i", inventory),
        ("locks", "-i", inventory),
    ]

    def look(*more: tuple[str, ...]) -> None:
        since = lab.shell(ROBOT, "date", "+%s.%N").out.strip()
        for verb in (*looks, *more):
            listening.told()  # the test's own looks
            shutil.rmtree(tmp_path / "exported", ignore_errors=True)
            done = lab.srprov(*verb)
            assert done.code == 0, done
            heard = listening.told()
            assert heard.violations() == [], verb
            if verb[0] == "snapshot":
                assert any(b"setpriv" in text and b"git" in text for text in heard.shell)
            if verb[0] == "validate":
                assert not heard.command_lines
                continue
            words = {words[0].text for text in heard.shell for words in commands(text.decode())}
            assert {"eval", "printf"} <= words or verb[0] == "images", verb  # which asks the engine alone
            if verb[0] != "locks":
                requests = [path for sent in heard.engine for _, path in engine_requests(sent)]
                pinged = any(path.endswith("/_ping") for path in requests)
                assert pinged or verb[0] in ("images", "snapshot"), (verb, requests)
                assert any("/containers/json" in path for path in requests) or verb[0] == "logs", (verb, requests)
        until = lab.shell(ROBOT, "date", "+%s.%N").out.strip()
        events = lab.shell(ROBOT, "docker", "events", "--since", since, "--until", until).out.splitlines()
        assert events == []

    lab.shell(ROBOT, "sh", "-c", CODE)  # for `snapshot`, which asks repositories
    try:
        look(("snapshot", ROBOT, "-i", inventory, "-o", str(tmp_path / "taken")))
    finally:
        lab.shell(ROBOT, "rm", "-rf", "/root/code")

    listening.told()
    applied = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
    assert applied.code == 0, applied
    heard = listening.told()
    acts = heard.violations()
    assert any(b"ip -batch" in text and b"link add srp" in text for text in heard.shell), acts
    assert any(act.startswith("mkdir -p /var/lib/srprov/read") for act in acts), acts
    assert any(act.startswith("POST ") and "/containers/create" in act for act in acts), acts

    listening.told()
    probed = lab.srprov("probe", str(path), "-i", inventory)
    assert probed.code == 0, probed
    heard = listening.told()
    own = (
        "/.probe.",
        "-name .probe.* ",
        "/proc/self/fd/8 ",
        "mkdir -p /var/lib/srprov",
        "base64 -d",
        "gzip -dc",
        "command exec",
    )
    acts = heard.violations()
    assert acts and [act for act in acts if not any(word in act for word in own)] == []
    assert ".probe." not in lab.shell(ROBOT, "ls", "-A", "/var/lib/srprov").out

    lab.shell(ROBOT, "docker", "stop", "srprov.read.one")  # so that a plan has something to say
    look(
        ("plan", str(path.with_name("changed.edf")), "-i", inventory, "--adopt"),
        ("logs", str(path), "-i", inventory),
        ("wait", str(path), "-i", inventory, "--until", "log:one=^up$", "--wait-timeout", "60"),
    )

    listening.told()
    assert lab.srprov("destroy", str(path), "-i", inventory, "--yes").code == 0
    acts = listening.told().violations()
    assert any(act.startswith("DELETE ") for act in acts) and any(act.startswith("rm -rf ") for act in acts), acts
