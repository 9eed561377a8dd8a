"""Paths of a robot in a plan file: in the one spelling that an engine, a shell and a policy all read alike."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.authority import check_file
from srprov.definitions.containermodel import Mount
from srprov.errors import UsageError
from tests.fakes import World
from tests.unit.controller.test_saved import planned, reread
from tests.worlds import experiment, service


@pytest.mark.parametrize("source", ["/bin/../var/lock/x", "/srv/./x", "/srv//x", "//srv/x", "/srv/x/", "srv/x"])
def test_a_path_that_is_looked_at_is_the_one_that_is_mounted(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An engine took `/bin/../var/lock/x` for what another container had put into `/run/lock`: a link to `/`."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    mounts = (Mount(kind="bind", source=source, target="/m", create_host_path=True),)
    saved = reread(planned(World().add("r1"), experiment(service("b", mounts=mounts))))
    assert [one.service for one in saved.plan.permissions if one.kind == "playbook"] == ["r1/container:srprov.hello.b"]
    left = tuple(one for one in saved.plan.permissions if one.kind != "playbook")
    with pytest.raises(UsageError, match=r"r1/container:srprov\.hello\.b asks for playbook"):
        check_file(replace(saved, plan=replace(saved.plan, permissions=left)), "plan.json")


def test_a_path_as_an_edf_has_it_is_asked_for_as_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What an EDF says is brought into that spelling before it is planned."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    mounts = (Mount(kind="bind", source="/srv/x", target="/m", create_host_path=True),)
    saved = reread(planned(World().add("r1"), experiment(service("b", mounts=mounts))))
    assert {one.kind for one in saved.plan.permissions} == {"host-path"}
    check_file(saved, "plan.json")
