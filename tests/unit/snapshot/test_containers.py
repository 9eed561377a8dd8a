"""A container becomes what it has beyond its image and its engine's defaults; all else is said, but for secrets."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.snapshot.containers import Service, service_of
from srprov.snapshot.hider import Hider
from srprov.snapshot.notes import Notes
from srprov.snapshot.secret_names import SecretNames
from srprov.snapshot.without import without

ID = "a" * 64
DEFAULTS: dict[str, Any] = {
    "Binds": None, "LogConfig": {"Type": "json-file", "Config": {}}, "NetworkMode": "default", "PortBindings": {},
    "RestartPolicy": {"Name": "no", "MaximumRetryCount": 0}, "AutoRemove": False, "VolumeDriver": "", "CapAdd": None,
    "CgroupnsMode": "private", "Dns": [], "DnsOptions": [], "ExtraHosts": None, "GroupAdd": None, "IpcMode": "private",
    "Cgroup": "", "Links": None, "OomScoreAdj": 0, "PidMode": "", "Privileged": False, "PublishAllPorts": False,
    "ReadonlyRootfs": False, "SecurityOpt": None, "UTSMode": "", "UsernsMode": "", "ShmSize": 67108864,
    "Runtime": "runc", "ConsoleSize": [0, 0], "Isolation": "", "CpuShares": 0, "Memory": 0, "NanoCpus": 0,
    "BlkioWeight": 0, "CpuPeriod": 0, "CpuQuota": 0, "Devices": [], "DeviceCgroupRules": None, "DeviceRequests": None,
    "KernelMemory": 0, "MemorySwap": 0, "MemorySwappiness": None, "OomKillDisable": False, "PidsLimit": None,
    "Ulimits": None, "MaskedPaths": ["/proc/kcore"], "ReadonlyPaths": ["/proc/bus"], "Init": None,
}  # fmt: skip
IMAGE: dict[str, Any] = {
    "RepoTags": ["ros:humble"],
    "RepoDigests": [f"ros@sha256:{'b' * 64}"],
    "Config": {"Env": ["PATH=/bin", "KEY_OF_IMAGE=abcdefgh"], "Cmd": ["bash"], "Entrypoint": ["/e.sh"], "User": "ros",
               "Labels": {"maintainer": "x"}, "Volumes": {"/own": {}}, "Healthcheck": {"Test": ["CMD", "true"]}},
}  # fmt: skip


def taken(
    config: dict[str, Any] | None = None,
    host: dict[str, Any] | None = None,
    image: dict[str, Any] | None = None,
    **more: Any,
) -> tuple[Service, list[str]]:
    """Take a container that is otherwise as its image and its engine say."""
    own = {**IMAGE["Config"], "Hostname": ID[:12], "Image": "ros:humble", "Domainname": "", "AttachStdin": False}
    box = {"Id": ID, "Config": {**own, **(config or {})}, "HostConfig": {**DEFAULTS, **(host or {})}, **more}
    notes = Notes()
    return service_of("it", box, IMAGE if image is None else image, "runc", notes, SecretNames().of("r1")), [
        f"{note.kind}: {note.words}" for note in notes.all()
    ]


def test_a_container_at_its_defaults_has_an_image_and_nothing_else() -> None:
    service, notes = taken()
    assert service.fields == {"image": f"ros:humble@sha256:{'b' * 64}"} and notes == []


SET: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({"NetworkMode": "host"}, {"network": "host"}),
    ({"NetworkMode": "none"}, {"network": "none"}),
    ({"Privileged": True, "SecurityOpt": ["label=disable"]}, {"privileged": True}),
    ({"SecurityOpt": ["seccomp=unconfined"]}, {"security_opt": ["seccomp=unconfined"]}),
    ({"CapAdd": ["CAP_NET_ADMIN"], "CapDrop": ["ALL"]}, {"cap_add": ["NET_ADMIN"], "cap_drop": ["ALL"]}),
    ({"Memory": 1024, "MemorySwap": 1024}, {"mem_limit": "1024"}),
    ({"NanoCpus": 1_500_000_000}, {"cpus": 1.5}),
    ({"CpuQuota": 25_000, "CpuPeriod": 50_000}, {"cpus": 0.5}),
    (
        {"CpusetCpus": "0-2", "PidsLimit": 100, "OomScoreAdj": 500},
        {"cpuset": "0-2", "pids_limit": 100, "oom_score_adj": 500},
    ),
    ({"IpcMode": "host", "PidMode": "host"}, {"ipc": "host", "pid": "host"}),
    (
        {"ShmSize": 1 << 20, "Init": True, "ReadonlyRootfs": True},
        {"shm_size": "1048576", "init": True, "read_only": True},
    ),
    ({"RestartPolicy": {"Name": "on-failure", "MaximumRetryCount": 3}}, {"restart": "on-failure:3"}),
    ({"LogConfig": {"Type": "local", "Config": {}}}, {"logging": {"driver": "local"}}),
    ({"Runtime": "nvidia"}, {"runtime": "nvidia"}),
    ({"DeviceRequests": [{"Count": -1, "Capabilities": [["gpu"]]}]}, {"gpus": "all"}),
    (
        {"Devices": [{"PathOnHost": "/dev/a", "PathInContainer": "/dev/b", "CgroupPermissions": "r"}]},
        {"devices": ["/dev/a:/dev/b:r"]},
    ),
    (
        {
            "PortBindings": {
                "80/tcp": [{"HostIp": "", "HostPort": "8080"}],
                "53/udp": [{"HostIp": "127.0.0.1", "HostPort": "53"}, {"HostIp": "::", "HostPort": "54"}],
            }
        },
        {"ports": ["127.0.0.1:53:53/udp", "54:53/udp", "8080:80"]},
    ),
    ({"Tmpfs": {"/run": "size=1m"}}, {"tmpfs": ["/run:size=1m"]}),
    ({"Ulimits": [{"Name": "nofile", "Soft": 1, "Hard": 2}]}, {"ulimits": {"nofile": {"soft": 1, "hard": 2}}}),
    ({"ExtraHosts": ["a:10.0.0.1"], "GroupAdd": ["video"]}, {"extra_hosts": ["a:10.0.0.1"], "group_add": ["video"]}),
]


def test_a_port_at_ipv6_alone_is_told_as_no_edf_publishes_one() -> None:
    ends = [{"HostIp": "::1", "HostPort": "53"}, {"HostIp": "2001:db8::5", "HostPort": "54"}]
    service, notes = taken(host={"PortBindings": {"53/tcp": ends}})
    assert service.fields["ports"] == ["127.0.0.1:53:53"]
    assert [note.partition(":")[0] for note in notes] == ["adapted", "lost"], notes
    assert "no longer at ::1" in notes[0] and "2001:db8::5" in notes[1]


@pytest.mark.parametrize(("host", "fields"), SET)
def test_what_was_set_is_a_field(host: dict[str, Any], fields: dict[str, Any]) -> None:
    service, notes = taken(host=host)
    assert {key: value for key, value in service.fields.items() if key != "image"} == fields
    assert notes == []


LOST: list[tuple[dict[str, Any], str]] = [
    ({"Dns": ["10.0.0.1"]}, "lost: Dns is set"),
    ({"CpuShares": 512}, "lost: CpuShares is set"),
    ({"UsernsMode": "host"}, "lost: UsernsMode is set"),
    ({"VolumesFrom": ["db"]}, "lost: VolumesFrom is set"),
    ({"NobodyKnows": {"a": 1}}, "lost: NobodyKnows is set"),
    ({"IpcMode": "container:abc"}, "lost: IpcMode container:abc"),
    ({"NetworkMode": "container:abc"}, "lost: it shares the network"),
    ({"NetworkMode": "field"}, "adapted: the network field"),
    ({"AutoRemove": True}, "adapted: it was made with --rm"),
    ({"Memory": 1024, "MemorySwap": -1}, "adapted: it may use swap"),
    ({"DeviceRequests": [{"DeviceIDs": ["0"], "Capabilities": [["gpu"]]}]}, "lost: asks for certain GPUs"),
]


@pytest.mark.parametrize(("host", "words"), LOST)
def test_what_an_edf_cannot_say_is_said(host: dict[str, Any], words: str) -> None:
    _, notes = taken(host=host)
    assert any(note.startswith(words) for note in notes), notes


def test_process_and_health_are_those_that_differ_from_the_images() -> None:
    service, _ = taken({"Cmd": ["ros2", "run"], "User": "root", "WorkingDir": "/ws", "StopTimeout": 3, "Tty": True})
    assert service.fields["command"] == ["ros2", "run"] and "entrypoint" not in service.fields
    assert (service.fields["user"], service.fields["working_dir"], service.fields["stop_grace_period"]) == (
        "root",
        "/ws",
        "3s",
    )
    cleared, _ = taken({"Entrypoint": None, "Cmd": ["x"]})
    assert cleared.fields["entrypoint"] == [] and cleared.fields["command"] == ["x"]
    check = {"Test": ["CMD-SHELL", "curl x"], "Interval": 1_500_000_000, "Timeout": 2_000_000_000, "Retries": 5}
    well, _ = taken({"Healthcheck": check})
    assert well.fields["healthcheck"] == {
        "test": ["CMD-SHELL", "curl x"],
        "interval": "1500ms",
        "timeout": "2s",
        "retries": 5,
    }
    none, _ = taken({"Healthcheck": {"Test": ["NONE"]}})
    assert none.fields["healthcheck"] == {"test": ["NONE"]}


def test_ports_that_are_only_exposed_are_those_of_the_user() -> None:
    ports = {"80/tcp": {}, "5000/tcp": {}, "7400/udp": {}}
    service, _ = taken(
        {"ExposedPorts": ports},
        {"NetworkMode": "host", "PortBindings": {"80/tcp": [{"HostPort": "80"}]}},
        {**IMAGE, "Config": {**IMAGE["Config"], "ExposedPorts": {}}},
    )
    assert service.fields["expose"] == ["5000", "7400/udp"] and "ports" not in service.fields


def test_mounts_are_named_and_what_they_hold_is_lost() -> None:
    mounts = [
        {"Type": "bind", "Source": "/opt/a:b", "Destination": "/a", "RW": False, "Propagation": "rshared"},
        {"Type": "volume", "Name": "maps", "Destination": "/maps", "RW": True, "Driver": "nfs"},
        {"Type": "volume", "Name": "c" * 64, "Destination": "/own", "RW": True},
        {"Type": "volume", "Name": "d" * 64, "Destination": "/var/My Data", "RW": True},
        {"Type": "npipe", "Destination": "/x"},
    ]
    service, notes = taken(Mounts=mounts)
    assert service.fields["volumes"] == [
        {"type": "bind", "source": "/opt/a:b", "target": "/a", "read_only": True},
        {"type": "volume", "source": "maps", "target": "/maps"},
        {"type": "volume", "source": "it-my-data", "target": "/var/My Data"},
    ]
    said = "\n".join(notes)
    for words in ("propagate", "the driver nfs", "own volume /own", "the kind npipe", "the volume maps holds"):
        assert words in said


def test_what_is_too_much_is_noted_and_volumes_of_the_image_take_no_place() -> None:
    image = {**IMAGE, "Config": {**IMAGE["Config"], "Volumes": {f"/a/{n}": {} for n in range(600)}}}
    own = [{"Type": "volume", "Name": f"{n:064x}", "Destination": f"/a/{n}"} for n in range(600)]
    bind = {"Type": "bind", "Source": "/etc/x", "Destination": "/z", "RW": False}
    service, _ = taken(image=image, Mounts=[*own, bind])
    assert service.fields["volumes"] == [{"type": "bind", "source": "/etc/x", "target": "/z", "read_only": True}]
    drops, devices = [f"CAP_{n}" for n in range(501)], [{"PathOnHost": f"/dev/{n}"} for n in range(501)]
    service, notes = taken(
        {"Labels": {f"l{n}": "x" for n in range(501)}}, {"CapDrop": drops, "Devices": devices},
        Mounts=[{**bind, "Destination": f"/z/{n}"} for n in range(501)],
    )  # fmt: skip
    for what in ("cap_drop", "devices", "labels", "volumes"):
        assert f"lost: of its {what} only 500 of 501 are captured" in notes and len(service.fields[what]) == 500


def test_a_secret_behind_more_variables_than_are_captured_is_hidden_all_the_same() -> None:
    service, notes = taken({"Env": [*(f"V{n}=x" for n in range(1000)), "API_TOKEN=hunter2hunter2"]})
    assert service.hidden == ("hunter2hunter2",) and not service.secrets
    assert "lost: only 1000 of its variables are captured" in notes


def test_images_that_no_registry_has_are_used_where_they_are() -> None:
    local, notes = taken(image={**IMAGE, "RepoDigests": []})
    assert local.fields == {"image": "ros:humble", "pull_policy": "never"} and "no registry" in notes[0]
    other, _ = taken(image={**IMAGE, "RepoDigests": [f"mirror.lab/ros@sha256:{'c' * 64}"]})
    assert other.fields == {"image": "ros:humble", "pull_policy": "never"}
    nameless, notes = taken(
        {"Image": f"sha256:{'d' * 64}"}, image={"Config": IMAGE["Config"], "RepoTags": ["<none>:<none>"]}
    )
    assert nameless.fields["pull_policy"] == "never" and any("no name any more" in note for note in notes)


def test_secrets_leave_their_field_and_every_other_place() -> None:
    env = ["PATH=/bin", "KEY_OF_IMAGE=abcdefgh", "DB_PASSWORD=hunter2-long", "db-password=other-one", "TWO=a\nb", "X=1"]
    service, notes = taken(
        {
            "Env": env,
            "Cmd": ["app", "--password", "hunter2-long"],
            "Labels": {"maintainer": "x", "api.token": "abc", "a": "b"},
        },
        {"Sysctls": {"kernel.x": "hunter2-long"}},
    )
    assert service.secrets == {"it-db_password": "R1__IT__DB_PASSWORD", "it-db-password": "R1__IT__DB_PASSWORD_2"}
    assert service.fields["environment"] == ["TWO=a\nb", "X=1"] and service.fields["labels"] == {"a": "b"}
    assert service.fields["command"] == ["app", "--password", "***"]
    kept = Notes()
    hider = Hider(service.hidden)
    clean = without(service, hider, hider, kept)
    assert clean
    told = json.dumps([clean.fields, clean.secrets, notes, str(kept.all())])
    assert "hunter2" not in told and "other-one" not in told and "api.token" in told
    assert "hunter2" not in repr(clean)


HOSTILE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=True) | st.text(max_size=40),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
    max_leaves=8,
)
KEYS = st.sampled_from(
    sorted({*DEFAULTS, "Mounts", "Config", "HostConfig", "Id", "Env", "Cmd", "Labels", "Healthcheck"})
)


@given(st.dictionaries(KEYS, HOSTILE, max_size=8), st.dictionaries(KEYS, HOSTILE, max_size=8), HOSTILE)
def test_an_engine_that_lies_gives_a_service_all_the_same(
    config: dict[str, Any],
    host: dict[str, Any],
    image: Any,
) -> None:
    """Whatever is said, there is a service with an image, and no error."""
    box = {"Id": ID, "Config": config, "HostConfig": host, **config}
    service = service_of("it", box, image if isinstance(image, dict) else {}, "runc", Notes(), SecretNames().of("r1"))
    assert service.fields["image"]
