"""Labs with names: what they are called, which numbers they get, and what all labs of a machine share."""

from __future__ import annotations

from ipaddress import IPv4Network
from pathlib import Path

import pytest

from srprov.errors import LabError, UsageError
from srprov.lab import cgroups, network, places, sites
from srprov.lab.places import LANS, LONGEST_NAME, MOST_NUMBER, MOST_ROBOTS, Site, check_name, robot_name, subnet

LAST_ROBOT = robot_name(MOST_ROBOTS)
LONGEST_INTERFACE = 15


def test_the_lab_without_a_name_keeps_its_names_and_addresses() -> None:
    site = Site()
    assert (site.tag, str(site.run), str(site.disks)) == ("srprov-lab", "/run/srprov-lab", "/var/lib/srprov-lab")
    assert (str(site.inventory), site.command) == ("inventory/lab.yml", "srprov lab")
    assert (site.bridge, site.link("robot7"), str(site.subnet)) == ("srlab0", "srlab-r7", "10.213.0.0/24")
    assert (str(site.controller), str(site.address("robot1")), site.mac(11)) == (
        "10.213.0.1",
        "10.213.0.11",
        "02:73:72:00:00:0b",
    )


def test_nothing_of_two_labs_has_the_same_name() -> None:
    def names(site: Site) -> set[str]:
        robots = [robot_name(number) for number in range(1, MOST_ROBOTS + 1)]
        own = {site.tag, str(site.run), str(site.disks), str(site.inventory), *map(site.bridge_of, LANS)}
        own |= {str(subnet(lan)) for lan in LANS for subnet in (site.subnet_of, site.subnet6_of)}
        addresses = {str(site.address(robot, lan)) for robot in robots for lan in LANS}
        addresses |= {site.mac(11, lan) for lan in LANS}
        return own | {site.link(robot) for robot in robots} | addresses

    labs = [Site(), Site("lab", 1), Site("robot1", 11), Site("srprov-lab", 2), Site("a-1", MOST_NUMBER)]
    every = [names(site) for site in labs]
    assert sum(map(len, every)) == len(set.union(*every))
    assert not any(one.link_prefix.startswith(other.link_prefix) for one in labs for other in labs if one != other)


def test_the_longest_names_fit_the_kernel() -> None:
    site = Site("x" * LONGEST_NAME, MOST_NUMBER)
    assert max(len(site.bridge_of(2)), len(site.link(LAST_ROBOT))) <= LONGEST_INTERFACE
    assert site.address(LAST_ROBOT) in site.subnet


def test_a_lab_that_is_down_has_folders_but_no_addresses() -> None:
    assert str(Site("x", None).run) == "/run/srprov-labs/x"
    with pytest.raises(AssertionError, match="the lab x is down"):
        assert Site("x", None).bridge


@pytest.mark.parametrize("name", ["", "a", "test-gw0", "0", "x" * LONGEST_NAME])
def test_names_that_labs_may_have(name: str) -> None:
    assert check_name(name) == name


@pytest.mark.parametrize("name", ["-a", "A", "a.b", "a/b", "..", "a b", "ä", "a\n", "x" * (LONGEST_NAME + 1)])
def test_names_that_labs_may_not_have(name: str) -> None:
    with pytest.raises(UsageError, match="cannot be the name of a lab"):
        check_name(name)


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a machine's folder without any lab, with forwarding off and no cgroups; 10.213.2.0/24 is in use."""
    run, forwarding = tmp_path / "run", tmp_path / "ip_forward"
    forwarding.write_text("0\n")
    monkeypatch.setattr(places, "RUN", run)
    monkeypatch.setattr(places, "LIB", tmp_path / "lib")  # `release` removes what is there
    monkeypatch.setattr(sites, "NAMED_RUN", run / "srprov-labs")
    monkeypatch.setattr(sites, "MACHINE", run / "srprov-labs" / ".machine")
    monkeypatch.setattr(sites, "BEFORE", run / "srprov-labs" / ".machine" / "settings.json")
    monkeypatch.setattr(sites, "SETTINGS", {forwarding: "1"})
    monkeypatch.setattr(cgroups, "_roots", lambda: [tmp_path / "cgroup"])
    monkeypatch.setattr(cgroups, "version", lambda: 1)
    (tmp_path / "cgroup").mkdir()
    used = IPv4Network("10.213.2.0/24")
    monkeypatch.setattr(network, "in_use", lambda wanted: "10.213.2.0/24 on eth1" if wanted == used else None)
    return tmp_path


def test_a_lab_gets_a_free_subnet_and_keeps_it(machine: Path) -> None:
    assert [sites.claim(name).number for name in ("a", "b", "a", "", "c")] == [1, 3, 1, 0, 4]
    assert [site.name for site in sites.every()] == ["", "a", "b", "c"]
    sites.release(sites.find("a"))
    assert sites.find("a").number is None
    assert sites.claim("d").number == 1


def test_no_free_subnet_is_an_error(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "in_use", lambda wanted: "10.0.0.0/8 on eth1")
    with pytest.raises(LabError, match=f"no subnet from {subnet(1)} to {subnet(MOST_NUMBER)} is free"):
        sites.claim("a")
    assert sites.every() == []


def test_settings_of_the_machine_go_with_the_last_lab(machine: Path) -> None:
    """Whichever lab was first, and also when one of them is brought up twice."""
    forwarding = machine / "ip_forward"
    first, second = sites.claim("a"), sites.claim("")
    sites.claim("a")
    assert forwarding.read_text() == "1"
    sites.release(first)
    assert forwarding.read_text() == "1"
    assert (machine / "cgroup" / "srprov-lab").is_dir() and not (machine / "cgroup" / "srprov-labs").exists()
    sites.release(second)
    assert forwarding.read_text() == "0"
    assert sorted(machine.rglob("*")) == [machine / "cgroup", forwarding, machine / "run"]


def test_a_used_subnet_is_an_error_that_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "run", lambda command: '[{"dst": "10.213.0.0/16", "dev": "eth1"}]')
    monkeypatch.setattr(network, "succeeds", lambda command: False)
    with pytest.raises(LabError, match=r"subnet 10.213.0.0/24 is in use here: 10.213.0.0/16 on eth1") as error:
        network.ensure(Site(), [])
    assert error.value.hint is not None and "srprov lab --name NAME up" in error.value.hint
