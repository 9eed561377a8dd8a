"""What robots say of an instance."""

from __future__ import annotations

from srprov.facts.model import Existing, Found
from srprov.instance import owned
from srprov.network.identity import link_names


def test_a_half_made_link_belongs_to_its_instance() -> None:
    """A link with our name and no alias was left by a run that was cut off; only the instance of that name owns it."""
    _, link = link_names("hello")
    half = Existing(module="vxlan", name=link, instance="", state={"instance": ""})
    other = Existing(module="vxlan", name="srpvffffffff", instance="", state={"instance": ""})
    found = Found(facts={}, existing={"r1": (half, other)})

    assert [item.instance for item in owned(found, "hello")["r1"]] == ["hello", ""]
    assert [item.instance for item in owned(found, "else")["r1"]] == ["", ""]
