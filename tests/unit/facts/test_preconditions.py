"""Doctor's judgement: every precondition has a verdict, and what is not right has a remedy."""

from __future__ import annotations

import json

import pytest
from msgspec.structs import replace

from srprov.cli.doctor import doctor_text
from srprov.facts.model import Docker, HostFacts
from srprov.facts.preconditions import Check, Clock, Verdict, judge, precondition_queries
from srprov.facts.runc import runc
from srprov.time_sync import TimeSync
from srprov.wire import Reply

WELL = HostFacts(
    name="r1",
    docker=Docker(version="29.5.1", api_version="1.54"),
    disk_free=50 * 2**30,
    underlay_link="eth0",
    underlay_address="10.0.0.1",
    underlay_mtu=1500,
    wireguard="kernel",
    user="root",
)
RIGHT = Clock(offset_s=0.0004, error_s=0.0015, kept_by=None)
RUNC = '{"Components": [{"Name": "containerd", "Version": "1.6.20"}, {"Name": "runc", "Version": "1.3.3"}]}'
GOOD = ("", "loaded\n", "1\n", '[{"ifname":"lo"}]', "nftables\n", RUNC, "")


def replies(*texts: str) -> list[Reply]:
    """Return shell replies that succeeded."""
    return [Reply(status=0, out=text) for text in texts]


def by_name(checks: tuple[Check, ...]) -> dict[str, Check]:
    """Return checks by their name."""
    return {check.name: check for check in checks}


def test_there_is_one_reply_for_each_question() -> None:
    """The table of good answers covers every question."""
    assert len(precondition_queries()) == len(GOOD)


def test_a_robot_that_has_all_is_well() -> None:
    """Nothing to say about a robot that has all."""
    checks = judge(WELL, replies(*GOOD), RIGHT)

    assert [check.name for check in checks if check.verdict is not Verdict.OK] == []
    assert all(not check.remedy for check in checks)


@pytest.mark.parametrize(
    ("change", "texts", "name", "verdict", "remedy"),
    [
        ({"privileged": False, "user": "pi"}, GOOD, "root", Verdict.FAILED, "sudo"),
        ({}, ("bridge\nflock\n", *GOOD[1:]), "programs", Verdict.FAILED, "apt-get install iproute2 util-linux"),
        ({}, (*GOOD[:3], "1: lo: <LOOPBACK>", *GOOD[4:]), "iproute2", Verdict.FAILED, "iproute2 5.0"),
        ({"docker": None, "docker_problem": "docker: not found"}, GOOD, "docker", Verdict.FAILED, "docker.io"),
        ({"wireguard": "", "wireguard_problem": "it has no wg"}, GOOD, "wireguard", Verdict.WARNING, "wireguard-tools"),
        ({"docker": Docker(version="29.5.1", api_version="1.40")}, GOOD, "docker", Verdict.FAILED, "update"),
        (
            {"docker": Docker(version="29.5.1", api_version="1.54", rootless=True)},
            GOOD,
            "docker",
            Verdict.FAILED,
            "rootful",
        ),
        ({}, (GOOD[0], "unknown\n", *GOOD[2:]), "vxlan", Verdict.WARNING, "linux-modules-extra-raspi"),
        ({"underlay_address": ""}, GOOD, "underlay", Verdict.FAILED, "srprov_underlay"),
        ({"underlay_mtu": 576}, GOOD, "mtu", Verdict.WARNING, "1280"),
        ({}, (*GOOD[:2], "0\n", *GOOD[3:]), "forwarding", Verdict.WARNING, "ip_forward"),
        ({}, (*GOOD[:4], "none\n", *GOOD[5:]), "rules", Verdict.FAILED, "apt-get install nftables"),
        ({}, (*GOOD[:5], RUNC.replace("1.3.3", "1.1.5+ds1"), ""), "runc", Verdict.WARNING, "1.2.8"),
        ({}, (*GOOD[:6], "avahi-daemon\n"), "avahi", Verdict.WARNING, "allow-interfaces=eth0 below"),
        ({}, (*GOOD[:6], "llmnr\nsystemd-resolve\n"), "resolved", Verdict.WARNING, "LLMNR=no"),
        ({}, (*GOOD[:6], "dhcpcd\n"), "dhcpcd", Verdict.WARNING, "denyinterfaces veth*"),
        ({"disk_free": 2**20}, GOOD, "disk", Verdict.WARNING, "prune"),
    ],
)
def test_what_is_missing_has_a_remedy(
    change: dict[str, object], texts: tuple[str, ...], name: str, verdict: Verdict, remedy: str
) -> None:
    """Exactly the check that is about it complains, and says what to do."""
    checks = by_name(judge(replace(WELL, **change), replies(*texts), RIGHT))  # type: ignore[arg-type] # table of fields

    assert (checks[name].verdict, [c.name for c in checks.values() if c.remedy]) == (verdict, [name])
    assert remedy in checks[name].remedy


def test_programs_that_nobody_asked_for_are_not_reported() -> None:
    """A robot that answers with other words cannot put them into our remedy."""
    checks = by_name(judge(WELL, replies("$(reboot)\n", *GOOD[1:]), RIGHT))

    assert checks["programs"].verdict is Verdict.OK


@pytest.mark.parametrize(
    ("version", "warned"),
    [
        ("29.5.1", False),
        ("29.5.2", False),
        ("29.10.0", False),
        ("30.0.0-rc.1", False),
        ("29.5.0", True),
        ("29.4.12", True),
        ("28.5.2", True),
        ("20.10.24+dfsg1", True),
        ("26.1.5+dfsg1", True),
        ("dev", True),
    ],
)
def test_an_engine_that_is_led_elsewhere_by_copies_is_told_once_for_all_robots(version: str, warned: bool) -> None:
    """It works with srprov all the same, so that a robot with nothing else is well."""
    docker = Docker(version=version, api_version="1.54")
    checks = judge(replace(WELL, docker=docker), replies(*GOOD), RIGHT)
    check = by_name(checks)["copies"]
    assert (check.verdict, check.found) == (Verdict.WARNING if warned else Verdict.OK, version)
    head, _, rest = doctor_text({"r2": checks, "r1": checks}).partition("\nwarning: ")
    assert head == "r1: all is well\nr2: all is well"
    assert rest == (f"copies: {version} (r1, r2)\n  {check.remedy}" if warned else "")
    assert not warned or all(one in check.remedy for one in ("root", "`srprov cp`", "29.5.1", "your distribution"))


def test_what_most_robots_have_is_told_with_who_has_what() -> None:
    """Ten names for each, so that a thousand robots are one line, too."""
    every = {f"r{number:02}": "20.10.24" for number in range(12)} | {"s": "28.0.1"}
    checks = {
        name: judge(replace(WELL, docker=Docker(version=version, api_version="1.41")), replies(*GOOD), RIGHT)
        for name, version in every.items()
    }
    line = doctor_text(checks).splitlines()[-2]
    names = ", ".join(f"r{number:02}" for number in range(10))
    assert line == f"warning: copies: 20.10.24 ({names} and 2 more), 28.0.1 (s)"


def test_without_an_engine_nothing_is_said_of_its_copies() -> None:
    assert by_name(judge(replace(WELL, docker=None), replies(*GOOD), RIGHT))["copies"].verdict is Verdict.OK


@pytest.mark.parametrize(
    ("version", "commit", "mended"),
    [
        ("1.2.8", "v1.2.8-0-geeb7e602", True),
        ("1.2.7", "v1.2.7-0-gb8dbf3f", False),
        ("1.3.2", "", False),
        ("1.3.6+ds1", "1.3.6+ds1-1", True),
        ("1.4.0", "", True),
        ("2.0.0", "", True),
        ("1.1.12", "v1.1.12-0-g51d5e946", False),
        ("1.1.5+ds1", "1.1.5+ds1-1+deb12u1", False),
        ("1.1.15+ds1", "1.1.15+ds1-2+deb13u1", True),
        ("1.1.15+ds1", "1.1.15+ds1-2", False),
        ("unknown", "", True),
    ],
)
def test_a_runc_that_lets_containers_out_is_told(version: str, commit: str, mended: bool) -> None:
    said = {"Components": [{"Name": "runc", "Version": version, "Details": {"GitCommit": commit}}]}
    found, words = runc(Reply(status=200, out=json.dumps(said)))
    assert found is mended
    assert version in words or version == "unknown"


@pytest.mark.parametrize(
    "out", ["", "[]", "{}", '{"Components": 7}', '{"Components": [{"Name": "runc", "Version": 7}]}']
)
def test_of_a_runc_that_is_not_told_nothing_is_said(out: str) -> None:
    assert runc(Reply(status=200, out=out))[0] and runc(Reply(status=0, out=out))[0]


@pytest.mark.parametrize(
    ("clock", "verdict", "found", "remedy"),
    [
        (RIGHT, Verdict.OK, "+0.4 ms (+-1.5 ms) from the controller; nothing known keeps it", ""),
        (Clock(offset_s=-7.0, error_s=0.001, kept_by=None), Verdict.WARNING, "-7.00 s (+-1.0 ms)", "chrony"),
        (Clock(offset_s=1.2, error_s=0.3, kept_by=None), Verdict.OK, "+1.20 s (+-300.0 ms)", ""),
        (Clock(offset_s=None, error_s=0.0, kept_by=None), Verdict.WARNING, "it gives no time", "chrony"),
        (
            Clock(offset_s=0.0, error_s=0.001, kept_by=TimeSync(daemon="chrony", synchronised=True, bound_s=0.0021)),
            Verdict.OK, "; chrony: synchronised, within 2.1 ms of its source", "",
        ),
        (
            Clock(offset_s=0.0, error_s=0.001, kept_by=TimeSync(daemon="timesyncd", synchronised=False)),
            Verdict.WARNING, "; timesyncd: not synchronised", "give timesyncd a time server",
        ),
    ],
)  # fmt: skip
def test_a_clock_is_judged_by_its_bounds_and_by_what_keeps_it(
    clock: Clock, verdict: Verdict, found: str, remedy: str
) -> None:
    check = by_name(judge(WELL, replies(*GOOD), clock))["clock"]

    assert check.verdict is verdict
    assert found in check.found and remedy in check.remedy
    assert bool(check.remedy) == bool(remedy)
