"""Run-time fields in Compose's forms, and what is wrong with them at its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import load_experiment
from srprov.definitions.containermodel import Logging, Mount, Runtime
from srprov.errors import DefinitionError
from srprov.exporting.runtime import runtime_document


def load(folder: Path, services: str, cdf: str = "") -> dict[str, Runtime]:
    """Return the run-time fields of the services of an EDF."""
    (folder / "e.edf").write_text(f"edf: 1\nname: demo\nservices:\n{services}")
    (folder / "c.cdf").write_text(cdf)
    return {name: one.runtime for name, one in load_experiment(str(folder / "e.edf")).experiment.services.items()}


def one(folder: Path, fields: str) -> Runtime:
    """Return the run-time fields of a service `a` beside a service `b`."""
    return load(folder, f"  a: {{image: busybox, {fields}}}\n  b: {{image: busybox, hostname: turtle}}\n")["a"]


def test_every_field_in_its_plain_form(tmp_path: Path) -> None:
    run = one(
        tmp_path,
        "cap_drop: [ALL], mem_limit: 1g, mem_reservation: 512m, oom_score_adj: -5, cpuset: 0-1, stdin_open: yes, "
        "init: false, read_only: true, hostname: robot.lab, runtime: nvidia",
    )
    assert run == Runtime(
        cap_drop=("ALL",), mem_limit=1 << 30, mem_reservation=1 << 29, oom_score_adj=-5, cpuset="0-1", stdin_open=True,
        init=False, read_only=True, hostname="robot.lab", runtime="nvidia",
    )  # fmt: skip
    assert one(tmp_path, "cpuset: 3").cpuset == "3"


@pytest.mark.parametrize(
    ("written", "count"), [("all", "all"), ("2", "2"), ("+2", "2"), ("0o7", "7"), ("0x1F", "31"), ("0xF423F", "999999")]
)
def test_a_number_of_gpus_is_kept_in_one_form(tmp_path: Path, written: str, count: str) -> None:
    """Compose files and plans have it as a decimal."""
    run = one(tmp_path, f"gpus: {written}")
    assert run.gpus == count
    devices = [{"count": "all" if count == "all" else int(count), "capabilities": ["gpu"]}]
    assert runtime_document(run)["deploy"] == {"resources": {"reservations": {"devices": devices}}}


@pytest.mark.parametrize(
    "written",
    ["[x:10.0.0.1, 'x:::1', y=host-gateway]", "{x: [10.0.0.1, '::1'], y: host-gateway}",
     "['y:host-gateway', x=10.0.0.1, 'x=[::1]']"],
)  # fmt: skip
def test_extra_hosts_as_list_and_as_map(tmp_path: Path, written: str) -> None:
    assert one(tmp_path, f"extra_hosts: {written}").extra_hosts == (
        ("x", "10.0.0.1"), ("x", "::1"), ("y", "host-gateway"),
    )  # fmt: skip


def test_labels_as_list_and_as_map(tmp_path: Path) -> None:
    assert one(tmp_path, "labels: [a.b=1=2, c=]").labels == {"a.b": "1=2", "c": ""}
    assert one(tmp_path, "labels: {a.b: 0644, srprovider: yes}").labels == {"a.b": "0644", "srprovider": "yes"}


def test_tmpfs_short_and_long(tmp_path: Path) -> None:
    short = [
        one(tmp_path, f"tmpfs: {form}").mounts for form in ("'/t:size=64m,mode=1777'", "['/t:size=64m,mode=1777']")
    ]
    assert short[0] == short[1] == (Mount(kind="tmpfs", source="", target="/t", options="size=64m,mode=1777"),)
    (long,) = one(
        tmp_path, "volumes: [{type: tmpfs, target: /t, read_only: true, tmpfs: {size: 1k, mode: 0700}}]"
    ).mounts
    assert long.options == "size=1024,mode=0700,ro"


def test_init_is_true_by_default_where_srprov_builds_the_image(tmp_path: Path) -> None:
    services = "  a: {cdf: c.cdf}\n  b: {cdf: c.cdf, init: false}\n  c: {image: busybox}\n"
    runs = load(tmp_path, services, "cdf: 1\nbase: debian:bookworm\n")
    assert [run.init for run in runs.values()] == [True, False, None]
    assert load(tmp_path, "  a: {cdf: c.cdf}\n", "cdf: 1\nimage: busybox\n")["a"].init is None
    assert load(tmp_path, "  a: {cdf: c.cdf}\n", "cdf: 1\nbase: debian\ninit: false\n")["a"].init is False


def test_a_service_over_its_cdf(tmp_path: Path) -> None:
    """Names and labels are merged by key, lists append, and logging is one value: its options are its driver's."""
    cdf = (
        "cdf: 1\nimage: busybox\nextra_hosts: [x=10.0.0.1, z=10.0.0.3]\nlabels: {a: 1, b: 1}\ntmpfs: /t:size=1m\n"
        "cap_drop: [MKNOD]\nlogging: {driver: gelf, options: {gelf-address: 'udp://x:1'}}\n"
    )
    fields = "extra_hosts: {x: 10.0.0.2}, labels: [b=2], tmpfs: [/u, /t], cap_drop: [ALL], logging: {driver: local}"
    run = load(tmp_path, f"  a: {{cdf: c.cdf, {fields}}}\n", cdf)["a"]
    assert run.extra_hosts == (("x", "10.0.0.2"), ("z", "10.0.0.3"))
    assert run.labels == {"a": "1", "b": "2"}
    assert [(m.target, m.options) for m in run.mounts] == [("/u", ""), ("/t", "")]
    assert run.cap_drop == ("MKNOD", "ALL")
    assert run.logging == Logging(driver="local")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ("labels: {srprov.instance: x}", "the label 'srprov.instance' is srprov's own"),
        ("labels: [srprov=x]", "the label 'srprov' is srprov's own"),
        ("labels: [com.docker.compose.project=x]", "'com.docker.compose.project' is one that Docker's own"),
        ("labels: {io.docker.x: y}", "the label 'io.docker.x' is one that Docker's own programs go by"),
        ("hostname: b", "'b' is the name of the service 'b'"),
        ("hostname: B", "'B' is the name of the service 'b'"),
        ("hostname: localhost", "'localhost' is the name of the container itself"),
        ("hostname: LocalHost", "'LocalHost' is the name of the container itself"),
        ("hostname: x, network: host", "a service with 'network: host' has the robot's hostname"),
        ("hostname: x, replicas: 2", "several instances of a service cannot have one hostname"),
        ("hostname: 'a b'", "a host's name"),
        ("extra_hosts: [b=10.0.0.1]", "'b' is the name of the service 'b'"),
        ("extra_hosts: [turtle=10.0.0.1]", "'turtle' is the name of the hostname of 'b'"),
        ("extra_hosts: [Turtle=10.0.0.1]", "'Turtle' is the name of the hostname of 'b'"),
        ("extra_hosts: [localhost=10.0.0.1]", "'localhost' is the name of the container itself"),
        ("replicas: 2, extra_hosts: [a-2=10.0.0.1]", "'a-2' is the name of the service 'a'"),
        ("extra_hosts: [x=nowhere]", "'nowhere' is no address of 'x'"),
        ("extra_hosts: {x: 10.0.0.256}", "'10.0.0.256' is no address of 'x'"),
        ("extra_hosts: [x]", "NAME:ADDRESS or NAME=ADDRESS"),
        ("extra_hosts: [x=host-gateway], network: none", "which a service with 'network: none' cannot reach"),
        ("mem_limit: 1m, mem_reservation: 2m", "is more than 'mem_limit'"),
        ("oom_score_adj: 1001", "1000"),
        ("cpuset: '0-'", "processors such as 0-2,5"),
        ("tmpfs: t", "path[:options]"),
        ("tmpfs: '/t:lowerdir=/etc'", "path[:options]"),
        ("tmpfs: '/t:size=1m,suidd'", "are no options of a tmpfs"),
        ("tmpfs: /t, volumes: ['v:/t']", "'/t' is mounted twice"),
        ("volumes: [{type: volume, source: v, target: /t, tmpfs: {size: 1m}}]", "'tmpfs' is for a volume of that type"),
        ("logging: {drivers: local}", "drivers"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, fields: str, message: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        one(tmp_path, fields)
    (problem,) = caught.value.problems
    assert message in f"{problem.message} {problem.hint}"
    assert problem.location.line == 4


def test_a_hostname_is_one_services(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError) as caught:
        one(tmp_path, "hostname: turtle")
    (problem,) = caught.value.problems
    assert (problem.message, problem.location.line) == ("'a' has the hostname 'turtle' too", 5)


@pytest.mark.parametrize("name", ["vault.lab.example", "vault"])
def test_a_cdf_takes_no_host_s_place_for_others(tmp_path: Path, name: str) -> None:
    """Its author may be somebody else: all services of the EDF would find it by that name, on all robots."""
    cdf, both = f"cdf: 1\nname: c\nimage: busybox\nhostname: {name}\n", "  b: {image: busybox}\n"
    with pytest.raises(DefinitionError) as caught:
        load(tmp_path, f"  a: {{cdf: c.cdf}}\n{both}", cdf)
    (problem,) = caught.value.problems
    assert (problem.location.line, problem.message) == (
        4,
        "its CDF says a hostname, by which all other services would find it",
    )
    assert name not in f"{problem.message} {problem.hint}"
    assert load(tmp_path, f"  a: {{cdf: c.cdf, hostname: rover.lab}}\n{both}", cdf)["a"].hostname == "rover.lab"


def test_a_hostname_in_capitals_is_the_same_one(tmp_path: Path) -> None:
    """Who looks for a host does not tell them apart; a service's own name in capitals is its own."""
    with pytest.raises(DefinitionError) as caught:
        one(tmp_path, "hostname: TURTLE")
    assert caught.value.problems[0].message == "'a' has the hostname 'turtle' too"
    assert one(tmp_path, "hostname: A").hostname == "A"
