"""The inventory of a record that came from elsewhere, with real robots: nothing is written here where it says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from tests.lab.conftest import Lab, part_of_lab

pytestmark = pytest.mark.lab


@pytest.mark.parametrize("name", [".bashrc", "known_hosts"])
def test_no_host_key_is_written_where_the_record_of_another_machine_says(lab: Lab, tmp_path: Path, name: str) -> None:
    """By `accept-new` each line went into the user's own `.bashrc`, under a name that the next shell ran."""
    inventory = part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    address = yaml.safe_load(Path(inventory).read_text())["all"]["hosts"]["robot1"]["ansible_host"]
    own = tmp_path / name
    own.write_text("# mine\n")
    options = f"-o UserKnownHostsFile={own} -o StrictHostKeyChecking=accept-new -o HostKeyAlias=source"
    options += " -o HashKnownHosts=no"
    host = {"ansible_host": address, "ansible_user": "root", "ansible_ssh_common_args": options}
    recorded = tmp_path / "run" / "inputs" / "inventory.yml"
    recorded.parent.mkdir(parents=True)
    recorded.write_text(json.dumps({"all": {"hosts": {"robot1": host}}}))
    done = lab.srprov("facts", "-i", str(recorded))
    assert "it says only where robots are" in done.err and own.read_text() == "# mine\n", done
    (tmp_path / "copy.yml").write_text(recorded.read_text())
    lab.srprov("facts", "-i", str(tmp_path / "copy.yml"))
    written = own.read_text().removeprefix("# mine\n")
    hashed = written.startswith("|1|") and written.count("\n") == 1
    assert hashed if name == "known_hosts" else not written, "one of the user's own may, in a file of host keys"


def test_the_record_of_a_run_of_this_machine_reaches_its_robots(lab: Lab, tmp_path: Path) -> None:
    """It has the lab's key, and file of host keys."""
    edf = tmp_path / "hello.edf"
    edf.write_text("edf: 1\nname: own-record\nservices: {a: {image: busybox, command: [sleep, '100']}}\n")
    runs = tmp_path / "runs"
    inventory = part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    assert lab.srprov("apply", str(edf), "-i", inventory, "--yes", "--settle", "0", "--runs", str(runs)).code == 0
    (recorded,) = runs.glob("*/inputs/inventory.yml")
    done = lab.srprov("destroy", str(edf), "-i", str(recorded), "--yes", "--runs", str(runs))
    assert done.code == 0 and "where robots are" not in done.err, done
