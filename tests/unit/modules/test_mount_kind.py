"""Links of a robot that lead to what is graver to mount than it looks, in a real shell of this machine."""

from __future__ import annotations

import socket
import subprocess
from pathlib import Path

import pytest

from srprov.definitions.containermodel import Mount
from srprov.modules.mount_kind import GRAVE, links_refused, mount_kind
from srprov.wire import Run, quote
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service

SHELLS = (("sh", "-c"), ("busybox", "sh", "-c"))


def tried(shell: tuple[str, ...], *paths: Path) -> tuple[int, str]:
    try:
        done = subprocess.run([*shell, links_refused(map(str, paths))], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip(f"there is no {shell[0]} here")
    return done.returncode, done.stderr


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize(
    "target",
    [
        *("/var/run/docker.sock", "/run/docker.sock", "/", "/run", "/var", "/var/lib", "/var/lib/docker", "/run/user"),
        *("/var/lib/srprov", "../../../../../../../../../../../../run", "/proc/1", "loop"),
    ],
)
def test_a_link_to_the_engine_is_not_mounted(tmp_path: Path, shell: tuple[str, ...], target: str) -> None:
    (tmp_path / "loop").symlink_to(target)
    (tmp_path / "on").symlink_to("loop")
    for path in (tmp_path / "loop", tmp_path / "on", tmp_path / "on" / ""):
        code, said = tried(shell, path)
        assert code == 1 and str(path) in said, said


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_what_is_not_there_counts_as_what_is_there_of_it(tmp_path: Path, shell: tuple[str, ...]) -> None:
    (tmp_path / "root").symlink_to("/")
    assert tried(shell, tmp_path / "root/run/docker/plugins/none")[0] == 1
    assert tried(shell, tmp_path / "root/var/lib/srprov/none")[0] == 1
    assert tried(shell, tmp_path / "none/below", Path("/not-there/at/all"), Path("/var/lib/not-there")) == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_other_links_are_mounted_as_ever(tmp_path: Path, shell: tuple[str, ...]) -> None:
    (tmp_path / "it's").mkdir()
    (tmp_path / "maps").symlink_to("it's")
    (tmp_path / "zone").symlink_to("/etc/hostname")
    assert tried(shell, tmp_path / "maps", tmp_path / "maps/none", tmp_path / "it's", tmp_path / "zone") == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize("told", ["data-root", "no last newline", "two lines", "graph", "hosts", "containerd", "link"])
def test_an_engine_s_folder_is_where_it_really_is(tmp_path: Path, shell: tuple[str, ...], told: str) -> None:
    """Robots keep images on another disk: by a configuration, or by a link in the place of /var/lib/docker."""
    engine, beside = tmp_path / "ssd/docker", tmp_path / "ssd/maps"
    for one in (engine / "volumes", beside):
        one.mkdir(parents=True)
    (tmp_path / "engine").symlink_to(engine)
    files = {
        "data-root": ("docker/daemon.json", f'{{\n "data-root": "{engine}"\n}}\n'),
        "no last newline": ("docker/daemon.json", f'{{"log-level": "warn", "data-root":"{engine}"}}'),
        "two lines": ("docker/daemon.json", f'{{"data-root":\n\n  "{engine}"}}\n'),
        "graph": ("docker/daemon.json", f'{{"graph": "{engine}"}}\n'),
        "hosts": ("docker/daemon.json", f'{{"hosts": ["fd://", "unix://{engine}"]}}\n'),
        "containerd": ("containerd/config.toml", f'version = 2\nroot = "{engine}"\n'),
    }
    name, text = files.get(told, ("docker/daemon.json", "{}\n"))
    (tmp_path / name).parent.mkdir()
    (tmp_path / name).write_text(text)
    link = str(tmp_path / "engine") if told == "link" else "/none"

    def tried_there(path: Path) -> tuple[int, str]:
        script = links_refused([str(path)]).replace(f"/etc/{name}", str(tmp_path / name))
        script = script.replace(" /var/lib/docker ", f" {link} ")
        done = subprocess.run([*shell, script], capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    for path in (engine, engine / "volumes", engine / "none", tmp_path / "ssd", tmp_path / "engine"):
        code, said = tried_there(path)
        assert code == 1 and f"lies in {engine}" in said, (path, said)
    assert tried_there(beside) == tried_there(tmp_path / "ssd/docker-files") == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize("words", ["--data-root NAME", "--data-root=NAME", "-g NAME", "-H fd:// -H unix://NAME"])
def test_an_engine_s_folder_is_where_its_words_say(tmp_path: Path, shell: tuple[str, ...], words: str) -> None:
    """As a unit of systemd starts it, with nothing in its file."""
    engine = tmp_path / "ssd/docker"
    engine.mkdir(parents=True)
    program = tmp_path / "dockerd"
    program.write_text("#!/bin/sh\necho\nread x\n")
    program.chmod(0o755)
    command = [program, *words.replace("NAME", str(engine)).split()]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        assert running.stdout is not None and running.stdout.readline() == b"\n"
        code, said = tried(shell, tmp_path / "ssd")
        running.communicate(b"\n")
    assert code == 1 and f"lies in {engine}" in said, said
    assert tried(shell, tmp_path / "ssd") == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_an_engine_s_socket_is_where_it_listens(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """A unit of systemd may have opened it elsewhere, and the engine was told `-H fd://`."""
    place = tmp_path / "odd place/engine.sock"
    place.parent.mkdir()
    program = tmp_path / "dockerd"
    program.symlink_to("/bin/sleep")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(place))
        listening.listen()
        with subprocess.Popen([program, "60"], pass_fds=[listening.fileno()]) as running:
            try:
                said = [tried(shell, path) for path in (place, place.parent, tmp_path)]
                beside = tried(shell, tmp_path / "maps")
            finally:
                running.kill()
    assert all(code == 1 and f"lies in {place}" in why for code, why in said), said
    assert beside == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_an_engine_s_folder_is_known_in_the_layers_of_an_overlay(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """Robots whose disk is read-only show one beside memory (overlayroot), and both by their own names, too."""
    for one in ("disk", "shown"):
        (tmp_path / one).mkdir()

    def tried_there(path: str) -> tuple[int, str]:
        mounts = (
            f"cd {tmp_path} && mount -t tmpfs tmpfs disk && cd disk && mkdir -p low/lib/docker low/maps up work && "
            f"mount -t overlay overlay -o lowerdir={tmp_path}/disk/low,upperdir={tmp_path}/disk/up,workdir=work "
            "../shown && mkdir -p ../shown/lib/docker/volumes || exit 9"
        )
        script = links_refused([f"{tmp_path}/{path}"]).replace(" /var/lib/docker ", f" {tmp_path}/shown/lib/docker ")
        words = ["unshare", "-m", *shell, f"{mounts}\n{script}"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    for path in (
        "disk",
        "disk/up",
        "disk/up/lib/docker/volumes",
        "disk/up/lib/docker/none",
        "disk/low/lib",
        "shown/lib",
    ):
        code, said = tried_there(path)
        assert code == 1 and path in said, (path, said)
    for path in ("disk/low/maps", "shown/maps", "disk/work", "disk/up/none"):
        assert tried_there(path) == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_what_is_mounted_twice_is_what_it_is_by_both_names(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """An engine's folder is another disk's, mounted where engines look for it: what holds it there has another name."""
    engine, disk = tmp_path / "lib/docker", tmp_path / "a disk"
    for one in (engine, disk / "docker/volumes", disk / "maps", tmp_path / "jail/proc", tmp_path / "jail/maps"):
        one.mkdir(parents=True)

    def tried_there(path: Path) -> tuple[int, str]:
        mounts = f"mount --bind {quote(f'{disk}/docker')} {engine} && mount -t proc proc {tmp_path}/jail/proc || exit 9"
        script = links_refused([str(path)]).replace(" /var/lib/docker ", f" {engine} ")
        words = ["unshare", "-m", *shell, f"{mounts}\n{script}"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    for path in (
        disk,
        disk / "docker",
        disk / "docker/volumes",
        disk / "docker/none",
        engine.parent,
        tmp_path / "jail",
    ):
        code, said = tried_there(path)
        assert code == 1 and str(path) in said, (path, said)
    for path in (disk / "maps", disk / "maps/none", disk / "docker-files", tmp_path / "jail/maps"):
        assert tried_there(path) == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_what_a_later_mount_hides_counts_for_nothing(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """It is still listed, and has the longer name: what holds an engine's folder seemed to be on another disk."""
    for one in ("mnt/ssd", "disk/ssd/docker", "disk/ssd/maps", "lib/docker"):
        (tmp_path / one).mkdir(parents=True)

    def tried_there(path: str) -> int:
        mounts = "mount -t tmpfs tmpfs mnt/ssd && mkdir mnt/ssd/maps && mount --bind disk mnt"
        mounts = f"cd {tmp_path} && {mounts} && mount --bind disk/ssd/docker lib/docker || exit 9"
        script = links_refused([f"{tmp_path}/{path}"]).replace(" /var/lib/docker ", f" {tmp_path}/lib/docker ")
        words = ["unshare", "-m", *shell, f"{mounts}\n{script}"]
        return subprocess.run(words, capture_output=True, check=False).returncode

    assert [tried_there(one) for one in ("mnt", "mnt/ssd", "disk", "mnt/ssd/maps", "disk/ssd/maps")] == [1, 1, 1, 0, 0]


@pytest.mark.parametrize(
    "path",
    [
        *("/run/crio/crio.sock", "/run/k3s", "/var/run/balena-engine.sock", "/var/snap/docker/common", "/var/snap"),
        *("/run/snapd.socket", "/var/lib/rancher/k3s", "/run/lxd/unix.socket", "/run/cri-dockerd.sock"),
        *("/var/lib/incus/unix.socket", "/run/incus", "/run/k0s/containerd.sock", "/var/lib/k0s", "/var/snap/microk8s"),
    ],
)
def test_other_engines_give_the_robot_away_too(path: str) -> None:
    assert mount_kind(path)[0] == GRAVE


def test_what_does_as_root_tells_it_is_said_to_do_so() -> None:
    """It is mounted by many for names and devices; a container of root's may have it start anything."""
    for path in ("/run/dbus", "/var/run/dbus/system_bus_socket", "/run/systemd/private", "/run//systemd/"):
        kind, why = mount_kind(path)
        assert kind == "host-path" and "as root" in why
    assert mount_kind("/srv/dbus") == ("host-path", "")


@pytest.mark.parametrize(
    "path",
    [
        *("/run/udev", "/var/run/udev/rules.d", "/run//cdi/", "/var/spool", "/run/wireguard", "/etc/cron.d", "/sys"),
        *("/opt/ros/humble", "/usr/local/bin", "/home", "/home/lab", "/home/lab/.ssh", "/home/lab/x/.profile"),
        *("/var/tmp", "/srv2", "/database", "/lib/systemd", "/boot", "/dev/shm", "/never/heard/of"),
        *("/home/lab/bin", "/home/lab/maps", "/tmp/x", "/var/tmp/x/y", "/srv/robot/.ssh", "/data/.config/x"),
    ],
)
def test_where_root_may_take_what_it_runs_from_is_said(path: str) -> None:
    """`/run/udev` is mounted by many for cameras; udev starts what a rule there names, as root."""
    kind, why = mount_kind(path)
    assert kind == "host-path" and "root may run or believe" in why
    assert "written" not in mount_kind(path, read_only=True)[1]


@pytest.mark.parametrize(
    "path", ["/srv", "/srv/maps", "/mnt/ssd/bags", "/media/x", "/data", "/data/a b/c.d", "/mnt/two\nlines"]
)
@pytest.mark.parametrize("read_only", [False, True])
def test_where_data_are_nothing_is_said(path: str, *, read_only: bool) -> None:
    assert mount_kind(path, read_only=read_only) == ("host-path", "")


@pytest.mark.parametrize(
    "path",
    [
        *("/var/run/acpid.socket", "/tmp/tmux-0", "/tmp/tmux-1000/default", "/tmp", "/home/lab/.gnupg", "/root"),
        *("/root/.ssh", "/home/lab/.ssh/id_ed25519", "/etc", "/etc/ssh", "/etc/shadow", "/srv/robot/.ssh", "/never"),
        *("/usr", "/usr/local", "/usr/local/etc", "/usr/local/var/run", "/usr/local/vpn", "/usr/src", "/usr//local"),
    ],
)
def test_what_is_mounted_read_only_may_hold_keys_and_sockets(path: str) -> None:
    """`/tmp/tmux-0` holds the socket by which tmux takes keystrokes for root's shell, also where it is read-only."""
    kind, why = mount_kind(path, read_only=True)
    assert kind == "host-path" and "a key there" in why and "a socket there" in why


@pytest.mark.parametrize("path", ["/sys", "//sys/", "/sys/kernel", "/sys/kernel/debug/hid", "/sys/fs/pstore"])
def test_what_the_kernel_tells_root_alone_is_said(path: str) -> None:
    """debugfs, which systemd mounts below /sys on every robot, has keys of radios and events of keyboards."""
    kind, why = mount_kind(path, read_only=True)
    assert kind == "host-path" and "root alone" in why and "typed" in why


@pytest.mark.parametrize(
    "path",
    [
        *("/etc/localtime", "/usr/share/zoneinfo", "/lib/modules", "/sys/class/gpio", "/sys/devices"),
        "/opt/ros/humble",
        *("/usr/bin", "/usr/lib/x86_64-linux-gnu", "/usr/libexec/x", "/usr/local/lib", "/usr/local/cuda-12.2/lib64"),
    ],
)
def test_of_what_everybody_may_read_nothing_is_said(path: str) -> None:
    assert mount_kind(path, read_only=True) == ("host-path", "")


def test_what_is_grave_as_it_is_written_was_asked_for_as_that() -> None:
    assert links_refused(["/", "/var/run/docker.sock", "/proc"]) == ""
    assert mount_kind("/var/run/docker.sock")[0] == GRAVE


def test_a_container_is_made_only_after_its_paths_were_looked_at() -> None:
    """Also before a folder is made: `mkdir -p` follows links as the engine does."""
    mounts = (Mount(kind="bind", source="/srv/x", target="/x", create_host_path=True),)
    plan = plan_for(World().add("r1"), experiment(service("a", mounts=mounts)))
    (step,) = [step for step in plan.steps if step.module == "container"]
    first, second, *_ = step.commands
    assert isinstance(first, Run) and first.script == links_refused(["/srv/x"])
    assert second.text() == "mkdir -p -- /srv/x"


def test_a_container_that_has_ended_is_started_only_after_its_paths_were_looked_at() -> None:
    """The engine follows links again."""
    what = experiment(service("a", mounts=(Mount(kind="bind", source="/srv/x", target="/x"),)))
    world = World().add("r1")
    assert apply(world, what).exit_code == 0
    world.robots["r1"].engine.containers["srprov.hello.a"].state = "exited"
    (step,) = plan_for(world, what).steps
    assert [one.text() for one in step.commands[:1]] == [links_refused(["/srv/x"])]
