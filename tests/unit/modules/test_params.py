"""Parameters of playbooks: what modules cannot take is refused when it is read."""

from __future__ import annotations

import pytest

from srprov.modules.params import ParameterError
from tests.resources import resource
from tests.unit.modules.test_container_params import SAID

LINK = {"instance": "x", "vni": 1, "local": "192.0.2.1", "port": 4789, "bridge": "srpb1", "mtu": 1400}
MAC = "02:09:a6:ab:54:2b"
OTHERWISE = ["2:9:a6:ab:54:2b", MAC.upper(), MAC.replace(":", "-"), MAC.replace(":", ""), MAC + "\n", f" {MAC}", "x"]


@pytest.mark.parametrize("mac", OTHERWISE)
def test_addresses_have_one_spelling(mac: str) -> None:
    """Tools take several: one that a check did not know again led packets elsewhere."""

    def link(given: str) -> object:
        return resource("vxlan", "srpv1", {**LINK, "fdb": [[given, "192.0.2.2"]]})

    def container(**given: str) -> object:
        network = {"mode": "overlay", "name": "srprov.hello", "ip": "10.0.0.7", "mac": MAC, **given}
        return resource("container", "srprov.hello.web", {**SAID, "network": network})

    assert link(MAC) and container()
    for wrong in (lambda: link(mac), lambda: container(mac=mac)):
        with pytest.raises(ParameterError, match="is no MAC"):
            wrong()
    for ip in ("::ffff:10.0.0.7", "10.0.0.07", "10.0.7", "0x0a000007", "10.0.0.7 "):
        with pytest.raises(ParameterError, match="is no IPv4 address"):
            container(ip=ip)


@pytest.mark.parametrize(
    "more", [{"Target": "/a\udcff"}, {"VolumeOptions": {"\ud800": [1]}}, {"Options": [["\udfff"]]}]
)
def test_no_text_of_any_form_holds_half_a_character(more: dict[str, object]) -> None:
    """An engine reads another one there than a shell, and what was compared is what neither has."""
    mount = {"Type": "volume", "Source": "srprov.hello.v", "Target": "/v", **more}
    with pytest.raises(ParameterError, match="half a character"):
        resource("container", "srprov.hello.web", {**SAID, "mounts": [mount]})


@pytest.mark.parametrize("api", ["9" * 5000, "1.x", "1.41\n", "-1"])
def test_the_version_of_an_api_is_one(api: str) -> None:
    with pytest.raises(ParameterError, match="is no version of an engine's API"):
        resource("container", "srprov.hello.web", {**SAID, "api": api})
