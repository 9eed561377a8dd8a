"""lab-spec.yml and the other pure parts of the lab."""

from __future__ import annotations

import pytest
import yaml

from srprov.errors import DefinitionError
from srprov.lab import inventory, places, users
from srprov.lab.figures import Amount, loadavg, meminfo
from srprov.lab.places import Site
from srprov.lab.spec import Robot, parse

GIB = 2**30


def problems(text: str) -> list[tuple[int, int, str]]:
    with pytest.raises(DefinitionError) as raised:
        parse(text, "lab-spec.yml")
    found = raised.value.problems
    return [(each.location.line, each.location.column, each.message) for each in found]


def test_every_option_is_read() -> None:
    text = """
count: 3
defaults: {slots: 2, tags: [ground]}
robots:
  robot1:
    tags: [on, 1.10]
    devices: [/dev/video0, /dev/snd/pcm0]
    load: 3.5
    memory: {total: 4G, used: 1GiB}
    swap: 512M
    docker: false
    user: robot
  robot2:
"""
    spec = parse(text, "lab-spec.yml")
    assert spec.count == 3
    assert spec.build(2) == [
        Robot(
            "robot1",
            tags=("on", "1.10"),
            devices=("/dev/video0", "/dev/snd/pcm0"),
            slots=2,
            load=3.5,
            memory=Amount(4 * GIB, GIB),
            swap=Amount(GIB // 2),
            docker=False,
            user="robot",
        ),
        Robot("robot2", tags=("ground",), slots=2),
    ]


def test_options_of_the_network_are_read_and_bounded() -> None:
    text = "robots: {robot1: {lan: 2, mtu: 9000}, robot2: {ipv6: true, mtu: 1280}}"
    assert parse(text, "lab-spec.yml").build(2) == [
        Robot("robot1", lan=2, mtu=9000),
        Robot("robot2", ipv6=True, mtu=1280),
    ]
    found = problems("defaults: {mtu: 1279}\nrobots: {robot1: {lan: 0}, robot2: {lan: 3}, robot3: {mtu: 9001}}")
    ranges = [
        "from 1280 to 9000, not '1279'",
        "from 1 to 2, not '0'",
        "from 1 to 2, not '3'",
        "from 1280 to 9000, not '9001'",
    ]
    assert [message for _, _, message in found] == [f"expected a whole number {each}" for each in ranges]


def test_an_empty_file_is_a_lab_without_options() -> None:
    assert parse("# nothing\n", "lab-spec.yml").build(1) == [Robot("robot1")]


def test_all_problems_come_at_once_with_their_places() -> None:
    text = "count: x\nrobots:\n  robot1: {tag: [a], docker: maybe}\n  r2: {}\n"
    assert problems(text) == [
        (1, 8, "expected a whole number from 1 to 200, not 'x'"),
        (3, 12, "unknown key 'tag'"),
        (3, 30, "expected true or false, not 'maybe'"),
        (4, 3, "'r2' is not robot1 .. robot200"),
    ]


def test_a_robot_that_is_there_twice_is_told_with_both_lines() -> None:
    assert problems("robots:\n  robot1: {}\n  robot1: {}\n") == [
        (3, 3, "duplicate key 'robot1'; it is already on line 2")
    ]


def test_a_spec_nested_without_end_is_one_problem() -> None:
    assert problems("robots: " + "[" * 500) == [(1, 69, "is nested more than 60 levels deep")]
    ((_, _, message),) = problems("robots: " + "[" * 5000)  # newer parsers have a limit of their own, further right
    assert message == "is nested more than 60 levels deep"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("latency: 5", "unknown key 'latency'"),
        ("tags: camera", "expected a list, not 'camera'"),
        ("tags: [~]", "expected text, not '~'"),
        ("slots: -1", "expected a whole number from 0 to 1000, not '-1'"),
        ("load: high", "expected a number from 0 to 1000, not 'high'"),
        ("devices: [/etc/passwd]", "'/etc/passwd' is not a device such as /dev/video0"),
        ("devices: [/dev/../etc/x]", "'/dev/../etc/x' is not a device such as /dev/video0"),
        ("devices: ['/dev/a b']", "'/dev/a b' is not a device such as /dev/video0"),
        ("devices: [/dev/]", "'/dev/' is not a device such as /dev/video0"),
        ("devices: [/dev/null]", "/dev/null is there already"),
        ("memory: lots", "expected a size such as 512M or 4G, not 'lots'"),
        ("memory: {used: 1G}", "total is missing"),
        ("memory: {total: 1G, used: 2G}", "used is more than total"),
        ("user: admin", "expected one of root, robot, not 'admin'"),
        ("arch: riscv64", "expected one of arm64, not 'riscv64'"),
    ],
)
def test_a_wrong_option_is_refused(options: str, message: str) -> None:
    assert [each[2] for each in problems(f"robots: {{robot1: {{{options}}}}}")] == [message]


def test_not_yaml_is_one_problem() -> None:
    assert len(problems("robots: [")) == 1


def test_a_count_too_small_for_the_robots_is_refused() -> None:
    found = problems("count: 2\nrobots: {robot3: {}}")
    assert [each[2] for each in found] == ["robot3 has options, but count is 2"]


def test_only_options_of_the_boot_ask_for_a_reboot() -> None:
    plain = Robot("robot1")
    assert Robot("robot1", tags=("a",), slots=3, user="robot").boot_digest == plain.boot_digest
    assert Robot("robot1", load=1.0).boot_digest != plain.boot_digest


def test_names_and_addresses() -> None:
    assert str(Site().address("robot1")) == "10.213.0.11"
    assert places.robot_number("robot200") == 200
    assert [places.robot_number(name) for name in ("robot0", "robot01", "robot201", "x")] == [None] * 4


def test_inventory_says_only_what_the_spec_says() -> None:
    robots = [Robot("robot1", tags=("on",), slots=0), Robot("robot2", user="robot")]
    found = yaml.safe_load(inventory.as_text(Site(), robots, None))["all"]
    assert found["hosts"] == {
        "robot1": {
            "ansible_host": "10.213.0.11",
            "ansible_user": "root",
            "srprov_tags": ["on"],
            "srprov_slots": 0,
        },
        "robot2": {"ansible_host": "10.213.0.12", "ansible_user": "robot"},
    }
    assert found["vars"]["ansible_ssh_common_args"].startswith("-o UserKnownHostsFile=/")


def test_robots_of_other_networks_have_addresses_of_these() -> None:
    """The inventory and the host keys go by LAN, and IPv6 is the underlay where a robot has it."""
    robots = [Robot("robot1", lan=2), Robot("robot2", ipv6=True)]
    hosts = yaml.safe_load(inventory.as_text(Site("a", 7), robots, None))["all"]["hosts"]
    assert hosts["robot1"] == {"ansible_host": "10.213.107.11", "ansible_user": "root"}
    assert hosts["robot2"] == {
        "ansible_host": "10.213.7.12",
        "ansible_user": "root",
        "srprov_underlay": "fd73:7270:6c61:7::c",
    }
    keys = dict.fromkeys(robots, "ssh-ed25519 AAAA")
    assert inventory.known_hosts(Site("a", 7), keys).splitlines() == [
        "10.213.107.11 ssh-ed25519 AAAA",
        "10.213.7.12,fd73:7270:6c61:7::c ssh-ed25519 AAAA",
    ]


def test_the_user_of_the_command_line_wins() -> None:
    text = inventory.as_text(Site(), [Robot("robot1", user="robot")], "root")
    assert yaml.safe_load(text)["all"]["hosts"]["robot1"]["ansible_user"] == "root"


def test_figures() -> None:
    assert loadavg(3.5) == "3.50 3.50 3.50 1/100 1000\n"
    real = "MemTotal:  9 kB\nMemFree:  8 kB\nCached:  5 kB\nDirty: 3 kB\nSwapFree: 0 kB\n"
    assert meminfo(real, Amount(4 * GIB, GIB), None).split("\n") == [
        "MemTotal:        4194304 kB",
        "MemFree:         3145728 kB",
        "Cached:                0 kB",
        "Dirty: 3 kB",
        "SwapFree: 0 kB",
        "",
    ]


def test_users_are_added_beside_the_machines_own() -> None:
    group, own = users.add_group("root:x:0:\ndocker:x:107:ann\nann:x:1000:\n", "robot")
    group, docker = users.add_group(group, "docker", ["robot"])
    assert (own, docker) == (1001, 107)
    assert group == "root:x:0:\ndocker:x:107:ann,robot\nann:x:1000:\nrobot:x:1001:\n"
    old = "root:x:0:0:root:/root:/bin/bash\nrobot:x:1000:1000::/:/bin/sh\n"
    passwd, user = users.add_user(old, "robot", own, "home/robot")
    assert user == 1000
    assert passwd.splitlines()[1] == "robot:x:1000:1001:robot:/home/robot:/bin/bash"
    assert users.shadow(passwd) == "root:*:19700:0:99999:7:::\nrobot:*:19700:0:99999:7:::\n"
