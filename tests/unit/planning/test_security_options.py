"""Which of a container's security options are more than they look."""

from __future__ import annotations

import pytest

from srprov.planning.graver import MAY_BE
from srprov.planning.security_options import PROFILE, UNCONFINED, of_security


@pytest.mark.parametrize(
    "option",
    [
        *("no-new-privileges", "no-new-privileges=true", "no-new-privileges:false", "seccomp=builtin"),
        *("apparmor=unconfined", "apparmor:docker-default", "label=disable"),
        "label:type:svirt_apache_t",
    ],
)
def test_what_leaves_a_container_its_capabilities_is_shown_as_it_is(option: str) -> None:
    """None of these gives it anything of the robot by itself."""
    assert list(of_security((option,))) == [("security-opt", option)]


@pytest.mark.parametrize("option", ["seccomp=unconfined", "seccomp:unconfined"])
def test_without_a_profile_a_container_reads_the_keys_of_root(option: str) -> None:
    """The kernel knows a user's keyrings by the user's number, and root of a container has that of root."""
    assert list(of_security((option,))) == [("security-opt", f"{UNCONFINED}: {option}")]


@pytest.mark.parametrize("option", ["seccomp={}", "seccomp:{}", "seccomp=unconfined ", "seccomp =x", "seccomp=/p.json"])
def test_a_profile_of_its_own_is_as_good_as_root(option: str) -> None:
    """By one that says of `capset` that it was done, a container keeps what is taken from it; pages cut long lines."""
    assert list(of_security((option,))) == [("security-opt", f"{PROFILE}: {option}")]


@pytest.mark.parametrize("option", ["writable-cgroups=true", "systempaths=unconfined", "x", "", "label=a\nb"])
def test_what_is_not_known_may_be_root(option: str) -> None:
    """A list of what is harmless is closed; engines learn new options."""
    assert list(of_security((option,))) == [("security-opt", f"{MAY_BE}: {option}")]
