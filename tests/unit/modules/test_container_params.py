"""What a playbook or a plan file may say of a container beside its run-time fields."""

from __future__ import annotations

import pytest

from srprov.modules.container_params import KEPT, ContainerParams
from srprov.modules.params import ParameterError
from tests.resources import resource

SAID = {
    "instance": "hello", "source": "lab@desk:e", "service": "web", "image": "busybox", "hostname": "web", "job": False,
    "run": {}, "mounts": [], "network": {"mode": "none"}, "api": "1.41",
}  # fmt: skip


def test_only_the_list_of_peers_makes_no_container_anew() -> None:
    """A plan told `RATE: 2 -> 4` of a container that a stranger's file made anew, and nothing of a second variable."""
    assert frozenset({"ROS_STATIC_PEERS"}) == KEPT  # network/discovery.py gives it
    kept = resource("container", "srprov.hello.web", {**SAID, "made_with": {"ROS_STATIC_PEERS": "a;b"}})
    assert isinstance(kept.params, ContainerParams)
    for made_with in ({"PERL5OPT": "-Mx"}, {"ROS_STATIC_PEERS": "a", "LD_PRELOAD": "/x"}):
        with pytest.raises(ParameterError, match="no container keeps"):
            resource("container", "srprov.hello.web", {**SAID, "made_with": made_with})


LONG = "x" * (192 << 10)


@pytest.mark.parametrize(
    ("said", "wrong"),
    [
        ({"run": {"labels": {"note": LONG}}}, "take more than 192 KiB together"),
        ({"run": {"command": [LONG]}}, "take more than 192 KiB together"),
        ({"run": {"environment": {"A": LONG}}}, "take more than 192 KiB together"),
        ({"run": {"user": 4 * LONG}}, "more than 512 KiB"),
        ({"mounts": [{"Type": "tmpfs", "Target": f"/{4 * LONG}"}]}, "more than 512 KiB"),
        ({"image": 4 * LONG}, "more than 512 KiB"),
        ({"hostname": "x" * 64}, "no host's name"),
    ],
)
def test_a_container_says_no_more_than_an_edf_could(said: dict[str, object], wrong: str) -> None:
    """The list of its robot's containers was too long to be read, for every verb and every instance."""
    with pytest.raises(ParameterError, match=wrong):
        resource("container", "srprov.hello.web", {**SAID, **said})
    most = {"run": {"labels": {"note": LONG[:-1000]}}, "mounts": [{"Type": "tmpfs", "Target": f"/{LONG}"}]}
    resource("container", "srprov.hello.web", {**SAID, **most})
