"""The lab's faults, each shown by means that know nothing of how it is made: sockets, ping, df, date, ssh."""

from __future__ import annotations

import re
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from typing import Any

import paramiko
import pytest

from srprov.lab.sites import find
from tests.lab.conftest import NAME, ROBOTS, Done, Lab
from tests.lab.looks import begin_on, wait_until

pytestmark = pytest.mark.lab

RTT_S, RATE_MBIT, LOSS, OFFSET_S = 0.2, 8, 0.2, -5400.5
SPEC = f"""\
robots:
  robot1: {{ssh_latency_ms: {RTT_S * 1000:g}}}
  robot2: {{rate_mbit: {RATE_MBIT}}}
  robot3: {{loss_percent: {LOSS * 100:g}}}
  robot4: {{disk_mib: 128}}
  robot5: {{docker_read_only: true, clock_offset_s: {OFFSET_S}}}
  robot6:
    sshd: {{max_startups: 3, max_sessions: 2}}
    sudo_password: open sesame
    bashrc: |
      echo welcome to this robot
  robot7: {{unprivileged: true}}
"""
PLAIN, PEER, THIRD = "robot8", "robot9", "robot10"


def address(robot: str) -> str:
    return str(find(NAME).address(robot))


@pytest.fixture(scope="module")
def faulty(lab_session: Lab, tmp_path_factory: pytest.TempPathFactory) -> Lab:
    """Give a lab whose first robots have faults; the other fixtures make them ordinary again."""
    path = tmp_path_factory.mktemp("faults") / "lab-spec.yml"
    path.write_text(SPEC, encoding="utf-8")
    do(lab_session, "up", "-n", str(ROBOTS), "--spec", str(path))
    return lab_session


@pytest.fixture
def whole(faulty: Lab) -> Iterator[Lab]:
    """Give the lab to a test that breaks it; `lab up` mends what such a test leaves."""
    yield faulty
    do(faulty, "up")
    assert not any(each["faults"] for name, each in seen(faulty).items() if name != "robot5")


def do(lab: Lab, *words: str) -> Done:
    done = lab.srprov("lab", *words)
    assert done.code == 0, done
    return done


def seen(lab: Lab) -> dict[str, Any]:
    found = do(lab, "status", "--json").json["robots"]
    assert isinstance(found, dict)
    return found


def ssh(robot: str, command: str, user: str = "root") -> subprocess.CompletedProcess[str]:
    """Run a command by OpenSSH's own client."""
    site = find(NAME)
    options = ["-i", str(site.key), "-o", f"UserKnownHostsFile={site.known_hosts}"]
    program = ["ssh", "-F", "none", "-o", "BatchMode=yes", *options, f"{user}@{address(robot)}", command]
    return subprocess.run(program, capture_output=True, text=True, timeout=100, stdin=subprocess.DEVNULL)


def dial(robot: str, timeout: float = 5.0) -> socket.socket:
    return socket.create_connection((address(robot), 22), timeout=timeout)


def reaches(lab: Lab, robot: str, target: str) -> bool:
    """Whether a TCP connection comes about from one robot to another's sshd within a second; it never is refused."""
    script = 'timeout 1 bash -c "exec 3<>/dev/tcp/$0/22" 2>&1'
    done = lab.shell(robot, "sh", "-c", script, address(target), check=False)
    assert done.code in (0, 124), done
    return done.code == 0


def test_a_partition_hangs_and_heals(whole: Lab) -> None:
    """What is connected neither breaks nor goes on, what connects gets no answer, and both go on when it is over."""
    with dial(PLAIN) as old:
        assert old.recv(4) == b"SSH-"
        for _ in range(2):
            do(whole, "partition", PLAIN)
        assert seen(whole)[PLAIN]["faults"] == ["cut off from all"]
        assert seen(whole)[PEER]["faults"] == []
        while old.recv(1) != b"\n":  # the rest of the greeting was here before
            pass
        old.sendall(b"SSH-2.0-test\r\n")
        old.settimeout(1.0)
        with pytest.raises(TimeoutError):
            old.recv(1)
        with pytest.raises(TimeoutError):
            dial(PLAIN, 1.0)
        assert not reaches(whole, PLAIN, PEER)
        assert not reaches(whole, PEER, PLAIN)
        assert reaches(whole, PEER, THIRD)
        for _ in range(2):
            do(whole, "heal", PLAIN)
        old.settimeout(10.0)
        assert len(old.recv(64)) == 64  # the key exchange, after the client's kernel has said it again
    assert reaches(whole, PLAIN, PEER)


def test_a_partition_between_two_leaves_the_others_alone(whole: Lab) -> None:
    do(whole, "partition", PLAIN, "--from", PEER)
    assert [seen(whole)[name]["faults"] for name in (PLAIN, PEER)] == [
        [f"cut off from {PEER}"],
        [f"cut off from {PLAIN}"],
    ]
    assert not reaches(whole, PLAIN, PEER)
    assert not reaches(whole, PEER, PLAIN)
    assert reaches(whole, PLAIN, THIRD)
    dial(PLAIN).close()
    do(whole, "heal", PEER, "--from", PLAIN)
    assert reaches(whole, PLAIN, PEER)


def test_only_the_controller_can_be_cut_off(whole: Lab) -> None:
    do(whole, "partition", PLAIN, "--from", "controller")
    with pytest.raises(TimeoutError):
        dial(PLAIN, 1.0)
    assert reaches(whole, PLAIN, PEER)
    assert seen(whole)[PLAIN]["state"] == "ready"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("partition", "robot99"), "the lab has no robot99"),
        (("partition", PLAIN, "--from", PLAIN), "cannot be cut off from itself"),
        (("heal", PLAIN, "--from", "robot99"), "the lab has no robot99"),
    ],
)
def test_a_partition_of_nobody_is_refused(faulty: Lab, words: tuple[str, ...], said: str) -> None:
    done = faulty.srprov("lab", *words)
    assert done.code == 5, done
    assert said in done.err


def test_ssh_is_late_by_the_round_trip(faulty: Lab) -> None:
    """The greeting comes after two round trips, as TCP has it, and each question costs one more."""
    begun = time.monotonic()
    with dial("robot1") as connection:
        assert connection.recv(4) == b"SSH-"
        greeted = time.monotonic()
        while connection.recv(1) != b"\n":
            pass
        connection.sendall(b"SSH-2.0-test\r\n")
        connection.recv(1)
        answered = time.monotonic()
    assert 1.9 * RTT_S < greeted - begun < 2 * RTT_S + 2
    assert 0.9 * RTT_S < answered - greeted < RTT_S + 2
    done = ssh("robot1", "echo $SSH_CONNECTION; head -c 3000000 /dev/zero | cksum; exit 7")
    assert done.returncode == 7, done
    assert done.stdout.split()[2] == address("robot1")


def transferred(lab: Lab, robot: str, script: str, act: Callable[[socket.socket], None]) -> float:
    """Give the seconds that a transfer takes between the controller and a script that connects to it."""
    controller = str(lab.site.controller)
    with socket.create_server((controller, 0)) as server:
        server.settimeout(10)
        far = f"exec 3<>/dev/tcp/{controller}/{server.getsockname()[1]}; {script}"
        command = begin_on(lab, robot, "bash", "-c", far)
        connection, _ = server.accept()
        with connection:
            connection.settimeout(20)
            begun = time.monotonic()
            act(connection)
            seconds = time.monotonic() - begun
        command.communicate(timeout=120)
    return seconds


@pytest.mark.soak
def test_the_rate_holds_both_ways(faulty: Lab) -> None:
    size = 1_000_000

    def receive(connection: socket.socket) -> None:
        while connection.recv(65536):
            pass

    def send(connection: socket.socket) -> None:
        connection.sendall(b"x" * size)
        connection.shutdown(socket.SHUT_WR)
        assert connection.recv(16).strip() == b"%d" % size

    for script, act in ((f"head -c {size} /dev/zero >&3; exec 3>&-", receive), ("wc -c <&3 >&3", send)):
        # the best of some: others may take the processors meanwhile
        rate = max(size * 8 / 1e6 / transferred(faulty, "robot2", script, act) for _ in range(3))
        assert RATE_MBIT / 4 < rate < RATE_MBIT * 2, f"{rate:.1f} Mbit/s for {script}"
        assert max(size * 8 / 1e6 / transferred(faulty, PLAIN, script, act) for _ in range(3)) > RATE_MBIT * 5


@pytest.mark.soak
def test_packets_are_lost_both_ways_and_nobody_is_told(faulty: Lab) -> None:
    """A ping needs both ways; the sender's own firewall would say `Operation not permitted`."""
    words = ("ping", "-q", "-c", "300", "-i", "0.005", "-W", "1")
    local = subprocess.run([*words, address("robot3")], capture_output=True, text=True)
    for out in (
        local.stdout + local.stderr,
        faulty.shell("robot3", *words, address(PEER), check=False).out,
        faulty.shell(PEER, *words, address("robot3"), check=False).out,
    ):
        lost = re.search(r"([0-9.]+)% packet loss", out)
        assert lost, out
        assert float(lost[1]) / 100 == pytest.approx(1 - (1 - LOSS) ** 2, abs=0.12)
        assert "not permitted" not in out
    assert seen(faulty)["robot3"]["state"] == "ready"


def test_the_docker_disk_is_small_and_fills_up(faulty: Lab) -> None:
    size = int(faulty.shell("robot4", "df", "-m", "--output=size", "/var/lib/docker").out.split()[-1])
    assert 100 <= size <= 128
    assert faulty.shell("robot4", "docker", "info", "--format", "{{.Driver}}").out.strip() == "overlay2"
    assert faulty.shell("robot4", "docker", "run", "--rm", "busybox", "echo", "fine").out.strip() == "fine"
    done = faulty.shell(
        "robot4", "docker", "pull", f"{faulty.site.controller}:5000/library/debian:bookworm", check=False
    )
    assert done.code != 0
    assert "no space left on device" in done.out + done.err


def test_a_read_only_docker_disk_fails_writes(faulty: Lab) -> None:
    assert faulty.shell("robot5", "docker", "ps").code == 0
    done = faulty.shell("robot5", "docker", "volume", "create", "vol", check=False)
    assert done.code != 0
    assert "read-only file system" in done.err
    assert seen(faulty)["robot5"]["faults"] == ["docker read-only"]


def test_the_clock_is_off_for_whoever_asks_date(faulty: Lab) -> None:
    assert float(ssh("robot5", "date +%s.%N").stdout) - time.time() == pytest.approx(OFFSET_S, abs=3)
    assert ssh("robot5", "date -u -d @0 +%Y").stdout == "1970\n"
    facts = faulty.srprov("facts", "-i", str(faulty.inventory), "--limit", "robot5", "--json")
    assert facts.code == 0, facts
    assert facts.json["robots"]["robot5"]["clock_offset_s"] == pytest.approx(OFFSET_S, abs=3)


def test_sshd_limits_startups_and_sessions(faulty: Lab) -> None:
    connections = [dial("robot6") for _ in range(5)]
    greetings = []
    for connection in connections:
        try:
            greetings.append(connection.recv(4))
        except ConnectionResetError:
            greetings.append(b"")
    for connection in connections:
        connection.close()
    assert greetings.count(b"SSH-") == 3, greetings

    wait_until(lambda: ssh("robot6", "true").returncode == 0, 5, "sshd has forgotten the connections")
    with paramiko.SSHClient() as client:
        client.load_host_keys(str(faulty.site.known_hosts))
        client.connect(address("robot6"), username="root", key_filename=str(faulty.site.key))
        transport = client.get_transport()
        assert transport is not None
        kept = [transport.open_session() for _ in range(2)]
        with pytest.raises(paramiko.ChannelException):
            transport.open_session()
        del kept


def test_sudo_wants_the_password_and_shells_are_noisy(faulty: Lab) -> None:
    assert ssh("robot6", "true").stdout == "welcome to this robot\n"
    assert ssh("robot6", "sudo -n true", user="robot").returncode == 1
    given = ssh("robot6", "echo wrong | sudo -S -p '' id -u", user="robot")
    assert given.returncode == 1
    given = ssh("robot6", "echo 'open sesame' | sudo -S -p '' id -u", user="robot")
    assert given.stdout == "welcome to this robot\n0\n", given
    assert ssh(PLAIN, "sudo -n id -u", user="robot").stdout == "0\n"


def test_an_unprivileged_robot_has_neither_root_nor_docker(faulty: Lab) -> None:
    assert ssh("robot7", "true").returncode == 255
    assert ssh("robot7", "docker ps || echo no; sudo -n true || echo no", user="robot").stdout == "no\nno\n"
    assert "ansible_user: robot" in faulty.inventory.read_text().partition("robot7:")[2].partition("robot8:")[0]


def dockerd(lab: Lab, robot: str) -> str:
    """The process ids of the robot's dockerd, by the robot's own /proc."""
    script = "for p in /proc/[0-9]*; do read -r n 2>/dev/null <$p/comm && [ $n = dockerd ] && echo $p; done; true"
    return lab.shell(robot, "sh", "-c", script).out


def test_a_crashed_engine_comes_back_and_a_stopped_one_does_not(whole: Lab) -> None:
    before = dockerd(whole, PLAIN)
    do(whole, "kill", PLAIN, "--docker")
    # gone, or on a slow machine here again already; until its parent has heard of it, /proc shows it
    wait_until(lambda: dockerd(whole, PLAIN) != before, 5, "the crashed engine is gone")
    wait_until(lambda: ssh(PLAIN, "docker ps").returncode == 0, 20, "the engine is back")
    assert dockerd(whole, PLAIN) not in ("", before)

    do(whole, "stop-docker", PLAIN)
    assert seen(whole)[PLAIN]["faults"] == ["docker stopped"]
    before = dockerd(whole, PEER)
    do(whole, "kill", PEER, "--docker")
    wait_until(lambda: dockerd(whole, PEER) not in ("", before), 20, "an engine that crashed later is back")
    assert dockerd(whole, PLAIN) == ""
    assert seen(whole)[PEER]["faults"] == []
    do(whole, "restart", PLAIN, "--docker")
    assert ssh(PLAIN, "docker ps").returncode == 0
    do(whole, "stop-docker", PLAIN)  # for `lab up` to mend
