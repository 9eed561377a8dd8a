"""Robots that drift: `plan` names exactly what is wrong, `apply` heals exactly that, and the rest keeps running.

One experiment of four services on four robots for the whole file. Every test breaks one thing by hand and leaves
all as it should be.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from tests.lab.conftest import Lab, busybox, causes, changed, edf, part_of_lab

pytestmark = pytest.mark.lab

SERVICES = ["east", "north", "south", "west"]
HOME = {name: f"robot{number}" for number, name in enumerate(SERVICES, start=1)}
HOSTS = "/var/lib/srprov/compass/hosts"


@dataclass
class Compass:
    lab: Lab
    words: tuple[str, ...]
    """The EDF and the inventory, as arguments."""

    def plan(self) -> dict[str, str]:
        """Give what `plan` wants to do: step id -> action and cause."""
        done = self.lab.srprov("plan", *self.words, "--json")
        assert done.code == 0, done
        return causes(done.json)

    def apply(self) -> set[str]:
        """Apply, and give the ids of the steps that changed something."""
        done = self.lab.srprov("apply", *self.words, "--yes", "--settle", "0", "--json")
        assert done.code == 0, done
        assert len(changed(done.json)) == len(done.json["steps"]) == done.json["changed"]
        return changed(done.json)

    def look(self) -> dict[str, str]:
        """Give, by Docker's own word, id and start of every service's container that is there."""
        form = "{{.Id}} {{.State.StartedAt}} {{.State.Status}}"

        def one(name: str) -> str:
            words = ("docker", "inspect", "--format", form, f"srprov.compass.{name}")
            return self.lab.shell(HOME[name], *words, check=False).out.strip()

        with ThreadPoolExecutor(len(SERVICES)) as pool:
            return dict(zip(SERVICES, pool.map(one, SERVICES), strict=True))

    def lost(self, names: list[str] = SERVICES) -> list[str]:
        """Let every service ping all others by name once; give the pairs that do not."""
        ask = f"for n in {' '.join(SERVICES)}; do ping -q -c 1 -W 1 $n >/dev/null || echo $(hostname)-$n; done"

        def one(name: str) -> list[str]:
            return self.lab.shell(HOME[name], "docker", "exec", f"srprov.compass.{name}", "sh", "-c", ask).out.split()

        with ThreadPoolExecutor(len(names)) as pool:
            return sorted(pair for lost in pool.map(one, names) for pair in lost)

    def link(self, robot: str) -> str:
        """Give the name of a robot's VXLAN link, from the kernel."""
        return self.lab.shell(robot, "sh", "-c", "ip -o link show type vxlan").out.split(": ")[1]


@pytest.fixture(scope="module")
def compass(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Compass:
    """Bring the experiment up."""
    folder = tmp_path_factory.mktemp("compass")
    path = folder / "compass.edf"
    path.write_text(edf("compass", {name: busybox(robot=HOME[name]) for name in SERVICES}), encoding="utf-8")
    inventory = part_of_lab(lab_of_module, [*HOME.values()], folder / "lab.yml")
    made = Compass(lab_of_module, (str(path), "-i", inventory))
    made.apply()
    assert made.plan() == {}
    assert made.lost() == []
    return made


CONTAINER = "robot2/container:srprov.compass.north"
BY_HAND = {
    "container killed": ("docker kill srprov.compass.north", {CONTAINER: "update: exited with code 137"}),
    "container paused": ("docker pause srprov.compass.north", {CONTAINER: "update: paused"}),
    "container removed": ("docker rm -f srprov.compass.north", {CONTAINER: "create: not there"}),
    "link deleted": ("ip link del LINK", {"robot2/vxlan:LINK": "create: not there"}),
    "rule deleted": (
        "nft flush chain bridge LINK unpacked",
        {"robot2/vxlan_filter:LINK": "update: 2 of 7 rules are gone"},
    ),
    "firewall reloaded": (
        "nft delete table inet LINK; nft delete table bridge LINK",
        {"robot2/vxlan_filter:LINK": "create: not there: any host could send into the overlay"},
    ),
    "service's FDB entry deleted": (
        "set -- $(bridge fdb show dev LINK | grep -v ^00:00 | grep 'dst .* self permanent' | head -1); "
        "bridge fdb del $1 dev LINK dst $3",
        {"robot2/vxlan:LINK": "update: FDB: 1 to add, 0 to remove"},
    ),
    "flooding entry deleted": (
        "bridge fdb del 00:00:00:00:00:00 dev LINK dst "
        "$(bridge fdb show dev LINK | sed -n 's/^00:00.* dst \\([^ ]*\\) .*/\\1/p' | head -1)",
        {"robot2/vxlan:LINK": "update: FDB: 1 to add, 0 to remove"},
    ),
    "image removed": (
        "docker rmi -f busybox",
        {"robot2/image:busybox:latest": "create: not on the robot; pulled by the robot"},
    ),
    "hosts file edited": (f"echo 10.9.9.9 west > {HOSTS}", {f"robot2/file:{HOSTS}": "update: content differs"}),
}
"""Test -> what somebody does on robot2, and what `plan` says of it."""
RESTARTS = {name for name in BY_HAND if name.startswith("container")}


@pytest.mark.parametrize("what", BY_HAND)
def test_what_was_changed_by_hand_is_named_and_healed(compass: Compass, what: str) -> None:
    """`plan` names that one thing with its cause, `apply` changes that alone, and then nothing is left to do."""
    script, wanted = BY_HAND[what]
    link = compass.link("robot2")
    wanted = {step.replace("LINK", link): cause for step, cause in wanted.items()}
    before = compass.look()
    compass.lab.shell("robot2", "sh", "-ec", script.replace("LINK", link))
    if what == "link deleted":
        assert "north-west" in compass.lost(["north"])

    assert compass.plan() == wanted
    assert compass.apply() == set(wanted)
    assert compass.plan() == {}
    after = compass.look()
    untouched = [name for name in SERVICES if name != "north" or what not in RESTARTS]
    assert {name: after[name] for name in untouched} == {name: before[name] for name in untouched}
    assert all(state.endswith(" running") for state in after.values()), after
    assert compass.lost() == []


def test_two_robots_that_drift_are_healed_in_one_run(compass: Compass) -> None:
    """Drift on several robots shows as one step each, and services on other robots keep running."""
    before = compass.look()
    compass.lab.shell("robot1", "docker", "kill", "srprov.compass.east")
    compass.lab.shell("robot4", "docker", "rm", "-f", "srprov.compass.west")
    wanted = {
        "robot1/container:srprov.compass.east": "update: exited with code 137",
        "robot4/container:srprov.compass.west": "create: not there",
    }
    assert compass.plan() == wanted
    assert compass.apply() == set(wanted)
    after = compass.look()
    assert (after["north"], after["south"]) == (before["north"], before["south"])
    assert compass.plan() == {}
    assert compass.lost() == []


def test_a_network_that_was_pruned_under_a_dead_container(compass: Compass) -> None:
    """Docker starts a container only on the network that it was made on; so with a new network it is made anew."""
    before = compass.look()
    link = compass.link("robot2")
    compass.lab.shell("robot2", "sh", "-ec", "docker kill srprov.compass.north; docker network prune --force")
    done = compass.lab.srprov("apply", *compass.words, "--yes", "--settle", "0", "--json")
    assert done.code == 0, done
    assert [step["id"] for step in done.json["steps"]] == [
        CONTAINER,
        "robot2/network:srprov.compass",
        f"robot2/vxlan:{link}",
        CONTAINER,
    ]
    assert compass.plan() == {}
    after = compass.look()
    assert {n: s for n, s in after.items() if n != "north"} == {n: s for n, s in before.items() if n != "north"}
    assert compass.lost() == []


def test_a_robot_that_restarted_is_made_whole_again(compass: Compass) -> None:
    """After a robot's restart its link and its container come back, nothing else is touched, names and pings work."""
    before = compass.look()
    link = compass.link("robot3")
    restarted = compass.lab.srprov("lab", "restart", "robot3")
    assert restarted.code == 0, restarted
    plan = compass.plan()
    assert plan.pop(f"robot3/vxlan_filter:{link}") == "create: not there: any host could send into the overlay"
    assert plan.pop(f"robot3/vxlan:{link}") == "create: not there"
    assert plan.pop("robot3/container:srprov.compass.south").startswith("update: exited with code ")
    assert plan == {}
    kinds = ("vxlan", "vxlan_filter")
    assert compass.apply() == {*(f"robot3/{kind}:{link}" for kind in kinds), "robot3/container:srprov.compass.south"}
    assert compass.plan() == {}
    after = compass.look()
    assert {n: s for n, s in after.items() if n != "south"} == {n: s for n, s in before.items() if n != "south"}
    assert after["south"].split()[0] == before["south"].split()[0], "started again, not made anew"
    assert compass.lost() == []
