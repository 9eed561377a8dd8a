"""A group's variable is every host's: it is read once for all of them, and what they have together has a limit."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import groups, host_values, hostvars, load_inventory, schema, sshargs
from srprov.errors import DefinitionError
from srprov.secret import Secret


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


NAME = "{{inventory_hostname}}"


@pytest.mark.parametrize(
    "arguments",
    [
        f"-oHostKeyAlias={NAME} " + " ".join(f"-oA={number}" for number in range(36)),
        f"-oHostKeyAlias={NAME}" + " '-oA=1'" * 30,
        f"-oProxyCommand={NAME}" + "|&(;" * 80,
    ],
)
def test_what_is_taken_apart_for_each_host_counts_by_its_words(tmp_path: Path, arguments: str) -> None:
    with pytest.raises(DefinitionError) as raised:
        load_inventory([inventory(tmp_path, "h[1:9900]:", f'    ansible_ssh_args: "{arguments}"\n')])
    assert "with 'ansible_ssh_args', the hosts have more than" in raised.value.problems[-1].message


def test_ten_thousand_hosts_with_arguments_of_their_own_are_read(tmp_path: Path) -> None:
    own = f"-o HostKeyAlias={NAME} -o ProxyCommand='ssh -W %h:%p jump-{NAME}.example.com' -o ServerAliveInterval=30"
    text = f"    ansible_host: 'h-{NAME}.lab.example.com'\n    ansible_ssh_args: {own} -o StrictHostKeyChecking=yes\n"
    assert len(load_inventory([inventory(tmp_path, "h[1:9999]:", text)]).hosts) == 9999


def groups_of_all(folder: Path, count: int, hosts: str) -> Path:
    """Write an inventory of groups of the same hosts, each with every variable that may be text, and others."""
    texts = [*sorted(hostvars.READ - {"srprov_slots", "srprov_bandwidth_mbit"}), *(f"v{number}" for number in range(9))]
    odd = {"ansible_port": "22", "ansible_ssh_port": "22", "ansible_connection": "ssh"}
    odd.update(dict.fromkeys(("ansible_ssh_args", "ansible_ssh_common_args", "ansible_ssh_extra_args"), "'-4'"))
    variables = ", ".join(f"{key}: {odd.get(key, '10.0.0.0/8' if 'underlay' in key else 'true')}" for key in texts)
    lines = (f"    g{number}: {{hosts: {{'{hosts}': }}, vars: {{{variables}}}}}\n" for number in range(count))
    path = folder / "inv.yml"
    path.write_text("all:\n  children:\n" + "".join(lines))
    return path


def test_groups_are_put_together_once_for_all_that_are_in_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    priority = groups._priority
    monkeypatch.setattr(groups, "_priority", lambda group: asked.append(group.name) or priority(group))
    assert len(load_inventory([groups_of_all(tmp_path, 20, "h[1:500]")]).hosts) == 500
    assert len(asked) == 21


def test_a_password_that_all_hosts_have_is_made_a_secret_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    monkeypatch.setattr(hostvars, "Secret", lambda text: made.append(text) or Secret(text))
    hosts = load_inventory([inventory(tmp_path, "h[1:500]:", "    ansible_password: pass-word\n")]).hosts
    assert made == ["pass-word"]
    assert {host.password for host in hosts.values()} == {Secret("pass-word")}


def test_ten_thousand_hosts_with_what_people_write_are_read(tmp_path: Path) -> None:
    own = (
        "    ansible_host: '{{ inventory_hostname }}.lab.example.com'\n    ansible_user: robot\n"
        "    ansible_ssh_common_args: -o ProxyCommand='ssh -W %h:%p jump.example.com' -o ServerAliveInterval=30\n"
        "    ansible_ssh_private_key_file: '{{ inventory_dir }}/keys/{{ inventory_hostname }}'\n"
        "    srprov_tags: [camera, lidar, wheels, arm, indoor]\n    srprov_devices: [/dev/video0, /dev/ttyUSB0]\n"
    )
    assert len(load_inventory([inventory(tmp_path, "h[1:9999]:", own)]).hosts) == 9999
