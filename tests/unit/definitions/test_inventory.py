"""Ansible inventories as they are in real labs."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from srprov.definitions import load_inventory
from srprov.definitions.model import Inventory
from srprov.errors import DefinitionError
from srprov.secret import Secret
from tests.bounded import bounded

REAL = """\
---
all:
  vars:
    ansible_user: "{{ undefined_in_srprov }}"
    ansible_python_interpreter: /usr/bin/python3
    ntp_servers: ["{{ gateway }}", 10.0.0.1]
    vault_token: !vault |
      $ANSIBLE_VAULT;1.1;AES256
      3132
    packages: !unsafe "{{ raw }}"
    huge: 0777
    when: 2026-01-01
    nested: {a: {b: [1, 2, {c: null}]}}
  children:
    robots:
      vars:
        ansible_user: robot
        ansible_become: yes
        ansible_ssh_common_args: >-
          -o ProxyJump=gw.lab -o "UserKnownHostsFile /lab/known /lab/hosts" -o StrictHostKeyChecking=yes
      children:
        turtlebots:
          hosts:
            turtle[01:03]:
              ansible_host: "{{ inventory_hostname }}.lab"
            turtle02:
              srprov_slots: 2
              ansible_port: "2222"
        arms:
          hosts:
            arm[a:b]: {srprov_tags: [gripper, 42], srprov_devices: "/dev/arm0, /dev/arm1"}
    builders:
      hosts:
        turtle01:
        localhost: {ansible_connection: local, ansible_user: me}
  hosts:
    spare: {ansible_user: pi, ansible_password: s3cret, ansible_ssh_extra_args: -p 99 -i ~/key -C}
"""


def _load(folder: Path, text: str, name: str = "inventory.yml") -> Inventory:
    path = folder / name
    path.write_text(text)
    return load_inventory([path])


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Inventory:
    return _load(tmp_path_factory.mktemp("real"), REAL)


def test_a_real_inventory_loads(real: Inventory) -> None:
    assert list(real.hosts) == ["arma", "armb", "localhost", "spare", "turtle01", "turtle02", "turtle03"]
    assert real.groups["robots"] == ("arma", "armb", "turtle01", "turtle02", "turtle03")
    assert real.groups["builders"] == ("localhost", "turtle01")
    assert real.groups["all"] == tuple(real.hosts)


def test_variables_are_inherited_and_read(real: Inventory) -> None:
    turtle = real.hosts["turtle02"]
    assert (turtle.user, turtle.port, turtle.slots, turtle.become) == ("robot", 2222, 2, True)
    assert turtle.address == "turtle02.lab"
    assert turtle.groups == ("robots", "turtlebots")
    assert turtle.ssh_options == (
        ("proxyjump", "gw.lab"),
        ("userknownhostsfile", "/lab/known /lab/hosts"),
        ("stricthostkeychecking", "yes"),
    )
    assert turtle.location.line == 24


def test_own_variables(real: Inventory) -> None:
    assert real.hosts["arma"].tags == ("gripper", "42")
    assert real.hosts["armb"].devices == ("/dev/arm0", "/dev/arm1")
    assert real.hosts["localhost"].connection == "local"


def test_password_is_a_secret_and_ssh_arguments_are_options(real: Inventory) -> None:
    spare = real.hosts["spare"]
    assert spare.password == Secret("s3cret")
    assert "s3cret" not in repr(spare)
    assert spare.ssh_options == (("port", "99"), ("identityfile", "~/key"))


def test_child_group_wins_over_parent_and_host_over_group(tmp_path: Path) -> None:
    lab = _load(
        tmp_path,
        """
a_child: {vars: {ansible_user: child}, hosts: {r1: , r2: {ansible_user: host}}}
z_parent: {vars: {ansible_user: parent, ansible_port: 7}, children: {a_child: }}
""",
    )
    assert (lab.hosts["r1"].user, lab.hosts["r1"].port, lab.hosts["r2"].user) == ("child", 7, "host")


def test_priority_decides_among_equal_groups(tmp_path: Path) -> None:
    lab = _load(
        tmp_path,
        """
a: {vars: {ansible_user: a, ansible_group_priority: 10}, hosts: {r: }}
b: {vars: {ansible_user: b}, hosts: {r: }}
""",
    )
    assert lab.hosts["r"].user == "a"


def test_files_beside_the_inventory_win_over_it(tmp_path: Path) -> None:
    (tmp_path / "group_vars" / "robots").mkdir(parents=True)
    (tmp_path / "host_vars").mkdir()
    (tmp_path / "group_vars" / "all.yml").write_text("srprov_slots: 2\nsrprov_underlay: eth0\n")
    (tmp_path / "group_vars" / "robots" / "a.yaml").write_text("ansible_port: 1\n")
    (tmp_path / "group_vars" / "robots" / "b.yml").write_text("ansible_port: 2\n")
    (tmp_path / "group_vars" / "robots" / "vault.yml").write_text("$ANSIBLE_VAULT;1.1;AES256\n6162\n")
    (tmp_path / "host_vars" / "r1").write_text("srprov_underlay: wlan0\nsrprov_bandwidth_mbit: 5.5\n")
    lab = _load(tmp_path, "robots: {vars: {ansible_port: 9, srprov_slots: 1}, hosts: {r1: {srprov_slots: 3}, r2: }}\n")
    r1, r2 = lab.hosts["r1"], lab.hosts["r2"]
    assert (r1.port, r1.slots, r1.underlay, r1.bandwidth_mbit) == (2, 3, "wlan0", 5.5)
    assert (r2.port, r2.slots, r2.underlay) == (2, 2, "eth0")


def test_ini_inventory(tmp_path: Path) -> None:
    lab = _load(
        tmp_path,
        """\
# the lab
spare ansible_host=10.0.0.9  ; not a comment in Ansible either=1
[robots]
robot[1:2]:2222 srprov_tags="['lidar', 'camera']" ansible_ssh_common_args='-o ProxyJump=gw -o User=x' # note
robot3 ansible_connection=local

[arms:children]
grippers

[grippers]
arm1

[robots:vars]
ansible_user = robot
srprov_slots=2
anything = {{ not_read }}
""".replace("  ; not a comment in Ansible either=1", ""),
        name="hosts",
    )
    assert list(lab.hosts) == ["arm1", "robot1", "robot2", "robot3", "spare"]
    robot = lab.hosts["robot1"]
    assert (robot.port, robot.user, robot.slots, robot.tags) == (2222, "robot", 2, ("lidar", "camera"))
    assert robot.ssh_options == (("proxyjump", "gw"), ("user", "x"))
    assert lab.groups["arms"] == ("arm1",)
    assert lab.hosts["arm1"].groups == ("arms", "grippers")


def test_program_with_meta(tmp_path: Path) -> None:
    answer = {
        "_meta": {"hostvars": {"r1": {"ansible_host": "10.0.0.1", "ansible_port": 2222, "x": "{{ y }}"}}},
        "robots": {"hosts": ["r1", "r2"], "vars": {"srprov_slots": 2}, "children": ["more"]},
        "more": ["r3"],
        "all": {"children": ["robots", "ungrouped"]},
        "ungrouped": {},
    }
    path = tmp_path / "inventory.py"
    path.write_text(f"#!/bin/sh\ncat <<'E'\n{json.dumps(answer)}\nE\n")
    path.chmod(0o755)
    lab = load_inventory([path])
    assert lab.groups["robots"] == ("r1", "r2", "r3")
    assert (lab.hosts["r1"].address, lab.hosts["r1"].port, lab.hosts["r3"].slots) == ("10.0.0.1", 2222, 2)


def test_program_without_meta_is_asked_per_host(tmp_path: Path) -> None:
    path = tmp_path / "inventory.sh"
    path.write_text(
        '#!/bin/sh\nif [ "$1" = --list ]; then\n  echo \'{"g": ["r1"]}\'\n'
        'else\n  echo "{\\"ansible_user\\": \\"u-$2\\"}"\nfi\n'
    )
    path.chmod(0o755)
    assert load_inventory([path]).hosts["r1"].user == "u-r1"


def test_program_that_hangs_is_ended_with_all_it_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from srprov.definitions import script
    from srprov.definitions.groups import HostTree

    path = tmp_path / "inventory.sh"
    path.write_text("#!/bin/sh\nsleep 60 & sleep 60\n")
    path.chmod(0o755)
    begin = time.monotonic()
    with pytest.raises(DefinitionError) as error:
        script.read(str(path), HostTree(), deadline_s=0.3)
    assert time.monotonic() - begin < 40
    assert "gave no answer in time" in error.value.problems[0].message


def test_a_program_that_never_stops_printing_is_refused_at_once(tmp_path: Path) -> None:
    from srprov.definitions import script
    from srprov.definitions.groups import HostTree

    path = tmp_path / "inventory.sh"
    path.write_text("#!/bin/sh\nexec cat /dev/zero\n")
    path.chmod(0o755)
    with pytest.raises(DefinitionError) as error:
        bounded(lambda: script.read(str(path), HostTree()))
    assert "printed more than 8 MiB" in error.value.problems[0].message


def test_folder_and_several_inventories_and_names(tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "a.yml").write_text("robots: {hosts: {r1: {ansible_user: a}}}\n")
    (tmp_path / "lab" / "b.yml").write_text("robots: {hosts: {r2: }}\n")
    (tmp_path / "lab" / "b.yml~").write_text("broken: [\n")
    (tmp_path / "c.yml").write_text("robots: {hosts: {r1: {ansible_user: c}}}\n")
    lab = load_inventory([tmp_path / "lab", tmp_path / "c.yml", "x1,x2,"])
    assert list(lab.hosts) == ["r1", "r2", "x1", "x2"]
    assert lab.hosts["r1"].user == "c"


def test_an_empty_inventory_has_no_hosts(tmp_path: Path) -> None:
    lab = _load(tmp_path, "")
    assert dict(lab.hosts) == {}


def test_a_problem_in_a_groups_variable_is_told_once(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError) as error:
        _load(tmp_path, "robots: {vars: {ansible_port: many}, hosts: {'r[1:50]': }}\n")
    assert len(error.value.problems) == 1


def test_merge_keys_and_aliases(tmp_path: Path) -> None:
    lab = _load(
        tmp_path,
        "x-common: &c {ansible_user: u, ansible_port: 5}\nrobots: {hosts: {r1: *c, r2: {<<: *c, ansible_port: 6}}}\n",
    )
    assert (lab.hosts["r1"].user, lab.hosts["r2"].user, lab.hosts["r2"].port) == ("u", "u", 6)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("i.yml", "all: {hosts: {r1: {ansible_password: s3cret, srprov_slot: 1}}}\n"),
        ("i.yml", "all:\n  hosts: {r1: {ansible_password: s3cret\n"),
        ("i.ini", "r1 ansible_password = s3cret\n"),
        ("i.ini", "[g:vars]\nansible_password s3cret\n"),
    ],
)
def test_a_line_with_a_password_is_not_shown(tmp_path: Path, name: str, text: str) -> None:
    with pytest.raises(DefinitionError) as error:
        _load(tmp_path, text, name)
    assert "s3cret" not in repr(error.value.problems)


@pytest.mark.parametrize("value", ["{[]:1}", "{{}:1}", "[{[]}]"])
def test_a_value_that_python_would_not_make_is_text(tmp_path: Path, value: str) -> None:
    """A map or a set that has a list for a key ended every verb with a traceback."""
    inventory = _load(tmp_path, f"r1 x={value} ansible_user=robot\n", "hosts.ini")
    assert inventory.hosts["r1"].user == "robot"


@pytest.mark.parametrize("key", ["ansible_host", "ansible_user", "ansible_ssh_private_key_file", "srprov_tags"])
@pytest.mark.parametrize("value", ["a\0b", "\"'a\\x00b'\"", "\"['a\\x00b']\""])
def test_a_nul_in_what_is_read_is_a_problem(tmp_path: Path, key: str, value: str) -> None:
    """In YAML none can be; as an address it ended the thread that looks it up, and nothing said so for ten seconds."""
    if value.startswith('"[') and key != "srprov_tags":
        pytest.skip("it is no text")
    with pytest.raises(DefinitionError) as caught:
        _load(tmp_path, f"r1 {key}={value}\n", "hosts.ini")
    assert "a text with a NUL character" in caught.value.problems[0].message


ENDS = ("\r", "\x0b", "\x0c", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029")
OTHERS = ("\x08", "\u061c", "\U000e0041", "\x1b[1A\x1b[2K", "\x9b2K", "\u202e", "\u2066")


@pytest.mark.parametrize("hidden", [*ENDS, *OTHERS])
@pytest.mark.parametrize("place", ["robots.ini", "robots.yml", "host_vars/robot1.yml"])
def test_no_comment_of_an_inventory_is_a_setting(tmp_path: Path, place: str, hidden: str) -> None:
    """Whoever looks at an inventory before it is used sees a comment, of which a parser may see a line of its own."""
    setting = "ansible_ssh_common_args: -o ProxyCommand=id"
    texts = {
        "robots.ini": f"robot1\n# before:{hidden}robot1 {setting.replace(': ', '=')}\n",
        "robots.yml": f"all:\n  hosts:\n    robot1:\n      ansible_port: 22\n      # before:{hidden}      {setting}\n",
        "host_vars/robot1.yml": f"ansible_port: 22\n# before:{hidden}{setting}\n",
    }
    (tmp_path / "host_vars").mkdir()
    (tmp_path / "hosts.ini").write_text("robot1\n")
    (tmp_path / place).write_text(texts[place], newline="")
    named = place if place.startswith("robots") else "hosts.ini"
    with pytest.raises(DefinitionError) as caught:
        load_inventory([tmp_path / named])
    (problem,) = caught.value.problems
    assert "may be read otherwise than it is seen" in problem.message and problem.location.file.endswith(place)


@pytest.mark.parametrize(
    "text", ["robot1\r\nrobot2\r\n", "# a\n\x0c\nrobot1\nrobot2\n", "# größer\u200b\nrobot[1:2]\n"]
)
def test_ends_of_lines_that_everybody_sees_stay(tmp_path: Path, text: str) -> None:
    (tmp_path / "hosts.ini").write_text(text, newline="")
    assert list(load_inventory([tmp_path / "hosts.ini"]).hosts) == ["robot1", "robot2"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("hosts.ini", "robot1 ansible_host=10.0.0.7{}ansible_ssh_common_args='-o ProxyCommand=id'\n"),
        ("hosts.yml", "all: {{hosts: {{robot1: {{ansible_port: 22,{}ansible_ssh_args: -o ProxyCommand=id}}}}}}\n"),
        ("hosts.yml", "all:\n  hosts: {{robot1: }}\n  vars:\n{}ansible_ssh_common_args: -o ProxyCommand=id\n"),
    ],
)
def test_nothing_stands_beside_the_window(tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_text(text.format(" " * 60))
    assert load_inventory([file]).hosts["robot1"].ssh_options
    for many in (" " * 100, "\t" * 50 + " " * 300):
        file.write_text(text.format(many))
        with pytest.raises(DefinitionError) as caught:
            load_inventory([file])
        assert "so many blanks" in caught.value.problems[0].message
    file.write_text(text.format(" " * 60) + f"# {' ' * 40_000}\n")  # nothing stands behind them
    assert bounded(lambda: len(load_inventory([file]).hosts)) == 1


def test_no_hidden_file_of_variables_is_read(tmp_path: Path) -> None:
    (tmp_path / "hosts.yml").write_text("all: {children: {.arms: &r {hosts: {robot1: }}, arms: *r, '': *r, a~: *r}}\n")
    for name in (
        ".arms.yml",
        ".arms/a.yml",
        "arms/.a.yml",
        "arms/.b/a.yml",
        ".yml",
        ".json",
        "more.yml",
        "a~",
        "a~.yml",
    ):
        place = tmp_path / "group_vars" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("ansible_ssh_common_args: -o ProxyCommand=id\n")
    assert load_inventory([tmp_path / "hosts.yml"]).hosts["robot1"].ssh_options == ()


@pytest.mark.parametrize(
    "name",
    ["all/net~", "all/old~/net.yml", "all/net%", "all/CVS/net.yml", "all/__pycache__/net.yml", "lab.old", "lab.bak"],
)
def test_no_file_of_variables_that_file_managers_and_editors_leave_out_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "hosts.yml").write_text("all: {children: {lab.old: &r {hosts: {robot1: }}, lab.bak: *r}}\n")
    place = tmp_path / "group_vars" / name
    place.parent.mkdir(parents=True)
    place.write_text("ansible_ssh_common_args: -o ProxyCommand=id\n")
    assert load_inventory([tmp_path / "hosts.yml"]).hosts["robot1"].ssh_options == ()


@pytest.mark.parametrize(
    ("listing", "line"),
    [
        (".hidden", "group_vars"),
        ("group_vars/.hidden", "all"),
        ("group_vars/all/.hidden", "net.yml"),
        (".hidden", "more.yml"),
    ],
)
def test_no_file_that_a_list_hides_is_read(tmp_path: Path, listing: str, line: str) -> None:
    for name in ("group_vars/all/net.yml", "group_vars/all/.hidden", "hosts.yml", "more.yml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "hosts.yml").write_text("all: {hosts: {robot1: }}\n")
    (tmp_path / listing).write_text(f"other\n{line}\n")
    with pytest.raises(DefinitionError) as error:
        load_inventory([tmp_path])
    assert f"lists '{line}'" in error.value.problems[0].message
    (tmp_path / listing).write_text("other\n")
    assert set(load_inventory([tmp_path]).hosts) == {"robot1"}


@pytest.mark.parametrize(
    "folder", ["lab -o ProxyCommand=id", "lab$(id)", "lab'", "lab;id", "lab%h", "lab\tx", "plain-1.2_x@y+z", "häuser"]
)
def test_the_name_of_an_inventory_s_folder_is_one_word_of_ssh_s_arguments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    """An archive has a folder that it names as it likes, and a link of a harmless name to it, in which one works."""
    (tmp_path / folder).mkdir()
    (tmp_path / "lab").symlink_to(folder)
    text = "all: {hosts: {r: {ansible_ssh_private_key_file: '{{ inventory_dir }}/key', ansible_ssh_common_args: ARGS}}}"
    file = tmp_path / folder / "robots.yml"
    file.write_text(text.replace("ARGS", "'-o UserKnownHostsFile={{ inventory_dir }}/known_hosts'"))
    monkeypatch.chdir(tmp_path / "lab")
    if folder.startswith(("plain", "h")):
        (option,) = load_inventory(["robots.yml"]).hosts["r"].ssh_options
        assert option == ("userknownhostsfile", f"{tmp_path / folder}/known_hosts")
        return
    with pytest.raises(DefinitionError) as refused:
        load_inventory(["robots.yml"])
    assert "is more than one word of ssh's arguments" in refused.value.problems[0].message
    file.write_text(text.replace("ARGS", "'-o UserKnownHostsFile=/x'"))
    assert load_inventory(["robots.yml"]).hosts["r"].identity_file == f"{tmp_path / folder}/key"


def test_an_argument_for_ssh_is_one_line(tmp_path: Path) -> None:
    """`ssh -G` prints it as it is, and what it prints is read by its lines."""
    file = tmp_path / "h.yml"
    args = "-o 'SetEnv=\"A=1\\nproxycommand ./jump.sh\"'".replace('"', '\\"')
    file.write_text(f'all: {{hosts: {{r: {{ansible_ssh_common_args: "{args}"}}}}}}')
    with pytest.raises(DefinitionError) as refused:
        load_inventory([str(file)])
    assert "line end" in refused.value.problems[0].message
