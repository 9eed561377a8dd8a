"""Replicas, `per_robot`, pools and relations of an EDF: what they become, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import load_experiment
from srprov.definitions.expand import expand, nowhere
from srprov.definitions.model import Experiment, Pool
from srprov.errors import DefinitionError, UsageError
from tests.bounded import bounded

TAGS = {"Robot 1": ("camera",), "r2": (), "r3": ("camera", "arm")}


def read(tmp_path: Path, services: str, rest: str = "") -> Experiment:
    path = tmp_path / "e.edf"
    path.write_text(f"edf: 1\nname: e\nservices: {services}\n{rest}")
    loaded = load_experiment(path)
    assert loaded.unsupported == ()
    return loaded.experiment


def test_replicas_are_services_and_the_name_stands_for_all(tmp_path: Path) -> None:
    """In dependencies, pools and relations."""
    what = read(
        tmp_path,
        "{w: {image: x, replicas: 3}, a: {image: x, depends_on: {w: {condition: completed}}}, b: {image: x}}",
        "pools: [{services: [w, b], discount: 0.5}]\nrelations: {different_robot: [[w, a]]}\n",
    )
    one = expand(what, TAGS)
    assert list(one.services) == ["a", "b", "w-1", "w-2", "w-3"]
    assert dict(one.services["a"].depends_on) == dict.fromkeys(("w-1", "w-2", "w-3"), "completed")
    assert one.services["w-2"].instance_of == "w"
    assert one.pools == (Pool(name="b+w", services=("b", "w-1", "w-2", "w-3"), discount=0.5),)
    assert one.different_robot == (("a", "w-1", "w-2", "w-3"),)
    assert expand(one, TAGS) == one


def test_no_replica_at_all(tmp_path: Path) -> None:
    """What names the service names nobody then."""
    what = read(
        tmp_path, "{w: {image: x, replicas: 0}, a: {image: x, depends_on: [w]}}", "pools: [{services: [a, w]}]\n"
    )
    one = expand(what, TAGS)
    assert list(one.services) == ["a"]
    assert (dict(one.services["a"].depends_on), one.pools) == ({}, ())


def test_one_on_each_robot_with_the_tags(tmp_path: Path) -> None:
    """Pinned there, with a name that a host may have; one on a robot out of reach is kept."""
    what = read(tmp_path, "{cam: {image: x, per_robot: {tags: [camera]}}, a: {image: x, depends_on: [cam]}}")
    one = expand(what, TAGS, {"cam-r9": "r9", "a": "r8"})
    assert {name: service.robot for name, service in one.services.items() if service.instance_of} == {
        "cam-robot-1": "Robot 1",
        "cam-r3": "r3",
        "cam-r9": "r9",
    }
    assert list(one.services["a"].depends_on) == ["cam-r3", "cam-r9", "cam-robot-1"]


def test_without_tags_every_robot_runs_it(tmp_path: Path) -> None:
    """An empty list of tags is no condition."""
    assert len(expand(read(tmp_path, "{cam: {image: x, per_robot: {}}}"), TAGS).services) == 3


def test_what_runs_nowhere_is_told(tmp_path: Path) -> None:
    """With the tags that no robot has; of robots out of reach nobody knows."""
    what = read(tmp_path, "{a: {image: x, per_robot: {tags: [lidar]}}, cam: {image: x, per_robot: {tags: [camera]}}}")
    services = expand(what, TAGS).services.values()
    assert nowhere(what, services, away=False) == ("no robot has the tag 'lidar', so 'a' runs nowhere",)
    assert nowhere(what, services, away=True) == ("no robot in reach has the tag 'lidar', so 'a' runs nowhere",)
    bare = read(tmp_path, "{a: {image: x, per_robot: {}}}")
    assert nowhere(bare, (), away=True) == ("there is no robot in reach, so 'a' runs nowhere",)


@pytest.mark.parametrize(
    ("services", "rest", "message"),
    [
        ("{w: {image: x, replicas: 2}, w-2: {image: x}}", "", "'w-2' is also the name of an instance of 'w'"),
        ("{a: {image: x, per_robot: {}, robot: r1}}", "", "'robot' and 'per_robot' exclude each other"),
        ("{a: {image: x, per_robot: {}, replicas: 2}}", "", "'replicas' and 'per_robot' exclude each other"),
        ("{a: {image: x, per_robot: {}}, b: {image: x}}", "pools: [{services: [a, b]}]", "a pool cannot name it"),
        (
            "{a: {image: x, per_robot: {}}, b: {image: x}}",
            "relations: {different_robot: [[a, b]]}",
            "different_robot cannot name it",
        ),
        (
            "{a: {image: x, per_robot: {}}, b: {image: x}}",
            "relations: {same_robot: [[a, b]]}",
            "same_robot cannot name it",
        ),
        (
            "{a: {image: x}, b: {image: x}}",
            "relations: {same_robot: [[a, b]], different_robot: [[a, b]]}",
            "must run on different robots, but same_robot puts them on one",
        ),
        (
            "{a: {image: x}, b: {image: x}}",
            "pools: [{name: p, services: [a, b]}, {name: p, services: [a, b]}]",
            "there are two pools 'p'",
        ),
        (
            "{a: {image: x}, b: {image: x}}",
            "pools: [{services: [a, b]}, {services: [b, a], discount: 0.5}]",
            "there are two pools 'a+b'",
        ),
    ],
)
def test_what_cannot_be_is_told_at_its_line(tmp_path: Path, services: str, rest: str, message: str) -> None:
    """Before any robot is asked."""
    with pytest.raises(DefinitionError) as caught:
        read(tmp_path, services, rest)
    assert [message in problem.message for problem in caught.value.problems] == [True]


def test_two_instances_of_one_name_are_refused(tmp_path: Path) -> None:
    """Robots' names are only known when robots are."""
    with pytest.raises(UsageError, match="two services would be named 'cam-r-1'"):
        expand(read(tmp_path, "{cam: {image: x, per_robot: {}}}"), {"r 1": (), "r_1": (), "R-1": ()})


FEW_LINES = {
    "instances": ("".join(f"s{i}: {{image: x, replicas: 1000}}, " for i in range(11)), "11000 instances of services"),
    "waits": ("a: {image: x, replicas: 1000, depends_on: [b]}, b: {image: x, replicas: 1000}", "1000000 dependencies"),
    "text": (
        f"a: {{image: x, replicas: 1000, labels: {{a: {'a' * 20_000}}}}}",
        "bytes that containers are told to run",
    ),
    "text of one CDF": (
        "".join(f"s{i}: {{cdf: a.cdf}}, " for i in range(900)),
        "bytes that containers are told to run",
    ),
}


@pytest.mark.parametrize("case", FEW_LINES)
def test_few_lines_do_not_become_gigabytes(tmp_path: Path, case: str) -> None:
    """A plan has each container with all that it is told, and each of its dependencies."""
    services, says = FEW_LINES[case]
    (tmp_path / "a.cdf").write_text(f"cdf: 1\nname: a\nimage: x\nenvironment: {{A: {'a' * 20_000}}}\n")
    what = read(tmp_path, f"{{{services}}}")
    with pytest.raises(UsageError, match=says):
        bounded(lambda: expand(what, TAGS))


def test_as_many_instances_as_robots_count(tmp_path: Path) -> None:
    what = read(tmp_path, "{a: {image: x, per_robot: {tags: []}, depends_on: [b]}, b: {image: x, replicas: 1000}}")
    assert len(expand(what, {f"r{number}": () for number in range(100)}).services) == 1100
    with pytest.raises(UsageError, match="101000 dependencies between instances; 100000 are the most"):
        expand(what, {f"r{number}": () for number in range(101)})
