"""Which container is meant, where only the robots say where services are."""

from __future__ import annotations

from unittest import mock

import pytest

from srprov.codes import Code
from srprov.controller import located
from srprov.controller.located import Located, Whereabouts, trusted
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.record.memory import Memory

DB = Located(service="db", host="r1", container="srprov.x.db")


def there(*, away: bool, remembered: bool, one: Located = DB) -> Whereabouts:
    unreachable = {"r2": "no answer"} if away else {}
    return Whereabouts(
        instance="x", services=(one,), by_name={}, families={}, unreachable=unreachable, remembered=remembered
    )


def test_a_robot_s_word_that_nobody_can_contradict_gets_no_file_and_no_command() -> None:
    """Root there makes a container with the service's label, and a record; the one that has the service is away."""
    with pytest.raises(UsageError, match=r"only r1 says that db is there: .* r2 cannot be asked") as caught:
        trusted(there(away=True, remembered=False), "db")
    assert caught.value.code == Code.DISPUTED and caught.value.hint.endswith("db@r1")
    assert trusted(there(away=True, remembered=False), "db@r1") == DB


@pytest.mark.parametrize(("away", "remembered"), [(False, False), (True, True), (False, True)])
def test_where_it_could_be_contradicted_it_counts(away: bool, remembered: bool) -> None:
    assert trusted(there(away=away, remembered=remembered), "db") == DB


def test_a_service_on_a_robot_that_is_away_is_what_others_say_of_it() -> None:
    """The connection fails, and says so."""
    lost = Located(service="db", host="r2", container="srprov.x.db")
    assert trusted(there(away=True, remembered=False, one=lost), "db") == lost


@pytest.mark.parametrize("robots", [frozenset[str](), frozenset({"r1"})])
def test_what_this_machine_did_is_remembered(robots: frozenset[str]) -> None:
    with mock.patch.object(located, "recall", return_value=Memory(robots=robots)):
        found = located.locate(Snapshot(facts={}, observed={}, unreachable={}), "x")
    assert found.remembered == bool(robots)
