"""A profile of seccomp in an EDF, on a real robot: what it makes of a container, and whether the plan says so."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from srprov.planning.security_options import PROFILE
from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot1"
DONE = {"action": "SCMP_ACT_ERRNO", "errnoRet": 0}
NO_DROP = {"index": 0, "value": 24, "op": "SCMP_CMP_EQ"}
"""PR_CAPBSET_DROP"""
KEEPS_ALL = {
    "defaultAction": "SCMP_ACT_ALLOW",
    "syscalls": [{"names": ["capset"], **DONE}, {"names": ["prctl"], **DONE, "args": [NO_DROP]}],
}
SYS_ADMIN = 21


def test_the_plan_says_that_a_profile_leaves_a_container_all_capabilities(lab: Lab, tmp_path: Path) -> None:
    """The engine's calls that take them away count as done: the container may do what root of the robot may."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    path = tmp_path / "profile.edf"
    service = busybox(security_opt=[f"seccomp={json.dumps(KEEPS_ALL)}"])
    path.write_text(edf("profile", {"a": service}), encoding="utf-8")
    words = (str(path), "-i", inventory)

    planned = lab.srprov("plan", *words)
    assert PROFILE in " ".join(planned.out.split()), planned
    refused = lab.srprov("apply", *words, "--yes")
    assert refused.code == 9 and PROFILE in refused.err, refused

    done = lab.srprov("apply", *words, "--yes", "--allow", "security-opt", "--settle", "0", "--no-probe")
    assert done.code == 0, done
    said = lab.shell(ROBOT, "docker", "exec", "srprov.profile.a", "grep", "CapEff", "/proc/1/status").out
    assert int(said.split()[1], 16) >> SYS_ADMIN & 1, "engines mend it: say so in docs/policy.md"
