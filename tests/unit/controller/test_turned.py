"""What a container mounts leads where it led when that was made, or nothing is copied; by a shell of this machine."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from srprov.controller.turned import refuse_turned
from srprov.errors import RefusedError
from srprov.led import LED
from srprov.session import Reader
from srprov.wire import AnyQuery, EngineQuery, Query, Reply


class Robot:
    """One that says of each container the same."""

    host = "robot1"
    identity = "robot1"

    def __init__(self, led: Mapping[str, str], mounts: Sequence[Mapping[str, Any]]) -> None:
        self.about = {"Mounts": mounts, "Config": {"Labels": {LED: json.dumps(led)}}}

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        return [self._one(query) for query in queries]

    def measure(self) -> None:
        return None

    def _one(self, query: AnyQuery) -> Reply:
        if isinstance(query, EngineQuery):
            return Reply(status=200, out=json.dumps(self.about))
        assert isinstance(query, Query)
        done = subprocess.run(["sh"], input=query.command, capture_output=True, text=True, check=False)
        return Reply(status=done.returncode, out=done.stdout, ok=done.returncode == 0)


def looked(led: Mapping[str, str], kind: str = "bind") -> None:
    robot: Reader = Robot(led, [{"Type": kind, "Source": path} for path in led])
    refuse_turned(robot, "srprov.x.a")


def test_nothing_is_copied_by_way_of_a_link_that_came_since(tmp_path: Path) -> None:
    """Another container turned that path to a third one's secrets: `cp` brought one home, and wrote there."""
    maps, other = tmp_path / "it's maps", tmp_path / "other"
    maps.mkdir()
    other.mkdir()
    led = {str(maps): str(maps)}
    looked(led)
    maps.rmdir()
    looked(led)  # the engine tells that nothing is there
    maps.symlink_to(other)
    with pytest.raises(RefusedError, match=f"maps on robot1 leads to {other}, and to {maps} when srprov.x.a was made"):
        looked(led)
    looked({str(maps): str(other)})
    looked(led, "volume")  # a label of the image's
    maps.unlink()
    maps.symlink_to(maps.name)
    with pytest.raises(RefusedError, match="leads to what cannot be told"):
        looked(led)


def test_of_a_container_without_the_label_nothing_is_asked() -> None:
    looked({})


@pytest.mark.parametrize(
    "reply", [Reply(status=200, out="[" * 100), Reply(status=0, ok=False, err="its answer is longer than 8 MiB")]
)
def test_what_cannot_be_read_is_not_taken_for_a_container_without_a_label(reply: Reply) -> None:
    robot = Robot({}, [])
    robot._one = lambda query: reply  # type: ignore[method-assign]
    with pytest.raises(RefusedError, match=r"what the engine on robot1 says of srprov\.x\.a cannot be read"):
        refuse_turned(robot, "srprov.x.a")
    robot._one = lambda query: Reply(status=404, ok=False, err="no such container")  # type: ignore[method-assign]
    refuse_turned(robot, "srprov.x.a")  # whoever copies says so


def test_a_robot_that_cannot_look_does_not_say_that_all_is_as_it_was(tmp_path: Path) -> None:
    robot = Robot({str(tmp_path): str(tmp_path)}, [{"Type": "bind", "Source": str(tmp_path)}])
    answer = robot._one
    late = Reply(status=1, ok=False, err="sh: cannot fork")
    robot._one = lambda query: answer(query) if isinstance(query, EngineQuery) else late  # type: ignore[method-assign]
    with pytest.raises(RefusedError, match=r"srprov\.x\.a on robot1 lead cannot be told: sh: cannot fork"):
        refuse_turned(robot, "srprov.x.a")


def test_many_long_paths_are_looked_at_as_one_is(tmp_path: Path) -> None:
    """Their label is longer than others may be."""
    paths = [tmp_path / ("x" * 240) / ("y" * 240) / f"{number}{'z' * 240}" for number in range(45)]
    for path in paths:
        path.mkdir(parents=True)
    led = {str(path): str(path) for path in paths}
    assert len(json.dumps(led)) > 1 << 16
    paths[-1].rmdir()
    paths[-1].symlink_to(paths[0])
    with pytest.raises(RefusedError, match=r"/44z+ on robot1 leads to"):
        looked(led)
