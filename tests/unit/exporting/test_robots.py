"""One Compose file per robot: who is where, how services know each other, and what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from srprov.controller import compose
from srprov.controller.robots_words import at_home
from srprov.definitions.expand import expand
from srprov.errors import DefinitionError, UsageError
from srprov.exporting.model import Export
from tests.unit.exporting.exports import classes, contents, document, experiment, notes, twin

ADDRESSES = {"r1": "192.0.2.1", "r2": "192.0.2.2"}


def on_robots(edf: Path, placed: Mapping[str, str], addresses: Mapping[str, str] = ADDRESSES) -> Export:
    source = compose.read(str(edf), frozenset(), placed=True)
    return compose.on_robots(source, expand(source.definitions.experiment, {}), placed, addresses)


class _Robot:
    """A robot on which a user's home is where the engine's socket is."""

    def home(self, user: str) -> str:
        return "/run"


def test_what_is_asked_of_nobody_is_told_of_the_paths_that_are_written(tmp_path: Path) -> None:
    """`~USER` may be any folder there; instances of one service are told once."""
    text = "services: {a: {image: x, replicas: 2, network: none, volumes: ['~pilot/docker.sock:/s']}}"
    source = compose.read(str(experiment(tmp_path, text)), frozenset(), placed=True)
    placed = {"a-1": "r1", "a-2": "r2"}
    facts: Any = dict.fromkeys(("r1", "r2"), _Robot())
    there = at_home(expand(source.definitions.experiment, {}), placed, facts)
    made = compose.on_robots(source, there, placed, ADDRESSES)
    told = [note for note in made.notes if "asks nobody" in note]
    what = "/run/docker.sock (as good as root on the robot)"
    assert told == [f"a gets more than its container, and Compose asks nobody: docker-socket ({what})"]


def test_the_robots_own_network_is_told_where_compose_has_no_other(tmp_path: Path) -> None:
    """In the words of the permission, as `apply` asks for none: on several robots, services of the overlay get it."""
    edf = experiment(tmp_path, "services: {a: {image: x}, b: {image: x}, c: {image: x, network: none}}")
    told = [note for note in on_robots(edf, {"a": "r1", "b": "r2", "c": "r2"}).notes if "asks nobody" in note]
    assert [note.partition(" gets more")[0] for note in told] == ["a", "b"]
    assert all("host-network" in note and "root's programs may do what they are told there" in note for note in told)
    assert on_robots(edf, {"a": "r1", "b": "r1", "c": "r2"}).notes == ()


PAIR = """\
services:
  talker: {image: busybox, ports: ["8080:80"], hostname: rover}
  listener: {image: busybox, depends_on: [talker]}
  driver: {image: busybox, network: host, robot: r1}
  alone: {image: busybox, network: none}
"""


def test_services_on_several_robots_share_their_robots_networks_and_know_names(tmp_path: Path) -> None:
    made = on_robots(experiment(tmp_path, PAIR), {"talker": "r1", "driver": "r1", "listener": "r2", "alone": "r2"})
    one, two = document(made, "r1")["services"], document(made, "r2")["services"]
    assert (sorted(one), sorted(two)) == (["driver", "talker"], ["alone", "listener"])
    assert [service["network_mode"] for service in (*one.values(), *two.values())] == ["host", "host", "none", "host"]
    known = ["driver=192.0.2.1", "listener=192.0.2.2", "rover=192.0.2.1", "talker=192.0.2.1"]
    assert all(sorted(service["extra_hosts"]) == known for service in (*one.values(), two["listener"]))
    assert "extra_hosts" not in two["alone"]
    assert "ports" not in one["talker"]
    assert "depends_on" not in two["listener"]
    said = classes(made)
    assert (said["services.talker.ports"], said["services.listener.depends_on"]) == ("dropped", "dropped")
    assert (said["services.talker.network"], said["services.driver.network"]) == ("adapted", "exact")
    assert "r1" in notes(made)["services.driver.robot"]
    assert "listens on port 80/tcp of the robot itself" in notes(made)["services.talker.ports"]


def test_services_with_a_network_on_one_robot_alone_have_compose_s_own(tmp_path: Path) -> None:
    edf = experiment(
        tmp_path, "services: {a: {image: x, ports: ['80:80']}, b: {image: x}, c: {image: x, network: none}}"
    )
    made = on_robots(edf, {"a": "r1", "b": "r1", "c": "r2"}, {})
    assert "network_mode" not in document(made, "r1")["services"]["a"]
    assert document(made, "r1")["services"]["a"]["ports"]


def test_an_address_that_nobody_knows_is_told(tmp_path: Path) -> None:
    edf = experiment(tmp_path, "services: {a: {image: x}, b: {image: x}}")
    with pytest.raises(UsageError, match="the address of r2 is not known"):
        on_robots(edf, {"a": "r1", "b": "r2"}, {"r1": "192.0.2.1"})


def test_what_would_mean_something_else_is_refused_at_its_line(tmp_path: Path) -> None:
    text = (
        "network: {encryption: wireguard}\n"
        "services:\n  a: {image: x, expose: [80]}\n  b: {image: x, expose: [80]}\n  c: {image: x}\n"
    )
    edf = experiment(tmp_path, text)
    with pytest.raises(DefinitionError) as refused:
        on_robots(edf, {"a": "r1", "b": "r1", "c": "r2"})
    told = [(one.location.line, one.path) for one in refused.value.problems]
    assert told == [(3, "network.encryption"), (6, "services.b.expose")]
    assert classes(twin(edf))["network.encryption"] == "dropped"


def test_each_robot_has_only_what_it_needs(tmp_path: Path) -> None:
    text = (
        "secrets: {key: {file: key}}\n"
        "services:\n"
        "  a: {cdf: a.cdf, network: none, secrets: [key]}\n"
        "  b: {image: x, network: none, volumes: [./www:/www]}\n"
    )
    files = {"a_dot_cdf": "cdf: 1\nbase: debian\n", "www__i": "1", "key": "k"}
    made = on_robots(experiment(tmp_path, text, **files), {"a": "r1", "b": "r2"}, {})
    assert sorted(one.path for one in made.files if not one.is_folder) == [
        "README.md", "r1/build/a/Dockerfile", "r1/compose.yml", "r1/secrets/.gitignore", "r2/compose.yml",
        "r2/files/www/i",
    ]  # fmt: skip
    assert document(made, "r2")["services"]["b"]["volumes"][0]["source"] == "./files/www"


@pytest.mark.parametrize("kind", ["static-peers", "ros1", "discovery-server", "zenoh"])
def test_discovery_is_told_with_the_addresses_that_there_are(tmp_path: Path, kind: str) -> None:
    servers = "" if kind == "static-peers" else ", discovery_servers: a"
    edf = experiment(
        tmp_path, f"network: {{discovery: {kind}{servers}}}\nservices: {{a: {{image: x}}, b: {{image: x}}}}"
    )
    alone, apart = twin(edf), on_robots(edf, {"a": "r1", "b": "r2"})
    place = document(alone)["services"]["a"].get("networks", {}).get("default", {})
    b = str(document(alone)["services"]["b"]) + str(
        [x for p, x in contents(alone).items() if p.startswith("discovery/b")]
    )
    far = str(document(apart, "r2")) + str([x for p, x in contents(apart).items() if "discovery/b" in p])
    if kind == "zenoh":
        assert "tcp/a:7447" in b
        assert "tcp/a:7447" in far
    elif kind == "ros1":
        assert "http://a:11311" in b
        assert "'ROS_IP': '192.0.2.2'" in far
    else:
        assert place["ipv4_address"] in b
        assert "192.0.2.1" in far
    assert classes(alone)["network.discovery"] == "adapted"


def test_on_one_pc_services_of_the_machines_network_and_of_compose_s_know_each_other(tmp_path: Path) -> None:
    text = "services: {a: {image: x}, b: {image: x, network: host}, c: {image: x, network: both, hostname: ''}}"
    made = document(twin(experiment(tmp_path, text.replace(", hostname: ''", ""))))
    gateway = made["networks"]["default"]["ipam"]["config"][0]["gateway"]
    own = made["services"]["a"]["networks"]["default"]["ipv4_address"]
    assert made["services"]["a"]["extra_hosts"] == [f"b={gateway}", f"c={gateway}"]
    assert made["services"]["b"]["extra_hosts"] == [f"a={own}", f"b={gateway}", f"c={gateway}"]
    assert "hostname" not in made["services"]["b"]
