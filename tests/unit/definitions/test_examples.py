"""The examples that ship with srprov are right as they stand."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.assignment.requirements import missing
from srprov.definitions import check_files, load_experiment
from tests.unit.assignment.worlds import robot

EXAMPLES = Path(__file__).parents[3] / "examples"
EDFS = sorted(EXAMPLES.glob("*/*.edf"))


@pytest.mark.parametrize("path", EDFS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_an_example_can_be_planned_as_it_is(path: Path) -> None:
    assert check_files([str(path)]) == []
    found = load_experiment(str(path))
    assert found.unsupported == ()
    assert found.experiment.services


def test_the_encrypted_example_goes_where_wireguard_is() -> None:
    """Every service of it is on the overlay, so each of its robots needs a key, and no rules."""
    found = load_experiment(str(EXAMPLES / "hello" / "encrypted.edf"))
    assert found.experiment.network.encryption == "wireguard"
    able, bare = robot("able", wireguard="userspace", rules="none"), robot("bare", rules="nftables")
    for service in found.experiment.services.values():
        assert missing(service, (), able) == ()
        (lack,) = missing(service, (), bare)
        assert lack.text.startswith("no WireGuard")
