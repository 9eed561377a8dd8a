"""What of ours a robot names, and how much of it is believed."""

from __future__ import annotations

import json

import pytest

from srprov.errors import TransportError
from srprov.facts.observe import answers_of, observe_queries, parse_observed
from srprov.wire import Reply


def containers(count: int) -> list[Reply]:
    """Return the replies of an engine with so many containers."""
    listed = [
        {"Names": [f"/srprov.i{one}.a"], "Labels": {"srprov.instance": f"i{one}", "srprov.service": "a"}}
        for one in range(count)
    ]
    return [Reply(status=200, out=json.dumps(listed)) for _ in observe_queries(["container"])]


def test_a_robot_that_names_more_containers_than_it_can_have_is_not_believed() -> None:
    """Its answer is shorter than any answer may be; what is made of it would have no end."""
    assert len(parse_observed(containers(1000), ["container"])) == 1000
    with pytest.raises(TransportError, match="it has more than 1000 things of the kind container"), answers_of("r1"):
        parse_observed(containers(1001), ["container"])
