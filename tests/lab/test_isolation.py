"""Two experiments on the same robots, at the same time: neither sees the other, and neither can take the other over."""

from __future__ import annotations

import ipaddress
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, edf, only_the_record, part_of_lab
from tests.lab.injection import TOOL
from tests.lab.looks import address_of, begin_on, ids, networks, reached, vxlans, wait_until

pytestmark = pytest.mark.lab

HOMES = {
    "left": {"web": "robot1", "client": "robot2"},
    "right": {"web": "robot2", "client": "robot1", "extra": "robot3"},
}
"""Instance -> service -> robot: two names in both, and each robot but one runs something of both."""
ROBOTS = ["robot1", "robot2", "robot3"]


def experiment(name: str, folder: Path, *, word: str = "", instance_of: str = "") -> str:
    """Write an experiment whose `web` serves one word, its own name if nothing else is said; give the EDF's path."""
    (folder / "www").mkdir(parents=True, exist_ok=True)
    (folder / "www" / "who.txt").write_text(word or name, encoding="utf-8")
    web = busybox("busybox", "httpd", "-f", "-p", "8080", "-h", "/www", volumes=["./www:/www:ro"])
    services: dict[str, dict[str, Any]] = {"web": web, "client": busybox(), "extra": busybox()}
    homes = HOMES[instance_of or name]
    document = edf(name, {service: {**services[service], "robot": robot} for service, robot in homes.items()})
    path = folder / "experiment.edf"
    path.write_text(document, encoding="utf-8")
    return str(path)


def who_is_web(lab: Lab, robot: str, container: str) -> str:
    ask = ("timeout", "5", "wget", "-q", "-O", "-", "http://web:8080/who.txt")
    return lab.shell(robot, "docker", "exec", container, *ask).out


def look(lab: Lab, name: str, service: str, addresses: dict[str, dict[str, str]]) -> tuple[set[str], set[str]]:
    """Give what answers one service when it pings all there is, by address and by name, and what should."""
    other = next(one for one in HOMES if one != name)
    own = {*addresses[name].values(), *HOMES[name]}
    names = {*HOMES[other], *(f"srprov.{other}.{each}" for each in HOMES[other])} - own
    strange = {*addresses[other].values(), *names}
    return reached(lab, HOMES[name][service], f"srprov.{name}.{service}", own | strange), own


def frames_stay_inside(lab: Lab) -> None:
    """Have each container send a frame to all, to a group, and to the MAC of every container: none leaves its own."""
    everybody = [(name, service, robot) for name, homes in HOMES.items() for service, robot in homes.items()]
    inside, macs = {}, {}
    for name, service, robot in everybody:
        found = lab.inspect(robot, f"srprov.{name}.{service}")
        inside[name, service] = ("nsenter", "-t", str(found["State"]["Pid"]), "-n", "python3", "-c", TOOL)
        (network,) = found["NetworkSettings"]["Networks"].values()
        macs[name, service] = network["MacAddress"]
    listeners = {
        (name, service): begin_on(lab, robot, *inside[name, service], "listen") for name, service, robot in everybody
    }
    for one in listeners.values():
        assert one.stdout is not None and one.stdout.readline() == "ready\n"
    group = "01:00:5e:00:00:fb"
    for name, service, robot in everybody:
        to = ("ff:ff:ff:ff:ff:ff", group, *macs.values())
        lab.shell(robot, *inside[name, service], "plain", f"{name}-{service}", macs[name, service], *to)
    for name, service, robot in everybody:
        lab.shell(robot, *inside[name, service], "plain", "end", macs[name, service])
    for (name, service), listener in listeners.items():
        out, err = listener.communicate(timeout=120)
        assert listener.returncode == 0, err
        words = {line for line in out.splitlines() if line != "end"}
        others = [f"{name}-{other}" for other in HOMES[name] if other != service]
        own = {f"{other} {to}" for other in others for to in ("ff:ff:ff:ff:ff:ff", group, macs[name, service])}
        assert own <= words, f"{service} of {name} gets all that is for it"
        assert {word.partition(" ")[0] for word in words} == set(others), f"{service} of {name}"


def run(lab: Lab, *words: str) -> Any:
    done = lab.srprov(*words, "--json")
    assert done.code == 0, done
    return done.json


def test_two_experiments_share_robots_and_do_not_see_each_other(lab: Lab, tmp_path: Path) -> None:
    """Neither an address nor a name of the other answers, nor a frame; names of both are each one's own."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    for name in HOMES:
        run(lab, "apply", experiment(name, tmp_path / name), "-i", inventory, "--yes", "--settle", "0")
    addresses = {
        name: {s: address_of(lab, robot, f"srprov.{name}.{s}") for s, robot in homes.items()}
        for name, homes in HOMES.items()
    }
    asked = [(name, service) for name, homes in HOMES.items() for service in homes]
    with ThreadPoolExecutor(len(asked)) as pool:
        looks = pool.map(lambda who: look(lab, *who, addresses), asked)
        for (name, service), (seen, own) in zip(asked, looks, strict=True):
            assert seen == own, f"{service} of {name}"
    for name, homes in HOMES.items():
        assert who_is_web(lab, homes["client"], f"srprov.{name}.client") == name

    frames_stay_inside(lab)
    for robot in ("robot1", "robot2"):
        there = networks(lab, robot)
        assert set(there) == {"srprov.left", "srprov.right"}
        left, right = (ipaddress.ip_network(there[f"srprov.{n}"]["IPAM"]["Config"][0]["Subnet"]) for n in HOMES)
        assert not left.overlaps(right)
        for name, subnet in (("left", left), ("right", right)):
            assert all(ipaddress.ip_address(address) in subnet for address in addresses[name].values())
        assert len(set(vxlans(lab, robot).values())) == 2
    assert vxlans(lab, "robot1") == vxlans(lab, "robot2"), "one instance has one VNI on all robots"
    assert set(vxlans(lab, "robot3").values()) < set(vxlans(lab, "robot1").values())


def test_destroying_one_leaves_the_other_as_it_was(lab: Lab, tmp_path: Path) -> None:
    """While `destroy` takes one experiment away, no ping of the other is lost, and its containers stay the same."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    paths = {name: experiment(name, tmp_path / name) for name in HOMES}
    for path in paths.values():
        run(lab, "apply", path, "-i", inventory, "--yes", "--settle", "0")
    before = ids(lab, ROBOTS, "left")
    assert sorted(before) == ["srprov.left.client", "srprov.left.web"]

    enter = ("docker", "exec", "srprov.left.client")
    script = "echo $$ >/tmp/pid; exec ping -i 0.1 web >/tmp/pings"
    pings = begin_on(lab, "robot2", *enter, "timeout", "120", "sh", "-c", script)

    def answers() -> list[int]:
        said = lab.shell("robot2", *enter, "sh", "-c", "cat /tmp/pings || true").out
        return [int(number) for number in re.findall(r"\bseq=([0-9]+) .*\n", said)]

    wait_until(lambda: len(answers()) >= 5, 20, "pings before the destroy")
    gone = run(lab, "destroy", paths["right"], "-i", inventory, "--yes")
    assert gone["changed"] > 0
    enough = len(answers()) + 5
    wait_until(lambda: len(answers()) >= enough, 20, "pings after the destroy")
    assert pings.poll() is None, "the pings were to go on until after the destroy"
    answered = answers()
    lab.shell("robot2", *enter, "sh", "-c", "kill $(cat /tmp/pid)")
    pings.communicate(timeout=120)
    assert answered == list(range(len(answered))), f"lost: {set(range(answered[-1])) - set(answered)}"

    assert ids(lab, ROBOTS, "left") == before
    assert ids(lab, ROBOTS, "right") == {}
    assert lab.leftovers("robot3") == only_the_record("left")
    assert set(networks(lab, "robot1")) == {"srprov.left"}
    assert len(vxlans(lab, "robot1")) == 1
    assert who_is_web(lab, "robot2", "srprov.left.client") == "left"
    again = run(lab, "apply", paths["left"], "-i", inventory, "--yes")
    assert (again["changed"], again["failed"]) == (0, 0)


def test_an_experiment_of_the_same_name_is_refused_until_told_how(lab: Lab, tmp_path: Path) -> None:
    """Another folder's EDF of that name gets 9 with both sources; it may run beside it, or take it over by --adopt."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    first = experiment("left", tmp_path / "first", word="first")
    second = experiment("left", tmp_path / "second", word="second")
    run(lab, "apply", first, "-i", inventory, "--yes", "--settle", "0")
    before = ids(lab, ROBOTS, "left")

    for verb in (("plan",), ("apply", "--yes"), ("destroy", "--yes")):
        refused = lab.srprov(verb[0], second, "-i", inventory, *verb[1:])
        assert refused.code == 9, refused
        assert first in refused.err and second in refused.err
        assert "--instance" in refused.err and "--adopt" in refused.err
    assert ids(lab, ROBOTS, "left") == before
    assert who_is_web(lab, "robot2", "srprov.left.client") == "first"

    run(lab, "apply", second, "-i", inventory, "--yes", "--settle", "0", "--instance", "other")
    assert ids(lab, ROBOTS, "left") == before
    assert who_is_web(lab, "robot2", "srprov.left.client") == "first"
    assert who_is_web(lab, "robot2", "srprov.other.client") == "second"

    shown = lab.srprov("status", "-i", inventory)
    assert shown.code == 0, shown
    rows = [line.split()[:3] for line in shown.out.splitlines()[1:]]
    assert rows == [[name, s, HOMES["left"][s]] for name in ("left", "other") for s in ("client", "web")]
    known = {row["container"]: row["service"] for row in run(lab, "status", "-i", inventory)["services"]}
    real = {one[:12]: name for robot in ROBOTS for name, one in lab.containers(robot).items()}
    assert {one: name.rpartition(".")[2] for one, name in real.items()} == known
    only = run(lab, "status", first, "-i", inventory)["services"]
    assert {row["instance"] for row in only} == {"left"}

    run(lab, "apply", second, "-i", inventory, "--yes", "--settle", "0", "--adopt")
    assert who_is_web(lab, "robot2", "srprov.left.client") == "second"
    run(lab, "plan", second, "-i", inventory)
    assert lab.srprov("apply", first, "-i", inventory, "--yes").code == 9, "it has a new owner now"
    run(lab, "destroy", second, "-i", inventory, "--yes")
    run(lab, "destroy", "--instance", "other", "-i", inventory, "--yes")
    assert [lab.leftovers(robot) for robot in ROBOTS] == [NOTHING] * 3
