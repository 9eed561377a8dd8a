"""A group's variable is every host's: it is read once for all of them, and what they have together has a limit."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import host_values, hostvars, load_inventory, schema, sshargs
from srprov.errors import DefinitionError


def inventory(folder: Path, hosts: str, variables: str) -> Path:
    path = folder / "inv.yml"
    path.write_text(f"all:\n  hosts:\n    {hosts}\n  vars:\n    a: b\n{variables}")
    return path


def test_what_all_hosts_have_is_read_once_and_shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    parse, unknown, named = sshargs.parse, host_values.why_unknown, "{{ inventory_dir }}/hosts"
    monkeypatch.setattr(sshargs, "parse", lambda text: read.append("ssh") or parse(text))
    monkeypatch.setattr(host_values, "why_unknown", lambda node: read.append("unknown") or unknown(node))
    own = f"    ansible_ssh_args: -4 -o UserKnownHostsFile={named}\n    srprov_tags: [a, b]\n    srprov_devices: c,d\n"
    hosts = load_inventory([inventory(tmp_path, "h[1:500]:", own)]).hosts
    assert len(hosts) == 500
    assert read.count("ssh") == 1
    assert len(read) < 20
    assert {host.ssh_options for host in hosts.values()} == {(("userknownhostsfile", f"{tmp_path}/hosts"),)}
    assert len({id(host.tags) for host in hosts.values()}) == 1
    assert (hosts["h1"].tags, hosts["h1"].devices) == (("a", "b"), ("c", "d"))


def test_a_mistake_that_all_hosts_have_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    parse = sshargs.parse
    monkeypatch.setattr(sshargs, "parse", lambda text: read.append(text) or parse(text))
    with pytest.raises(DefinitionError, match="1 problem"):
        load_inventory([inventory(tmp_path, "h[1:500]:", "    ansible_ssh_args: -4 -4 wrong\n")])
    assert len(read) == 1


def test_what_a_range_of_hosts_has_is_checked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where each of them has one of its own besides."""
    checked: list[int] = []
    check = schema.check
    spy = lambda root, *rest: checked.append("srprov_tags" in root.entries) or check(root, *rest)  # noqa: E731
    monkeypatch.setattr(schema, "check", spy)
    own = "".join(f"\n    h{number}: {{srprov_slots: 2}}" for number in range(1, 100))
    hosts = load_inventory([inventory(tmp_path, f"h[1:99]: {{srprov_tags: [a, b]}}{own}", "")]).hosts
    assert sum(checked) == 1
    assert {(host.tags, host.slots) for host in hosts.values()} == {(("a", "b"), 2)}


def test_a_host_s_own_name_is_put_in_for_each(tmp_path: Path) -> None:
    name = "{{ inventory_hostname }}"
    own = f"    ansible_host: '{name}.lab'\n    ansible_ssh_args: -o HostKeyAlias={name}\n"
    hosts = load_inventory([inventory(tmp_path, "h[1:3]:", own)]).hosts
    assert [host.address for host in hosts.values()] == ["h1.lab", "h2.lab", "h3.lab"]
    assert [host.ssh_options for host in hosts.values()] == [(("hostkeyalias", f"h{one}"),) for one in (1, 2, 3)]


@pytest.mark.parametrize(
    "own",
    [
        "ansible_ssh_common_args: '" + "-4 " * 3300 + "'",
        "ansible_ssh_common_args: '" + "-o A=b " * 1200 + "'",
        "srprov_tags: '" + ",".join(f"t{number}" for number in range(20_000)) + "'",
        "srprov_tags: [" + ",".join(f"t{number}" for number in range(1000)) + "]",
        "ansible_host: '" + "{{ inventory_hostname }}" * 400 + "'",
        "ansible_host: '" + "{{ inventory_dir }}" * 400 + "'",
    ],
)  # fmt: skip
def test_what_all_hosts_have_together_has_a_limit(own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    host = hostvars.host
    monkeypatch.setattr(hostvars, "host", lambda entry, *rest: made.append(entry.name) or host(entry, *rest))
    with pytest.raises(DefinitionError) as raised:
        load_inventory([inventory(tmp_path, "h[1:9900]:", f"    {own}\n")])
    assert f"with '{own.partition(':')[0]}', the hosts have more than" in raised.value.problems[-1].message
    assert len(made) < 4000


def test_ten_thousand_hosts_with_what_people_write_are_read(tmp_path: Path) -> None:
    own = (
        "    ansible_host: '{{ inventory_hostname }}.lab.example.com'\n    ansible_user: robot\n"
        "    ansible_ssh_common_args: -o ProxyCommand='ssh -W %h:%p jump.example.com' -o ServerAliveInterval=30\n"
        "    ansible_ssh_private_key_file: '{{ inventory_dir }}/keys/{{ inventory_hostname }}'\n"
        "    srprov_tags: [camera, lidar, wheels, arm, indoor]\n    srprov_devices: [/dev/video0, /dev/ttyUSB0]\n"
    )
    assert len(load_inventory([inventory(tmp_path, "h[1:9999]:", own)]).hosts) == 9999
