"""What an experiment asks for beyond its own containers."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from srprov.definitions.containermodel import ContainerDefinition, Logging, Mount, Runtime
from srprov.definitions.model import NetworkSettings
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.planning.graver import EVERY_PROCESS, MAKES_LINKS, TOLD, WRITTEN
from srprov.planning.log_options import ANY_DRIVER, JOURNAL
from srprov.planning.policy import KINDS, permissions, refused
from srprov.planning.security_options import PROFILE
from tests.bounded import bounded
from tests.worlds import experiment, service

SOCKET = "/run/docker.sock"
ONLY = "read-only, but for what is mounted below it"
NETWORK = (
    "the robot's network (root's programs may do what they are told there: on the loopback, or by sockets that lie in"
    " no folder)"
)
SHARED = "root may believe what is written to its shared memory, or do what a socket in it is told"
READ = "a key there may let somebody in, and a socket there may do as root what it is told"
ROOT = "as good as root on the robot"
HOLDS = f"{ROOT}: holds the engine's socket"
KEPT = ("/run/docker", "/var/run/docker/plugins", "/var/lib/docker/volumes", "/var/lib/docker", "/var", "/var/lib",
        "/var/lib/../lib/containerd/", "/run/srprov", "/var/run/srprov/x", "/var/lib/srprov/x", "/var/lib/containers",
        "/run/user/1000/docker.sock", "/run/user")  # fmt: skip
ASKS: list[tuple[dict[str, Any], list[tuple[str, str]]]] = [
    ({}, []),
    ({"network": "none"}, []),
    ({"network": "host"}, [("host-network", NETWORK)]),
    ({"network": "both"}, [("host-network", NETWORK)]),
    ({"privileged": True}, [("privileged", f"all devices and capabilities of the robot ({ROOT})")]),
    ({"pid": "host"}, [("host-pid", f"pid: host ({EVERY_PROCESS})")]),
    ({"pid": "container:other"}, [("host-pid", f"pid: container:other ({EVERY_PROCESS})")]),
    ({"ipc": "host"}, [("host-ipc", f"ipc: host ({SHARED})")]),
    ({"ipc": "shareable"}, [("host-ipc", "ipc: shareable")]),
    ({"ipc": "private"}, []),
    ({"ipc": "none"}, []),
    ({"cap_add": ("SYS_ADMIN", "SYS_NICE")}, [("capability", f"SYS_ADMIN ({ROOT})"), ("capability", "SYS_NICE")]),
    ({"cap_add": ("NET_ADMIN",)}, [("capability", f"NET_ADMIN ({MAKES_LINKS})")]),
    ({"sysctls": {"net.x": "1"}}, [("sysctl", "net.x=1")]),
    ({"sysctls": {"vm.x": "1"}}, [("sysctl", f"vm.x=1 (may be {ROOT})")]),
    ({"security_opt": ("apparmor=unconfined",)}, [("security-opt", "apparmor=unconfined")]),
    ({"security_opt": ('seccomp={"syscalls":[]}',)}, [("security-opt", f'{PROFILE}: seccomp={{"syscalls":[]}}')]),
    ({"devices": (("/dev/video0", "/dev/b", "rwm"),)}, [("device", "/dev/video0 (rwm)")]),
    ({"device_cgroup_rules": ("c 81:* rmw",)}, [("device", "cgroup rule c 81:* rmw")]),
    ({"gpus": "all"}, [("gpu", "gpus: all")]),
    ({"mounts": (Mount(kind="bind", source="/srv", target="/r"),)}, [("host-path", f"/srv ({WRITTEN})")]),
    ({"mounts": (Mount(kind="bind", source="/a", target="/r", read_only=True),)},
     [("host-path", f"/a ({ONLY}; {READ})")]),
    ({"mounts": (Mount(kind="bind", source=SOCKET, target="/r"),)}, [("docker-socket", f"{SOCKET} ({ROOT})")]),
    ({"mounts": (Mount(kind="bind", source="/var" + SOCKET, target="/r"),)},
     [("docker-socket", f"/var{SOCKET} ({ROOT})")]),
    ({"mounts": (Mount(kind="volume", source="v", target="/v"), Mount(kind="tmpfs", source="", target="/t"))}, []),
    ({"mounts": (Mount(kind="tree", source="/e/www", target="/v"),)}, []),
    *[
        ({"mounts": (Mount(kind="bind", source=source, target="/r"),)}, [(kind, source + (f" ({why})" if why else ""))])
        for source, kind, why in (
            ("//var/run/docker.sock", "docker-socket", ROOT),
            ("/var/run/../run/docker.sock", "docker-socket", ROOT),
            ("/run/./docker.sock/", "docker-socket", ROOT),
            ("/", "docker-socket", HOLDS),
            ("/var/run", "docker-socket", HOLDS),
            ("/run/containerd", "docker-socket", HOLDS),
            ("/proc/1/root/run/x", "docker-socket", f"{ROOT}: leads to every file of the robot"),
            ("/run/docker.sock.d", "host-path", "root may run or believe what is written there"),
            *((path, "docker-socket", f"{ROOT}: what an engine or srprov keeps") for path in KEPT),
            *((path, "docker-socket", HOLDS) for path in ("/var/run/containerd", "//run/./podman")),
            ("/var/lib/dockers", "host-path", "root may run or believe what is written there"),
            ("/var/running", "host-path", "root may run or believe what is written there"),
        )
    ],
    ({"ulimits": (("rtprio", 0, 99), ("nofile", 1, 2), ("memlock", -1, -1))},
     [("realtime", "ulimit memlock=-1:-1"), ("realtime", "ulimit rtprio=0:99")]),
    ({"ports": (("", 80, 80, "tcp"), ("", 81, 81, "tcp"), ("", 53, 5353, "udp"), ("", 1024, 1, "tcp"))},
     [("low-port", "53/udp"), ("low-port", "80-81/tcp")]),
    ({"restart": "always"}, [("restart-always", "restart: always, also when the robot boots after the experiment")]),
    ({"restart": "unless-stopped"},
     [("restart-always", "restart: unless-stopped, also when the robot boots after the experiment")]),
    *[
        ({"restart": one}, [("restart-always", f"restart: {one}, also when the robot boots after the experiment")])
        for one in ("on-failure", "on-failure:3")
    ],
    ({"runtime": "crun"}, [("runtime", "runtime: crun, which starts its container instead of the engine's own")]),
    ({"oom_score_adj": -5}, [("realtime", "oom_score_adj: -5, when memory is short others are killed first")]),
    ({"logging": Logging(driver="gelf", options={"gelf-address": "udp://x:1"})},
     [("logging", "driver gelf: the engine sends what is printed wherever it is told (" + TOLD + ")"),
      ("logging", "option gelf-address=udp://x:1")]),
    ({"logging": Logging(driver="journald")},
     [("logging", "driver journald: the engine sends what is printed into the robot's own journal"
       f" ({JOURNAL})")]),
    ({"logging": Logging(driver="local", options={"fluentd-address": "x"})},
     [("logging", f"option fluentd-address=x (may be {ROOT})")]),
    *[({"logging": Logging(options={name: value})}, [("logging", f"option {name}={value} ({ANY_DRIVER})")])
      for name, value in [("fluentd-address", "x"), ("tag", "{{.Command}}"), ("env", "A"), ("labels", "a"),
                          ("max-size", "1k")]],
    *[({"logging": Logging(driver="json-file", options={name: value})}, [("logging", f"option {name}={value}")])
      for name, value in [("tag", '{{pad "x" 300000000000 0}}'), ("tag", "{{.Name}}{{.Name | printf}}"), ("tag", ""),
                          ("max-size", "10"), ("max-size", "63k"), ("max-size", "-1"), ("max-file", "2000000000"),
                          ("max-file", "101"), ("max-file", "0"), ("mode", "x"), ("labels-regex", "(a*)*"),
                          ("max-file", "2\n")]],
    *[({"logging": Logging(driver="json-file", options={name: value})}, [])
      for name, value in [("tag", "{{.ImageName}}/{{ .Name }}"), ("max-size", "64k"), ("max-size", "10MiB"),
                          ("max-size", "1000000"), ("max-file", "100"), ("compress", "true"), ("env", "A,B"),
                          ("labels", "org.x/y,z"), ("mode", "non-blocking")]],
    *[({"logging": Logging(driver=one, options={"max-size": "1m", "max-file": "2", "mode": "blocking"})}, [])
      for one in ("", "json-file", "local", "none")],
    ({"oom_score_adj": 5, "labels": {"a": "b"}, "hostname": "h", "extra_hosts": (("x", "host-gateway"),), "init": True,
      "read_only": True, "cap_drop": ("ALL",), "cpuset": "0", "mem_reservation": 1, "stdin_open": True}, []),
    ({"restart": "no", "tty": True, "shm_size": 1, "ports": (("", 8080, 80, "tcp"),), "user": "0"}, []),
]  # fmt: skip


OWN_PROCESS = frozenset(
    ("command", "entrypoint", "environment", "working_dir", "group_add", "stop_signal", "stop_grace_s", "healthcheck",
     "expose", "cpus", "mem_limit", "pids_limit", "pull_policy", "job")
)  # fmt: skip
"""Fields that say what a container's own process is, and how much of the robot it has at most; of no value is asked."""


def test_of_every_field_of_a_container_it_is_known_whether_it_is_asked_for() -> None:
    """A new one stands in the table above, or is one of a container's own process."""
    told = {name for fields, _ in ASKS for name in fields} - {"network"}
    assert told | OWN_PROCESS == set(Runtime.__struct_fields__)
    assert not told & OWN_PROCESS


@pytest.mark.parametrize(("fields", "asked"), ASKS)
def test_what_is_asked(fields: dict[str, Any], asked: list[tuple[str, str]]) -> None:
    """Each thing that reaches the robot itself is one permission, and an ordinary container asks for none."""
    found = permissions(experiment(service("a", **fields)))
    assert [(one.kind, one.what) for one in found] == asked
    assert all(one.service == "a" for one in found)


def bind(source: str, *, read_only: bool = False) -> Mount:
    return Mount(kind="bind", source=source, target=f"/in{source.strip('~')}", read_only=read_only)


@pytest.mark.parametrize(
    ("first", "second", "grave"),
    [
        (bind("/srv/data"), bind("/srv/data/log"), True),
        (bind("/srv/data"), bind("//srv/./data/a/../b/c", read_only=True), True),
        (bind("/srv/data/"), bind("/srv/data/log"), True),
        (bind("/run/x"), bind("/var/run/x/y"), True),
        (bind("~robot/ws"), bind("~robot/ws/log"), True),
        (bind("/srv/data", read_only=True), bind("/srv/data/log"), False),
        (bind("/srv/data"), bind("/srv/data", read_only=True), False),
        (bind("/srv/data"), bind("/srv/data2"), False),
        (bind("/srv/data/log"), bind("/srv/data", read_only=True), False),
        (bind("/srv/data"), bind("/srv/data-2/x"), False),
    ],
)
@pytest.mark.parametrize("together", [True, False])
def test_what_lies_below_a_folder_that_a_container_writes_to_is_whatever_that_wants(
    first: Mount, second: Mount, grave: bool, together: bool
) -> None:
    """It puts a link to the engine's socket there, and the engine follows it for who mounts that path."""
    one = service("a", mounts=(first, second) if together else (first,))
    asked = permissions(experiment(one, service("b", mounts=() if together else (second,))))
    kinds = {what.what.partition(" (")[0]: what.kind for what in asked}
    assert kinds[first.source] == "host-path"
    assert kinds[second.source] == ("docker-socket" if grave else "host-path")
    assert any("a link there leads anywhere" in what.what for what in asked) == grave


@pytest.mark.parametrize(
    ("ipc", "source", "kind"),
    [
        ("host", "/dev/shm/x", "docker-socket"),
        ("host", "/dev//shm/./x/y", "docker-socket"),
        ("host", "/dev/shm", "host-path"),
        ("host", "/dev/shmem/x", "host-path"),
        ("private", "/dev/shm/x", "host-path"),
    ],
)
def test_a_container_in_the_robot_s_ipc_namespace_writes_to_its_shared_memory(ipc: str, source: str, kind: str) -> None:
    """It has the robot's /dev/shm without a mount, and puts links there as into any folder."""
    asked = permissions(experiment(service("a", ipc=ipc), service("b", mounts=(bind(source),))))
    assert [one.kind for one in asked if one.service == "b"] == [kind]


def test_thousands_of_paths_are_compared_in_time() -> None:
    """As many, and as deep, as the files of an experiment can hold."""
    many = tuple(bind(f"/srv/{number}") for number in range(20_000))
    deep = (bind("/a" * 400_000), bind("/a" * 200_000))
    what = experiment(service("a", mounts=(*many, *deep)))
    kinds = bounded(lambda: [one.kind for one in permissions(what)])
    assert kinds.count("docker-socket") == 1


DISKS = (
    *("sda", "sda1", "vdb", "nvme0", "nvme0n1", "nvme0n1p2", "mmcblk0", "mmcblk0p1", "mmcblk0boot0", "dm-0", "sg1"),
    *("mapper/root", "disk/by-id/x", "block/8:0", "./sda", "md127", "md/0", "mtd0", "mtdblock0", "loop0p1"),
    *("mem", "uinput", "vfio/12", "uhid", "hidraw0", "usbmon1", "tty1", "console", "ng0n1", "bus/usb/001/002", "input"),
    *("input/event3", "lidar", "vcio", "vchiq", "pts/0", "ttyS0", "ttyAMA0", "serial0", "kmsg", "cpu/0/msr", "tpmrm0"),
    *("i2c-1", "spidev0.0", "gpiochip0", "gpiomem", "gpiomem0", "ptp0"),
    *("pmem0", "dasda", "bcache0", "uio0", "char/1:1", "snd\n", "video0/x", "net/x"),
)
PARTS_OF_ROBOTS = ("ttyUSB0", "video0", "snd", "dri/renderD128", "input/js0", "snd/pcmC0D0p", "media0")


@pytest.mark.parametrize(
    "run",
    [
        {"pid": "host"},
        {"cap_add": ("BPF",)},
        {"cap_add": ("OF_ANOTHER_KERNEL",)},
        {"cap_add": ("CAP_DAC_READ_SEARCH",)},
        {"cap_add": ("ALL",)},
        *({"devices": ((f"/dev/{name}", "/dev/x", "r"),)} for name in DISKS),
        *({"device_cgroup_rules": (rule,)} for rule in ("a *:* rwm", "b 8:0 rw", "c *:* r", "c 21:* rw", "c 10:223 w")),
        *({"device_cgroup_rules": (rule,)} for rule in ("c 010:223 w", "c 01:1 r", "c 0021:* rw", "c 13:* w")),
        *(
            {"device_cgroup_rules": (rule,)}
            for rule in ("c 4:1 r", "c 89:1 rw", "c 153:0 rw", "c 204:64 r", "c 189:* rw", "c 241:0 rw", "c 0:0 r")
        ),
    ],
)
def test_what_is_as_good_as_root_is_said(run: dict[str, Any]) -> None:
    """A container may be any user of the robot, and reads the files of whoever has no more capabilities than it has."""
    (asked,) = permissions(experiment(service("a", **run)))
    assert asked.kind not in ("privileged", "docker-socket") and "as good as root" in asked.what


@pytest.mark.parametrize(
    "run",
    [
        {"cap_add": ("SYS_NICE", "IPC_LOCK")},
        *({"devices": ((f"/dev/{name}", "/dev/x", "rwm"),)} for name in PARTS_OF_ROBOTS),
        {"device_cgroup_rules": ("c 81:* rmw", "c 188:* rw", "c 0226:1 r")},
    ],
)
def test_what_robots_are_made_of_is_not_called_root(run: dict[str, Any]) -> None:
    assert not any("root" in one.what for one in permissions(experiment(service("a", **run))))


def test_a_device_in_a_folder_that_a_container_writes_to_may_be_any() -> None:
    """Containers may make devices; which one it is, the engine looks up when it starts the other container."""
    writer = service("a", mounts=(bind("/srv/data"),))
    asked = permissions(experiment(writer, service("b", devices=(("/srv/data/x/tty", "/dev/tty9", "rw"),))))
    assert [one.kind for one in asked] == ["privileged", "host-path"]
    asked = permissions(experiment(writer, service("b", devices=(("/dev/ttyUSB0", "/dev/tty9", "rw"),))))
    assert [one.kind for one in asked] == ["host-path", "device"]


@pytest.mark.parametrize(
    "path",
    [
        "/var/lib/docker/volumes/srprov.hello.v/_data/tty",
        "/dev/../proc/1/root/dev/sda",
        "/dev/shm/tty",
        "/dev/./shm/",
        "/dev/fd/../root/srv/data/tty",
        "/dev/fd/7",
        "/dev/disk/../sda",
    ],
)
def test_a_device_elsewhere_than_below_dev_may_be_any(path: str) -> None:
    """So a container makes one in a volume of its own; and a plan file says which path that is."""
    (asked,) = permissions(experiment(service("a", devices=((path, "/dev/tty9", "rw"),))))
    assert asked.kind == "privileged" and "it may be any device" in asked.what


def test_every_kind_is_asked_by_something() -> None:
    """The list of kinds that a user can allow holds nothing that is never asked."""
    of_images = {"fetch", "built-image", "engine-fetch"}
    assert {kind for _, asked in ASKS for kind, _ in asked} | of_images | {
        "unit",
        *("secret", "secret-command"),
        "playbook",
        "env",
        "outside",
        "git",
    } == set(KINDS)


@pytest.mark.parametrize(
    ("network", "asked"),
    [
        (NetworkSettings(), []),
        (NetworkSettings(subnet="10.200.0.0/20", port=4790), []),
        (NetworkSettings(subnet="10.200.0.0/29", port=1024), []),
        (NetworkSettings(subnet="192.168.50.0/28"), [("host-network", "network.subnet")]),
        (NetworkSettings(subnet="10.77.0.0/24"), [("host-network", "network.subnet")]),
        (NetworkSettings(subnet="10.200.0.0/19"), [("host-network", "network.subnet")]),
        (NetworkSettings(subnet="10.0.0.0/8"), [("host-network", "network.subnet")]),
        (NetworkSettings(vni=0x100000), []),
        (NetworkSettings(vni=4097), [("host-network", "network.vni")]),
        (NetworkSettings(port=123), [("low-port", "network.port")]),
        (NetworkSettings(persist=True), [("unit", "network.persist")]),
    ],
)
def test_an_overlay_asks_for_what_it_takes_from_the_robots_own_network(
    network: NetworkSettings, asked: list[tuple[str, str]]
) -> None:
    """The kernel sends packets to such a subnet into the overlay, whoever has the addresses in the lab's network."""
    found = permissions(replace(experiment(service("a")), network=network))
    assert [(one.kind, one.service) for one in found] == asked
    said = {"host-network": network.subnet or str(network.vni), "low-port": str(network.port), "unit": "as root"}
    assert all(said[one.kind] in one.what for one in found)


IMAGES: list[tuple[str, str]] = [
    ("busybox", ""),
    ("registry.lab:5000/srprov/x:1", ""),
    ("srprov/camera:0123456789abcdef", "built-image"),
    ("docker.io/srprov/camera:0123456789abcdef", "built-image"),
    ("index.docker.io/srprov/camera", "built-image"),
    ("sha256:" + "a" * 64, "built-image"),
    ("0123456789ab", "built-image"),
    ("$BASE", "built-image"),
]


@pytest.mark.parametrize(("name", "kind"), IMAGES)
def test_an_image_that_may_be_of_another_experiment_is_asked_for(name: str, kind: str) -> None:
    """By the name that srprov gives what it builds, by an id, or by what only the builder can read."""
    cdf = ContainerDefinition(name="x", file="/e/x.cdf", folder="/e", images=(name,))
    user = replace(service("a"), image="", cdf="/e/x.cdf")
    found = permissions(experiment(user), {"/e/x.cdf": cdf})
    assert [one.kind for one in found] == ([kind] if kind else [])
    if not name.startswith(("sha256", "$")):
        direct = permissions(experiment(replace(service("a"), image=name)))
        assert [one.kind for one in direct] == ([kind] if kind else [])


def test_what_the_engine_fetches_for_a_build_is_asked_for() -> None:
    """It does so itself, from the robot's own network: not what a container of the build could reach."""
    cdf = ContainerDefinition(name="x", file="/e/x.cdf", folder="/e", fetches=("http://127.0.0.1:2375/info /x",))
    user = replace(service("a"), image="", cdf="/e/x.cdf")
    (found,) = permissions(experiment(user), {"/e/x.cdf": cdf})
    assert (found.kind, found.service) == ("engine-fetch", "a")
    assert "http://127.0.0.1:2375/info" in found.what


@pytest.mark.parametrize(
    "image",
    [
        *("127.0.0.1:9998/a/b:now", "[::1]:80/a/b", "localhost/a", "robot2:5000/a", "127.1:80/a", "2130706433:80/a"),
        *("metadata.google.internal/a", "Printer.LOCAL/a"),
        *("x.corp:5000/a", "x.home/a", "x.intranet/a", "x.private/a", "x.test/a", "x.mail/a", "x.onion/a", "x.alt/a"),
        *("1.0.0.127.in-addr.arpa/a", "x.invalid/a"),
    ],
)
def test_a_registry_that_only_the_robot_knows_is_asked_for(image: str) -> None:
    """Its engine would ask its own loopback, or whoever has that name there."""
    cdf = ContainerDefinition(name="x", file="/e/x.cdf", folder="/e", images=(image,))
    user = replace(service("a"), image="", cdf="/e/x.cdf")
    for found in (
        permissions(experiment(user), {"/e/x.cdf": cdf}),
        permissions(experiment(replace(service("a"), image=image))),
    ):
        assert [(one.kind, one.what.partition(": ")[0]) for one in found] == [("engine-fetch", image)]


@pytest.mark.parametrize("image", ["ros:humble", "a/b", "ghcr.io/a/b:1", "registry.lab.example:5000/team/image"])
def test_a_public_registry_is_not_asked_for(image: str) -> None:
    assert permissions(experiment(replace(service("a"), image=image))) == ()


def test_reading_a_secret_of_the_controller_is_asked() -> None:
    """Whoever writes an EDF could name any variable, file or program: each service that gets one asks for it."""
    use = SecretUse(source="token", target="/run/secrets/token")
    found = permissions(
        experiment(
            replace(service("a"), secrets=(use,)),
            secrets={"token": SecretSource(name="token", env="HOME")},
        )
    )
    assert [(one.kind, one.service, one.what) for one in found] == [("secret", "a", "token, from the variable HOME")]


def test_permissions_are_sorted_by_gravity_then_service() -> None:
    """The order is that of the kinds, then of services, whatever the order in the file."""
    found = permissions(
        experiment(service("b", gpus="all", privileged=True), service("a", network="host", privileged=True))
    )
    assert [(one.kind, one.service) for one in found] == [
        ("privileged", "a"),
        ("privileged", "b"),
        ("host-network", "a"),
        ("gpu", "b"),
    ]


@pytest.mark.parametrize(
    ("allowed", "left"),
    [
        ((), ["privileged", "host-network"]),
        (("privileged",), ["host-network"]),
        (("all",), []),
        (("gpu",), ["privileged", "host-network"]),
    ],
)
def test_only_what_is_allowed_passes(allowed: tuple[str, ...], left: list[str]) -> None:
    """A kind that the user names passes, `all` passes all, and another kind helps nobody."""
    asked = permissions(experiment(service("a", privileged=True, network="host")))
    assert [one.kind for one in refused(asked, allowed)] == left


def test_a_download_is_asked_for_once_whoever_uses_it() -> None:
    mounts = tuple(
        Mount(kind="data", source="", target=f"/{name}", read_only=True, sha256="0" * 64, url="https://example.org/x")
        for name in "xy"
    )
    asked = permissions(experiment(service("a", mounts=mounts), service("b", mounts=mounts)))
    assert [(one.kind, one.what) for one in asked] == [("fetch", "https://example.org/x, downloaded by this machine")]
    file = Mount(kind="data", source="/e/x", target="/x", read_only=True)
    assert permissions(experiment(service("a", mounts=(file,)))) == ()
