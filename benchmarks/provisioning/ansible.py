"""Ansible, and Ansible with Mitogen: community.docker's modules and the shell lines that everybody runs.

Set fast, as their documentations have it: as many forks as robots, pipelining, ControlPersist, no facts (explicit
gathering, and the modules need none), a known interpreter, and without Mitogen the strategy `free`, so that no robot
waits for another.
ControlPersist's masters end with each run, as all tools begin without connections. community.docker's modules need
`requests` on the robot, which is set-up and not measured.
"""

from __future__ import annotations

import yaml

from benchmarks.provisioning import peers
from benchmarks.provisioning.job import (
    BRIDGE,
    COMMAND,
    CONTAINER,
    IMAGE,
    MTU,
    NETWORK,
    SUBNET,
    Job,
    config_hash,
    link_script,
)
from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS
from benchmarks.provisioning.tool import Call, Tool

CONFIG = """\
[defaults]
forks = {forks}
gathering = explicit
strategy = {strategy}
{plugins}
host_key_checking = True
interpreter_python = /usr/bin/python3
retry_files_enabled = False
[ssh_connection]
pipelining = True
ssh_args = -o ControlMaster=auto -o ControlPersist=60s -o UserKnownHostsFile={known_hosts} -o StrictHostKeyChecking=yes
control_path_dir = {folder}/cp
"""
PACKAGES = "/usr/local/lib/python3.*/dist-packages"
"""Where the robots' own Python looks for packages."""


def playbook() -> list[dict[str, object]]:
    """Return the play: network, link, container."""
    network = {
        "name": NETWORK,
        "driver": "bridge",
        "driver_options": {
            "com.docker.network.bridge.name": BRIDGE,
            "com.docker.network.driver.mtu": str(MTU),
        },
        "ipam_config": [{"subnet": SUBNET, "gateway": "{{ gateway }}"}],
    }
    container = {
        "name": CONTAINER,
        "image": IMAGE,
        "command": list(COMMAND),
        "networks": [{"name": NETWORK, "ipv4_address": "{{ address }}"}],
        "network_mode": NETWORK,
        "env": {"VALUE": "{{ value }}"},
        "labels": {"bench": "{{ digest }}"},
        "pull": "missing",
    }
    link = {
        "name": "VXLAN",
        "ansible.builtin.shell": "{{ link }}vxlan_right && echo right || vxlan_make",
        "register": "linked",
        "changed_when": "linked.stdout != 'right'",
    }
    tasks = [
        {"name": "bridge network", "community.docker.docker_network": network},
        link,
        {"name": "container", "community.docker.docker_container": container},
    ]
    return [{"hosts": "all", "gather_facts": False, "tasks": tasks}]


class Ansible(Tool):
    """`ansible-playbook`."""

    name = "Ansible"
    environment = "ansible"
    packages: tuple[str, ...] = ("ansible>=12,<13",)
    strategy = "free"

    @classmethod
    def install_once(cls) -> None:
        """Install ansible-core with the collections that the project ships."""
        peers.environment(cls.environment, cls.packages)

    @classmethod
    def version(cls) -> str:
        """Return ansible-core's version."""
        return peers.version(cls.environment, "ansible-core")

    def prepare_robots(self) -> None:
        """Put `requests` on the robots, for community.docker."""
        target = f"for d in {PACKAGES}; do :; done; mkdir -p $d && tar -C $d -xf -"
        self.lab.everywhere(target, stdin=peers.for_robots(["requests"]))

    def plugins(self) -> str:
        """Return lines for the configuration."""
        return ""

    def call(self, job: Job, variant: str) -> Call:
        """Write configuration, inventory and playbook."""
        hosts = {
            member.robot: {
                "ansible_host": member.underlay,
                "link": link_script(job, member),
                "digest": config_hash(member),
                "address": member.address,
                "gateway": member.gateway,
                "value": member.value,
            }
            for member in job.members
        }
        common = {"ansible_user": "root", "ansible_ssh_private_key_file": str(KEY)}
        inventory = {"all": {"hosts": hosts, "vars": common}}
        config = CONFIG.format(
            forks=len(job.members),
            strategy=self.strategy,
            plugins=self.plugins(),
            known_hosts=KNOWN_HOSTS,
            folder=self.folder,
        )
        (self.folder / "ansible.cfg").write_text(config)
        (self.folder / "inventory.yml").write_text(yaml.safe_dump(inventory))
        (self.folder / "playbook.yml").write_text(yaml.safe_dump(playbook(), sort_keys=False))
        program = peers.CACHE / self.environment / "bin" / "ansible-playbook"
        env = {"ANSIBLE_CONFIG": str(self.folder / "ansible.cfg"), "ANSIBLE_NOCOLOR": "1", "LC_ALL": "C.UTF-8"}
        return Call((str(program), "-i", "inventory.yml", "playbook.yml"), env)


class Mitogen(Ansible):
    """Ansible with the strategy that Mitogen's documentation names; `mitogen_free` was not faster in trials."""

    name = "Ansible+Mitogen"
    environment = "mitogen"
    packages = (*Ansible.packages, "mitogen>=0.3.50")
    strategy = "mitogen_linear"

    @classmethod
    def version(cls) -> str:
        """Return both versions."""
        return peers.version(cls.environment, "ansible-core", "mitogen")

    def plugins(self) -> str:
        """Name the folder of Mitogen's strategies."""
        found = sorted(
            (peers.CACHE / self.environment).glob("lib/python*/site-packages/ansible_mitogen/plugins/strategy")
        )
        return f"strategy_plugins = {found[0]}"
