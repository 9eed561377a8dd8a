"""What an inventory holds is seen by who looks at it first: nothing beside a window, and no program as data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from srprov.definitions import load_inventory
from srprov.errors import DefinitionError
from tests.bounded import bounded


@pytest.mark.parametrize("blank", list("\u00a0\u1680\u2003\u200b\u2800\u3000\u3164\ufeff\ufe0f\U000e0100\t"))
@pytest.mark.parametrize("between", [300, 50])
def test_nothing_stands_beside_the_window_behind_any_blanks(tmp_path: Path, blank: str, between: int) -> None:
    gap = blank * between if blank != "\t" else " " + "\t" * (between // 3)
    file = tmp_path / "hosts.yml"
    option = f"-o ServerAliveInterval=30{gap} -o ProxyCommand=id"
    file.write_text(f"all:\n  hosts:\n    robot1:\n      ansible_ssh_common_args: '{option}'\n")
    with pytest.raises(DefinitionError) as caught:
        load_inventory([file])
    assert "so many blanks" in caught.value.problems[0].message
    assert caught.value.problems[0].location.line == 4


@pytest.mark.parametrize("mark", list("\u0300\u200d\ufe0f\u2065\U00013441"))
def test_nothing_between_blanks_that_shows_nothing_ends_them(tmp_path: Path, mark: str) -> None:
    gap = ("\u00a0" * 30 + mark) * 6
    file = tmp_path / "hosts.ini"
    file.write_text(f"robot1 ansible_ssh_common_args='-o ServerAliveInterval=30{gap} -o ProxyCommand=id'\n")
    with pytest.raises(DefinitionError) as caught:
        load_inventory([file])
    assert "so many blanks" in caught.value.problems[0].message


def test_letters_with_marks_are_no_blanks(tmp_path: Path) -> None:
    file = tmp_path / "hosts.yml"
    letters = "a\u0301e\u0308\u00a0" * 200 + "\u0939\u093f\u0928\u094d" * 200
    file.write_text(f"# {letters}\nall: {{hosts: {{robot1: }}}}\n")
    assert load_inventory([file]).hosts


@pytest.mark.parametrize("empty", ["\n", "  \n", "\r\n", "\u3000\n", "\t\n"])
def test_nothing_stands_below_the_window(tmp_path: Path, empty: str) -> None:
    file = tmp_path / "hosts.ini"
    text = "robot1 ansible_host=10.0.0.1\n{}[all:vars]\nansible_ssh_common_args=-o ProxyCommand=id\n"
    file.write_text(text.format("\n" * 40))
    assert load_inventory([file]).hosts["robot1"].ssh_options
    file.write_text(text.format(empty * 60))
    with pytest.raises(DefinitionError) as caught:
        load_inventory([file])
    assert "so many empty lines" in caught.value.problems[0].message
    assert caught.value.problems[0].location.line == 62
    file.write_text("robot1\n" + "\n" * 100_000)  # nothing stands behind them
    assert bounded(lambda: len(load_inventory([file]).hosts)) == 1
    file.write_text("robot1\n" + ("\n" * 49 + "# more\n") * 5000)
    assert bounded(lambda: len(load_inventory([file]).hosts)) == 1


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("hosts.yml", "#!/bin/sh"),
        ("hosts.json", "#!/bin/sh"),
        ("hosts.INI", "#!/bin/sh"),
        ("hosts", f"#!{' ' * 150}/bin/sh"),
        ("hosts", "#!robots of the lab, which work in the folder that holds them"),
        ("hosts", "#! ./robots"),
        ("hosts", "#!  /bin/sh"),
        ("hosts", "#!\t/bin/sh"),
        ("hosts", "#!/bin/sh\u00a0"),
        ("hosts", f"#!/usr/bin/env{' ' * 120}-S sh"),
    ],
)
def test_no_program_shows_itself_as_data(
    tmp_path: Path, name: str, first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = tmp_path / "ran"
    (tmp_path / "robots").write_text(f"#!/bin/sh\ntouch {ran}\n")
    (tmp_path / "robots").chmod(0o755)
    (tmp_path / name).write_text(f"{first}\ntouch {ran}\n")
    (tmp_path / name).chmod(0o755)
    with pytest.raises(DefinitionError):
        load_inventory([tmp_path / name])
    assert not ran.exists()


def test_a_program_that_shows_itself_as_one_is_run(tmp_path: Path) -> None:
    for number, first in enumerate(("#!/bin/sh", "#! /bin/sh -e", "#!/usr/bin/env sh")):
        path = tmp_path / f"inventory{number}"
        path.write_text(f'{first}\necho \'{{"all": {{"hosts": ["r1"]}}}}\'\n')
        path.chmod(0o755)
        assert list(load_inventory([path]).hosts) == ["r1"]


@pytest.mark.parametrize("name", ["\u2800", "\u00a0.yml", "\u3164", " "])
def test_no_file_without_a_name_that_is_seen_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "hosts").write_text("robot1\n")
    for place in (tmp_path / "lab" / name, tmp_path / "lab/host_vars/robot1" / name):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("all: {vars: {a: b}}\n" if name.endswith("yml") else "robot2\n")
        with pytest.raises(DefinitionError) as caught:
            load_inventory([tmp_path / "lab"])
        assert "shows nothing" in caught.value.problems[0].message
        place.unlink()
    assert list(load_inventory([tmp_path / "lab"]).hosts) == ["robot1"]


_LOOKS = {
    "a.yml": """all: {hosts: {robot1: {x_place: "hall 2
  # before the move:
  # ", ansible_ssh_common_args: -o ProxyCommand=id}}}
""",
    "b.yml": "all: {vars: {x: 'hall # before: ', ansible_ssh_common_args: -o ProxyCommand=id}, hosts: {robot1: }}\n",
    "c.yml": """all:
  vars:
    ansible_ssh_common_args: >-
      -o 'LogLevel=INFO
      # before: ' -o ProxyCommand=id
  hosts: {robot1: }
""",
    "d.yml": "all: {vars: {ansible_ssh_common_args: \"-o '# ' -o ProxyCommand=id\"}, hosts: {robot1: }}\n",
    "e.yml": "all: {vars: {ansible_ssh_common_args: -o LogLevel=INFO\u2800# -o ProxyCommand=id}, hosts: {robot1: }}\n",
    "f.yml": "all: {vars: {x: '\u200b# before: ', ansible_ssh_common_args: -o ProxyCommand=id}, hosts: {robot1: }}\n",
    "e.ini": "robot1 place='joe\u3164# before: ' ansible_ssh_common_args='-o ProxyCommand=id'\n",
    "a.ini": "robot1 place='joe's x=' # before: ' ansible_ssh_common_args='-o ProxyCommand=id'\n",
    "b.ini": "robot1 ;before=2025 ansible_ssh_common_args='-o ProxyCommand=id'\n",
    "c.ini": "robot1 '#before'=2025 ansible_ssh_common_args='-o ProxyCommand=id'\n",
    "d.ini": "[all:vars]\nansible_ssh_common_args=-o 'LogLevel=INFO # before: ' -o ProxyCommand=id\n[all]\nrobot1\n",
}


@pytest.mark.parametrize("name", _LOOKS)
def test_no_setting_looks_like_a_comment_as_a_part_of_a_quoted_text(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(_LOOKS[name])
    with pytest.raises(DefinitionError) as error:
        load_inventory([tmp_path / name])
    assert "begins no comment" in error.value.problems[0].message


def test_a_file_of_variables_has_no_setting_that_looks_like_a_comment(tmp_path: Path) -> None:
    (tmp_path / "hosts.yml").write_text("all: {hosts: {robot1: }}\n")
    (tmp_path / "host_vars").mkdir()
    (tmp_path / "host_vars" / "robot1.yml").write_text('{x: "\n # ", ansible_ssh_common_args: -o ProxyCommand=id}\n')
    with pytest.raises(DefinitionError) as error:
        load_inventory([tmp_path / "hosts.yml"])
    assert "begins no comment" in error.value.problems[0].message


def test_comments_and_texts_with_a_hash_are_read(tmp_path: Path) -> None:
    text = "all:\n  hosts:  # of hall 2\n    robot1:\n      motd: 'arm # 5'\n      script: |\n        # a\n        id\n"
    (tmp_path / "hosts.yml").write_text(text)
    (tmp_path / "hosts.ini").write_text("robot2 ansible_port=22 motd='arm # 5' # ansible_port=23\n")
    hosts = load_inventory([tmp_path / "hosts.yml", tmp_path / "hosts.ini"]).hosts
    assert set(hosts) == {"robot1", "robot2"}
    assert hosts["robot2"].port == 22


def test_the_inventory_of_a_record_has_robots_with_a_hash_in_a_line(tmp_path: Path) -> None:
    file = tmp_path / "inputs" / "inventory.yml"
    file.parent.mkdir()
    file.write_text('{"all": {"hosts": {"robot1": {"srprov_tags": ["arm #2"], "ansible_host": "10.0.0.1"}}}}\n')
    assert load_inventory([file]).hosts["robot1"].address == "10.0.0.1"


def test_an_inventory_of_many_robots_in_one_line_is_read_at_once(tmp_path: Path) -> None:
    """As a program writes it: the line was looked at anew for each key, for minutes where robots are thousands."""
    hosts = {f"r{one}": {"ansible_host": "10.0.0.1", "note": "arm" * 9} for one in range(2000)}
    (tmp_path / "hosts.json").write_text(json.dumps({"all": {"hosts": hosts}}))
    assert bounded(lambda: len(load_inventory([tmp_path / "hosts.json"]).hosts)) == len(hosts)
