"""Data sets in plans: by hash, with their permission, and from files only in plans that were written here."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.authority import check_file
from srprov.controller.data_sets import data_set, refuse_files, used_data
from srprov.controller.pins import file_hashes
from srprov.definitions.containermodel import Mount
from srprov.errors import RefusedError, UsageError
from srprov.modules.params import ParameterError
from srprov.planning.planfile import dump
from srprov.resource import Resource
from tests.fakes import World
from tests.resources import resource
from tests.unit.controller.test_saved import planned, reread
from tests.worlds import experiment, service

SHA = hashlib.sha256(b"test").hexdigest()


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Give a file of four bytes."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "f").write_text("test")
    return str(tmp_path / "f")


def test_a_file_has_the_hash_that_it_has(file: str) -> None:
    place = f"/var/lib/srprov/hello/data/{SHA}"
    for said in ("", SHA):
        mount = Mount(kind="data", source=file, target="/d", read_only=True, sha256=said)
        assert data_set("hello", mount) == {"path": place, "sha256": SHA, "size": 4, "url": ""}


def test_a_file_with_another_hash_or_that_is_gone_is_an_error(file: str) -> None:
    with pytest.raises(UsageError, match=f"has the sha256 {SHA}, not {'0' * 64}"):
        data_set("hello", Mount(kind="data", source=file, target="/d", sha256="0" * 64))
    with pytest.raises(UsageError, match="cannot be shipped"):
        data_set("hello", Mount(kind="data", source=f"{file}-none", target="/d"))


def test_the_lock_has_its_hash(file: str) -> None:
    """That of a download stands in the EDF."""
    mounts = (
        Mount(kind="data", source=file, target="/d"),
        Mount(kind="data", source="", target="/e", sha256="0" * 64, url="https://example.org/x"),
    )
    assert list(file_hashes(experiment(service("a", mounts=mounts)), []).values()) == [SHA]


def test_what_several_services_use_is_one_data_set(file: str) -> None:
    mounts = [Mount(kind="data", source=file, target=target, read_only=True) for target in ("/d", "/e")]
    data = {mount: data_set("hello", mount) for mount in mounts}
    services = [service("a", mounts=(mounts[0],)), service("b", mounts=(mounts[1],)), service("c")]
    assert used_data(data, services) == [data[mounts[0]]]
    assert used_data(data, services[2:]) == []


def test_a_plan_from_elsewhere_gets_no_file_of_this_machine() -> None:
    """It would only have to name a hash; what it has downloaded it has to ask for."""
    name = f"/var/lib/srprov/hello/data/{SHA}"
    url = "https://example.org/x"
    refuse_files([resource("data", name, {"sha256": SHA, "url": url}), resource("file", "/x", {"content": ""})])
    with pytest.raises(RefusedError, match=SHA):
        refuse_files([resource("data", name, {"sha256": SHA})])


def test_a_plan_file_has_the_hash_and_no_path(file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What comes out of it is what was planned; and a download is asked for by its values, whatever stands there."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    download = Mount(kind="data", source="", target="/e", read_only=True, sha256="0" * 64, url="https://example.org/x")
    mounts = (Mount(kind="data", source=file, target="/d", read_only=True), download)
    saved = reread(planned(World().add("r1"), experiment(service("a", mounts=mounts))))
    text = dump(saved)
    assert SHA in text and file not in text
    (asked,) = [one for one in saved.plan.permissions if one.kind == "fetch"]
    assert asked.what == "https://example.org/x, downloaded by this machine"
    (container,) = [step.want.params for step in saved.plan.steps if step.want and step.module == "container"]
    assert {(one["Source"], one["ReadOnly"]) for one in container.mounts if "/.data/" in one["Source"]} == {
        (f"/var/lib/srprov/.data/{SHA}/data", True),
        (f"/var/lib/srprov/.data/{'0' * 64}/data", True),
    }
    silent = replace(saved, plan=replace(saved.plan, permissions=()))
    with pytest.raises(UsageError, match="asks for fetch"):
        check_file(silent, "plan.json")


def test_who_mounts_a_data_set_in_a_plan_file_states_it(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hash is no secret: it alone gave a stranger's container what the robot had for others."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    mounts = (Mount(kind="data", source=file, target="/d", read_only=True),)
    saved = reread(planned(World().add("r1"), experiment(service("a", mounts=mounts))))
    steps = tuple(step for step in saved.plan.steps if step.module != "data")
    assert len(steps) < len(saved.plan.steps)
    with pytest.raises(UsageError, match=r"r1/container:srprov\.hello\.a asks for playbook"):
        check_file(replace(saved, plan=replace(saved.plan, steps=steps)), "plan.json")


def test_who_mounts_a_data_set_in_a_plan_file_needs_what_states_it(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A container that did not need it was made also when the data set came with another hash, or did not come."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    mounts = (Mount(kind="data", source=file, target="/d", read_only=True),)
    saved = reread(planned(World().add("r1"), experiment(service("a", mounts=mounts))))
    check_file(saved, "plan.json")
    for condition in ("", "after"):
        steps = tuple(replace(step, want=_changed_needs(step.want, condition)) for step in saved.plan.steps)
        with pytest.raises(UsageError, match=r"r1/container:srprov\.hello\.a asks for playbook"):
            check_file(replace(saved, plan=replace(saved.plan, steps=steps)), "plan.json")


def _changed_needs(want: Resource | None, condition: str) -> Resource | None:
    """Return what needs data sets only in another way, or not at all."""
    if want is None:
        return None
    data = [need for need in want.needs if "/data:" in need.id]
    others = [need for need in want.needs if need not in data]
    return replace(want, needs=(*others, *(replace(need, condition=condition) for need in data if condition)))


@pytest.mark.parametrize(
    "written", [{"sha256": "x"}, {"sha256": SHA, "url": "http://x/y"}, {"sha256": SHA, "url": "https://x/y\nz"}]
)
def test_what_no_edf_could_say_is_refused(written: dict[str, str]) -> None:
    with pytest.raises(ParameterError):
        resource("data", f"/var/lib/srprov/hello/data/{SHA}", written)
