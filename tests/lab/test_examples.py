"""Every example does its job on real robots: what its README promises stands in the containers' own logs."""

from __future__ import annotations

import csv
import itertools
import re
import statistics
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.lab.conftest import NOTHING, ROOT, Done, Lab, part_of_lab
from tests.lab.looks import address_of, begin, log_of, wait_until

pytestmark = pytest.mark.lab


@dataclass(frozen=True)
class Running:
    """An example that was applied on robots of its own."""

    lab: Lab
    name: str
    path: str
    inventory: str
    report: dict[str, Any]
    """What `apply --json` said of it."""

    @property
    def home(self) -> dict[str, str]:
        """Service -> robot."""
        homes = self.report["assignment"]
        assert isinstance(homes, dict)
        return homes

    def log(self, service: str) -> list[str]:
        """Give the service's log as Docker on its robot has it."""
        return log_of(self.lab, self.home[service], f"srprov.{self.name}.{service}")

    def numbers(self, service: str, pattern: str) -> list[int]:
        """Give the numbers of the messages in a service's log; each line of that kind must be whole."""
        return [int(found[1]) for line in self.log(service) if (found := re.fullmatch(pattern, line))]

    def heard(self) -> list[list[int]]:
        """Give the numbers that each subscriber of the publisher heard."""
        pattern = r"heard: hello from publisher #([0-9]+)"
        return [self.numbers(service, pattern) for service in ("subscriber-a", "subscriber-b")]


@pytest.fixture(scope="module")
def coming_up(
    lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, tuple[str, Future[Done]]]]:
    """Bring all examples up at once, as two of them wait for packages most of the time; each has three robots."""
    lab, folder = lab_of_module, tmp_path_factory.mktemp("inventories")
    with ThreadPoolExecutor(len(ALL)) as pool:
        begun = dict[str, tuple[str, Future[Done]]]()
        for number, name in enumerate(ALL):
            robots = [f"robot{3 * number + one}" for one in (1, 2, 3)]
            inventory = part_of_lab(lab, robots, folder / f"{name}.yml")
            words = ("apply", path_of(name), "-i", inventory, "--yes", "--json")
            begun[name] = inventory, pool.submit(lab.srprov, *words)
        yield begun


@pytest.fixture(scope="module")
def example(request: pytest.FixtureRequest, lab_of_module: Lab, coming_up: Any) -> Iterator[Running]:
    """Wait until one example is up, and check in the end that it goes away without a trace."""
    lab, name = lab_of_module, str(request.param)
    inventory, begun = coming_up[name]
    up = begun.result()
    assert up.code == 0, up
    yield Running(lab, name, path_of(name), inventory, up.json)
    gone = lab.srprov("destroy", path_of(name), "-i", inventory, "--yes", "--json")
    assert gone.code == 0, gone
    assert [lab.leftovers(robot) for robot in set(up.json["assignment"].values())] == [NOTHING] * 3


def path_of(name: str) -> str:
    """Give where an example's EDF is."""
    return str(ROOT / "examples" / name / "experiment.edf")


ALL = ["hello", "chatter-dds", "chatter-ros"]
SERVICES = {
    "hello": ["greeter", "once", "web"],
    "chatter-ros": ["listener", "rosmaster", "talker"],
    "chatter-dds": ["publisher", "subscriber-a", "subscriber-b"],
}


@pytest.mark.parametrize("example", ["hello"], indirect=True)
def test_the_greeter_fetches_the_greeting_from_another_robot(example: Running) -> None:
    """The greeter's own log has the text of the folder beside the EDF; `web` saw who asked; the job ended with 0."""
    home = example.home
    assert len(set(home.values())) == 3, "one slot per robot"
    greeting = (ROOT / "examples" / "hello" / "www" / "greeting.txt").read_text(encoding="utf-8").strip()
    wanted = f"web says: {greeting}"
    wait_until(lambda: example.log("greeter").count(wanted) >= 3, 15, "three greetings")
    asker = address_of(example.lab, home["greeter"], "srprov.hello.greeter")
    asked = [line for line in example.log("web") if asker in line]
    assert any("response:200" in line for line in asked), example.log("web")
    state = example.lab.inspect(home["once"], "srprov.hello.once")["State"]
    assert (state["Status"], state["ExitCode"]) == ("exited", 0)
    assert greeting in "\n".join(example.log("once"))


@pytest.mark.parametrize("example", ["chatter-dds"], indirect=True)
def test_dds_finds_its_peers_by_multicast_and_all_hear_the_publisher(example: Running) -> None:
    """Nothing names a peer, and yet both subscribers, on other robots, hear every message from some number on."""
    home = example.home
    assert len(set(home.values())) == 3
    hear, say = r"heard: hello from publisher #([0-9]+)", r"said: hello from publisher #([0-9]+)"
    for service in ("subscriber-a", "subscriber-b"):
        heard = wait_until(lambda s=service: len(n := example.numbers(s, hear)) >= 5 and n, 40, f"five of {service}")
        assert heard == list(range(heard[0], heard[0] + len(heard))), "in order, none lost"
        assert set(heard) <= set(example.numbers("publisher", say))
        # configured peers would make this example say nothing of multicast
        details = example.lab.inspect(home[service], f"srprov.chatter-dds.{service}")
        assert not [one for one in details["Config"]["Env"] if "CYCLONE" in one.upper()]
        publisher = address_of(example.lab, home["publisher"], "srprov.chatter-dds.publisher")
        assert publisher not in " ".join([*details["Config"]["Env"], *details["Config"]["Cmd"]])


@pytest.mark.parametrize("example", ["chatter-dds"], indirect=True)
def test_static_peers_are_found_where_multicast_is_off(example: Running) -> None:
    """With multicast stopped between all robots, a publisher that comes back is heard with a list of peers alone."""
    lab, path = example.lab, str(ROOT / "examples" / "chatter-dds" / "static-peers.edf")
    done = lab.srprov("apply", path, "-i", example.inventory, "--yes", "--settle", "0", "--json")
    assert done.code == 0, done
    peers = Running(lab, "chatter-dds-peers", path, example.inventory, done.json)
    for one in (example, peers):
        wait_until(lambda one=one: all(one.heard()), 40, f"all subscribers of {one.name} hear the publisher")
    flood(lab, example.home.values(), "off")
    for one in (example, peers):
        assert lab.srprov("restart", one.path, "-i", one.inventory, "publisher", "--yes").code == 0
    wait_until(lambda: all(map(began_again, peers.heard())), 40, "they hear the new publisher")
    said = r"said: hello from publisher #([0-9]+)"
    wait_until(lambda: example.numbers("publisher", said)[-1] >= 6, 20, "three seconds of the other publisher")
    assert not any(map(began_again, example.heard())), "its participants know of each other by multicast only"
    flood(lab, example.home.values(), "on")
    assert lab.srprov("restart", example.path, *example.home, "-i", example.inventory, "--yes").code == 0
    assert lab.srprov("destroy", path, "-i", example.inventory, "--yes").code == 0


def began_again(numbers: list[int]) -> bool:
    """Say whether what was heard begins a second time."""
    return any(after < before for before, after in itertools.pairwise(numbers))


def flood(lab: Lab, robots: Iterable[str], how: str) -> None:
    """Have VXLAN links carry multicast to other robots, or not."""
    script = (
        f"for one in $(ls /sys/class/net | grep ^srpv); do bridge link set dev $one mcast_flood {how} || exit; done"
    )
    for robot in robots:
        lab.shell(robot, "sh", "-c", script)


def search(lab: Lab, coming_up: Any, folder: Path, *wanted: str) -> dict[str, dict[str, float]]:
    """Run trials of the search on robots that have all but the top of its image; MEMBERS -> target -> time to find."""
    inventory, begun = coming_up["chatter-dds"]
    assert begun.result().code == 0, begun.result()
    robots = list(yaml.safe_load(Path(inventory).read_text())["all"]["hosts"])
    slots = {robot: {"srprov_slots": 2} for robot in robots}
    inventory = part_of_lab(lab, robots, folder / "search.yml", **slots)
    words = (path_of("search"), "-i", inventory)
    running = begin(lab, "run", *words, "-o", str(folder / "run"), "--yes", *wanted)
    said = running.communicate(timeout=1200)
    gone = lab.srprov("destroy", *words, "--yes")
    assert (running.returncode, gone.code) == (0, 0), (said, gone)
    found: dict[str, dict[str, float]] = {}
    with (folder / "run" / "trials.csv").open(newline="") as stream:
        for row in csv.DictReader(stream):
            assert row["status"] == "ok", row
            found.setdefault(row["p_MEMBERS"], {})[row["seed"]] = float(row["m_time_to_find"])
    return found


def test_four_robots_find_a_target_faster_than_one_as_they_divide_the_area(
    lab_of_module: Lab, coming_up: Any, tmp_path: Path
) -> None:
    """They hear each other, each sees a part of the area first, and the base's result has the time."""
    trials = lab_of_module.srprov("trials", path_of("search"), "--json").json["trials"]
    ids = {one["parameters"]["MEMBERS"]: one["trial"] for one in trials if one["repetition"] == 1}
    found = search(lab_of_module, coming_up, tmp_path, "--only", ids["1"], "--only", ids["4"])
    ((seed, alone),) = found["1"].items()
    assert found["4"][seed] < 0.8 * alone, found
    logs = {m: tmp_path / "run" / "trials" / ids[m] / "logs" for m in ("1", "4")}
    said = {one: next(logs["4"].glob(f"*.robot-{one}.log")).read_text() for one in range(1, 5)}
    for one, text in said.items():
        assert f"heard {[other for other in said if other != one]}\n" in text
    (base,) = logs["4"].glob("*.base.log")
    drawn = re.findall(r"Z ([1-4.]{24})$", base.read_text(), re.MULTILINE)
    seen = {robot: "".join(drawn).count(robot) for robot in "1234"}
    assert len(drawn) == 24 and min(seen.values()) > 20, base.read_text()
    assert all(next(logs["1"].glob(f"*.robot-{one}.log")).read_text().count("idle: 1 of") for one in (2, 3, 4))


@pytest.mark.soak
@pytest.mark.timeout(1500)
def test_more_members_find_targets_faster_on_average(lab_of_module: Lab, coming_up: Any, tmp_path: Path) -> None:
    """The whole of the example: ten targets, each with one robot, two and four."""
    found = search(lab_of_module, coming_up, tmp_path)
    assert [len(times) for times in found.values()] == [10, 10, 10]
    assert len({tuple(sorted(times)) for times in found.values()}) == 1, "the same seeds for each number"
    one, two, four = (statistics.mean(found[members].values()) for members in ("1", "2", "4"))
    assert four < 0.8 * two < 0.8 * 0.8 * one, (one, two, four)


@pytest.mark.parametrize("example", ["chatter-ros"], indirect=True)
def test_the_listener_hears_the_talker_on_another_robot(example: Running) -> None:
    """ROS 1 works across robots: the listener's log has the talker's messages, numbers rising by one."""
    assert len(set(example.home.values())) == 3
    hear = r"heard: hello from talker on talker #([0-9]+)"
    heard = wait_until(lambda: len(n := example.numbers("listener", hear)) >= 5 and n, 40, "five messages")
    assert heard == list(range(heard[0], heard[0] + len(heard)))
    assert set(heard) <= set(example.numbers("talker", r"said: hello from talker on talker #([0-9]+)"))


@pytest.mark.parametrize("example", ALL, indirect=True)
def test_status_and_logs_show_the_example_as_docker_does(example: Running) -> None:
    """`status` names each service's robot, state, address and container; `logs` has each service's lines by name."""
    lab, name, home = example.lab, example.name, example.home
    assert sorted(home) == SERVICES[name]
    seen = lab.srprov("status", example.path, "-i", example.inventory, "--json")
    assert seen.code == 0, seen
    rows = {row["service"]: row for row in seen.json["services"]}
    assert sorted(rows) == SERVICES[name]
    for service, row in rows.items():
        real = lab.inspect(home[service], f"srprov.{name}.{service}")
        (end,) = real["NetworkSettings"]["Networks"].values()
        assert (row["instance"], row["robot"], row["address"]) == (name, home[service], end["IPAddress"])
        assert real["Id"].startswith(row["container"])
        assert row["state"].startswith("Exited (0)" if service == "once" else "Up ")
        assert row["health"] == real["State"].get("Health", {}).get("Status", "")
        assert row["image"].removesuffix(":latest") == real["Config"]["Image"].removesuffix(":latest")

    text = lab.srprov("status", example.path, "-i", example.inventory)
    assert text.code == 0, text
    heading, *lines = text.out.splitlines()
    assert heading.split()[:4] == ["INSTANCE", "SERVICE", "ROBOT", "STATE"]
    assert [line.split()[:3] for line in lines] == [[name, s, home[s]] for s in SERVICES[name]]

    shown = lab.srprov("logs", example.path, "-i", example.inventory, "--tail", "1000")
    assert shown.code == 0, shown
    by_service: dict[str, list[str]] = {}
    for line in shown.out.splitlines():
        service, bar, said = line.partition(" | ")
        assert bar, line
        by_service.setdefault(service.strip(), []).append(said)
    for service in SERVICES[name]:
        # the log goes on meanwhile: what Docker showed a moment later begins with what srprov showed
        whole = log_of(lab, home[service], f"srprov.{name}.{service}")
        mine = by_service.get(service, [])
        assert mine == whole[: len(mine)]
        assert bool(mine) == bool(whole)
    some = SERVICES[name][0]
    tail = lab.srprov("logs", example.path, "-i", example.inventory, "--tail", "2", some)
    assert tail.code == 0, tail
    assert [line.split(" | ")[0].strip() for line in tail.out.splitlines()] == [some] * 2
    assert lab.srprov("logs", example.path, "-i", example.inventory, "nobody").code == 5
