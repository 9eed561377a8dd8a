"""Robots choose how their containers are called; none gets what another one's containers send to a host by its name."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from srprov.snapshot.names_there import NamesThere
from tests.unit.controller.test_snapshot import Robot, box, taken


def with_config(made: dict[str, Any], **config: Any) -> dict[str, Any]:
    return {**made, "Config": {**made["Config"], **config}}


def on_network(made: dict[str, Any], *aliases: str) -> dict[str, Any]:
    return {**made, "NetworkSettings": {"Networks": {"shop": {"Aliases": list(aliases)}}}}


@pytest.mark.parametrize(
    "honest",
    [
        box(2, "web", ["URL=redis://redis:6379/0"]),
        with_config(box(2, "web"), Cmd=["web", "--cache=Redis"]),
        with_config(box(2, "web"), Entrypoint=["client", "-hredis"]),
        with_config(box(2, "web"), Cmd=["sh", "-c", "printf 'machine\\tredis\\tlogin a' > ~/.netrc; web"]),
        box(2, "web", ["URL=mq%3A%2F%2Fredis%3A6379"]),
        box(2, "web", ['HOSTS={"all": "a\\u0026redis"}']),
        with_config(box(2, "web"), Healthcheck={"Test": ["CMD", "nc", "redis", "6379"]}),
        on_network(box(2, "shop-redis-1"), "redis"),
        box(2, "web", ExtraHosts=["redis:10.0.0.9"]),
        box(2, "web", Links=["/shop-redis-1:/web/redis"]),
        box(2, "redis"),
    ],
)
def test_no_robot_has_a_name_by_which_others_mean_a_host(tmp_path: Path, honest: dict[str, Any]) -> None:
    """Neither by the name of a container nor by its hostname, whichever robot comes first."""
    for at, names in enumerate((("r1", "r2"), ("r2", "r1"))):
        lies = [box(1, "redis"), with_config(box(3, "other"), Hostname="REDIS")]
        robots = dict(zip(names, (Robot(boxes=lies), Robot(boxes=[honest])), strict=True))
        document, edf, _ = taken(tmp_path / f"out{at}", **robots)
        mine = {name: one for name, one in edf["services"].items() if one["robot"] == names[0] and "cdf" not in one}
        assert set(mine) == {f"redis-{names[0]}", "other"} and "hostname" not in mine["other"]
        assert "use the name redis for something else" in str(document)


def test_a_word_that_only_ends_like_a_name_is_another_one(tmp_path: Path) -> None:
    honest = box(2, "web", ["URL=http://predis/fastredis", "A=my-redis"])
    _, edf, _ = taken(tmp_path / "out", r1=Robot(boxes=[box(1, "redis")]), r2=Robot(boxes=[honest]))
    assert "redis" in edf["services"]


def test_a_name_with_the_robot_s_behind_it_is_none_of_others_either(tmp_path: Path) -> None:
    honest = box(2, "web", ["FIRST=redis:6379", "SECOND=redis-r1:6379"])
    _, edf, _ = taken(tmp_path / "out", r1=Robot(boxes=[box(1, "redis")]), r2=Robot(boxes=[honest]))
    assert "redis-r1-2" in edf["services"] and not {"redis", "redis-r1"} & edf["services"].keys()


def test_a_hostname_of_several_robots_takes_no_host_s_place(tmp_path: Path) -> None:
    """On its robot only that one's containers found it so; a robot by itself keeps it."""
    lies, harmless = with_config(box(1, "a"), Hostname="vault.lab.example"), with_config(box(2, "b"), Hostname="rover")
    document, edf, _ = taken(tmp_path / "two", r1=Robot(boxes=[lies, harmless]), r2=Robot(boxes=[box(3, "web")]))
    assert ("hostname" in edf["services"]["a"], edf["services"]["b"]["hostname"]) == (False, "rover")
    assert "its hostname vault.lab.example: containers of other robots" in str(document)
    _, edf, _ = taken(tmp_path / "one", r1=Robot(boxes=[lies, harmless]))
    assert edf["services"]["a"]["hostname"] == "vault.lab.example"


def with_volume(made: dict[str, Any], name: str) -> dict[str, Any]:
    return {**made, "Mounts": [{"Type": "volume", "Name": name, "Destination": "/data", "RW": True}]}


def test_no_robot_s_volume_has_a_container_of_another_left_out(tmp_path: Path) -> None:
    """Services of different robots cannot share one, and which of them stays would be the first robot's word."""
    lies = [with_volume(box(1, "a"), "pgdata"), with_volume(box(2, "b"), "pgdata-r2")]
    honest = [with_volume(box(3, "db"), "pgdata"), with_volume(box(4, "backup"), "pgdata")]
    document, edf, _ = taken(tmp_path / "out", r1=Robot(boxes=lies), r2=Robot(boxes=honest))
    names = {name: one["volumes"][0]["source"] for name, one in edf["services"].items() if "cdf" not in one}
    own = "pgdata-r2-2"
    assert names == {"a": "pgdata", "b": "pgdata-r2", "db": own, "backup": own}, "those of one robot share it as before"
    assert f"its volume pgdata is called {own} here: each name is one volume's" in str(document)
    assert "does not go together" not in str(document)


def test_a_volume_without_a_name_is_no_other_one_s(tmp_path: Path) -> None:
    """Two of one container were one, and whoever named his own so had it; who shared one did not."""
    two = [{"Type": "volume", "Name": 64 * at, "Destination": f"/{at}/data", "RW": True} for at in "ab"]
    boxes = [
        {**box(1, "db"), "Mounts": two},
        {**box(2, "backup"), "Mounts": two[:1]},
        with_volume(box(3, "other"), "db-data"),
    ]
    _, edf, _ = taken(tmp_path / "out", r1=Robot(boxes=boxes))
    (a, b), (shared,), (named,) = (
        [one["source"] for one in edf["services"][name]["volumes"]] for name in ("db", "backup", "other")
    )
    assert len({a, b, named}) == 3 and shared == a


def test_no_number_of_containers_has_some_of_another_robot_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("srprov.controller.snapshot._SERVICES", 5)
    lies, honest = ([box(at, f"{name}{at}") for at in range(2)] for name in ("lies", "honest"))
    document, edf, _ = taken(tmp_path / "out", r1=Robot(boxes=lies), r2=Robot(boxes=honest))
    assert {"lies0", "lies1"} <= edf["services"].keys() and not any(one.startswith("honest") for one in edf["services"])
    assert "more than 5 services: none is in it" in str(document)


def test_words_without_end_are_looked_at_in_time() -> None:
    begun = time.monotonic()
    long = {f"r{at}": [box(at, "x", [f"A={'a -b' * 200_000}"])] for at in range(10)}
    assert not NamesThere(long).mean_others("r1", "redis") and time.monotonic() - begun < 10


@pytest.mark.parametrize("first", ["r1", "r2"])
def test_no_robot_has_a_part_of_another_one_s_containers_left_out_by_what_it_fills(tmp_path: Path, first: str) -> None:
    """An experiment has at most a thousand secrets: what asks for a password was left out, and the rest was in it."""
    names = [first, *{"r1", "r2"} - {first}]
    lies = [box(at, f"s{at}", [f"K{at}_{key}_PASSWORD=wq8fhq27fh" for key in range(250)]) for at in (1, 2, 3, 4)]
    honest = [box(5, "login-proxy", ["ADMIN_PASSWORD=Zk3kq9fj2Lm"]), box(6, "db")]
    robots = dict(zip(names, (Robot(boxes=lies), Robot(boxes=honest)), strict=True))
    document, edf, _ = taken(tmp_path / "out", **robots)
    assert {name for name, one in edf["services"].items() if "cdf" not in one} == {"login-proxy", "db"}
    (note,) = [one for one in document["notes"] if "do not go together with those of other robots" in one["words"]]
    assert (note["robot"], note["subject"]) == (first, "containers")


def test_hosts_that_fill_the_experiment_leave_small_ones_what_they_have(tmp_path: Path) -> None:
    """All files of an experiment hold 2 MiB; the small robot is in it as a whole, whatever it is called."""

    def of(many: int, name: str) -> Robot:
        lines = "".join(f"ii \tp{at:05}{'x' * 92}\tamd64\t1\tno\toptional\t\t\n" for at in range(many))
        return Robot(shell={"packages": lines}, boxes=[box(1, name)])

    big = {f"r{at}": of(5999, f"big{at}") for at in range(4)}
    document, edf, _ = taken(tmp_path / "out", **big, r9=of(2, "small"))
    assert {"small", "r9-host", "big0", "r0-host"} <= edf["services"].keys(), document["notes"]
    assert "host r3: does not go together with other robots" in report(document) and "r3-host" not in edf["services"]
    assert not (tmp_path / "out/r3.cdf").exists() and (tmp_path / "out/r9.cdf").exists()


def report(document: dict[str, Any]) -> str:
    return "\n".join(f"{one['subject']}: {one['words']}" for one in document["notes"])
