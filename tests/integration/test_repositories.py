"""Code repositories in a plan: together with all else that is shipped they have one limit, and each is read once."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov import disk
from srprov.controller.repositories import Repositories
from srprov.definitions.containermodel import ContainerDefinition, Repository
from srprov.git import cache
from srprov.images.tag import plan_image
from tests.integration.test_git import Server


def _cdf(*servers: Server) -> ContainerDefinition:
    found = [Repository(url=one.address.url, ref="main", path=f"/r/{i}") for i, one in enumerate(servers)]
    return ContainerDefinition(name="a", file="/a.cdf", folder="/", base="x", repositories=tuple(found))


@pytest.fixture
def servers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Server]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    made = [Server(tmp_path / f"server{i}") for i in range(2)]
    for one in made:
        one.commit(a="x" * 1000)
    return made


def test_what_is_beyond_the_limit_of_all_is_refused_before_it_is_read(
    servers: list[Server], monkeypatch: pytest.MonkeyPatch
) -> None:
    cdf = _cdf(*servers)
    taken = Repositories([cdf])
    read = []
    contents = cache._contents
    monkeypatch.setattr(cache, "_contents", lambda place, found: read.append(place) or contents(place, found))
    with disk.together():
        budget = disk._budget.get()
        assert budget is not None
        budget.left = 1500
        assert len(taken.checkout(cdf, 0).files) == 1
        with pytest.raises(ValueError, match=r"server1: it holds more than"):
            taken.checkout(cdf, 1)
    assert len(read) == 1


def test_one_that_several_cdfs_have_is_looked_up_and_read_once(
    servers: list[Server], monkeypatch: pytest.MonkeyPatch
) -> None:
    cdfs = [_cdf(servers[0]), _cdf(servers[0])]
    asked = []
    resolve = cache.resolve
    monkeypatch.setattr(cache, "resolve", lambda address, ref: asked.append(ref) or resolve(address, ref))
    taken = Repositories(cdfs)
    with disk.together():
        one, two = (plan_image(cdf, disk.listing, disk.read, taken.checkout) for cdf in cdfs)
        budget = disk._budget.get()
        assert budget is not None and budget.left == disk.MAX_BYTES - 2000, "each time that it is shipped counts"
    assert asked == ["main"] and one.tag == two.tag and len(taken._read) == 1
