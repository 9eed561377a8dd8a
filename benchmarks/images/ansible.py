"""Ansible: an archive from the builder to the controller to the robots, and community.docker's docker_image loads it.

Set fast as in benchmarks/provisioning: as many forks as robots, pipelining, ControlPersist, no facts, strategy `free`.
`docker_image_export`, `fetch` and `copy` compare before they write, and `docker_image` loads no tag that is there.
"""

from __future__ import annotations

from typing import Any

import yaml

from benchmarks.images.tool import Tool
from benchmarks.provisioning import peers
from benchmarks.provisioning.ansible import CONFIG, PACKAGES
from benchmarks.provisioning.ansible import Ansible as Provisioning
from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS
from benchmarks.provisioning.tool import Call

ARCHIVE = "/root/bench-image.tar"


def playbook(image: str, here: str) -> list[dict[str, Any]]:
    """Return the plays: out of the builder, into the robots."""
    export = {"name": "export", "community.docker.docker_image_export": {"name": image, "path": ARCHIVE}}
    fetch = {"name": "fetch", "ansible.builtin.fetch": {"src": ARCHIVE, "dest": here, "flat": True}}
    copy = {"name": "copy", "ansible.builtin.copy": {"src": here, "dest": ARCHIVE}}
    load = {
        "name": "image",
        "community.docker.docker_image": {"name": image, "source": "load", "load_path": ARCHIVE},
    }
    container = {"name": "bench", "image": image, "network_mode": "none", "pull": "never"}
    run = {"name": "container", "community.docker.docker_container": container}
    return [
        {"hosts": "builder", "gather_facts": False, "tasks": [export, fetch]},
        {"hosts": "targets", "gather_facts": False, "tasks": [copy, load, run]},
    ]


class Ansible(Tool):
    """`ansible-playbook`."""

    name = "Ansible, docker_image"

    @classmethod
    def install_once(cls) -> None:
        """Install it where the other benchmark does."""
        Provisioning.install_once()

    @classmethod
    def version(cls) -> str:
        """Return ansible-core's version."""
        return Provisioning.version()

    def begin(self) -> None:
        """Put `requests` on the robots, for community.docker."""
        super().begin()
        target = f"for d in {PACKAGES}; do :; done; mkdir -p $d && tar -C $d -xf -"
        for name, _ in (self.fleet.builder, *self.fleet.targets):
            self.fleet.lab.enter(name, target, stdin=peers.for_robots(["requests"]))

    def call(self, image: str) -> Call:
        """Write configuration, inventory and playbook."""
        targets = {name: {"ansible_host": address} for name, address in self.fleet.targets}
        name, address = self.fleet.builder
        common = {"ansible_user": "root", "ansible_ssh_private_key_file": str(KEY)}
        groups = {"builder": {"hosts": {name: {"ansible_host": address}}}, "targets": {"hosts": targets}}
        config = CONFIG.format(
            forks=len(targets), strategy="free", plugins="", known_hosts=KNOWN_HOSTS, folder=self.folder
        )
        (self.folder / "ansible.cfg").write_text(config)
        (self.folder / "inventory.yml").write_text(yaml.safe_dump({"all": {"children": groups, "vars": common}}))
        plays = playbook(image, str(self.folder / "image.tar"))
        (self.folder / "playbook.yml").write_text(yaml.safe_dump(plays, sort_keys=False))
        program = peers.CACHE / Provisioning.environment / "bin" / "ansible-playbook"
        env = {"ANSIBLE_CONFIG": str(self.folder / "ansible.cfg"), "ANSIBLE_NOCOLOR": "1", "LC_ALL": "C.UTF-8"}
        return Call((str(program), "-i", "inventory.yml", "playbook.yml"), env)
