"""pyinfra: facts decide what is missing, then its docker operations and the shell lines that everybody runs.

Set fast, as its documentation has it: one process, all hosts in parallel (`--parallel N`), no waiting for each other
between operations (`--no-wait`), no spinner. What it does not do by itself: its `docker.container` never sees that a
container differs, so the deploy compares a label and says `force`.
"""

from __future__ import annotations

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

INVENTORY = """\
common = {common!r}
robots = ({hosts!r}, common)
"""

DEPLOY = """\
import shlex

from pyinfra import host
from pyinfra.facts.docker import DockerContainer
from pyinfra.facts.server import Command
from pyinfra.operations import docker, server

data = host.data
linked = host.get_fact(Command, data.link + "if vxlan_right; then echo right; else echo missing; fi")
seen = host.get_fact(DockerContainer, object_id={container!r})
right = bool(seen) and seen[0]["Config"]["Labels"].get("bench") == data.digest

docker.network(
    name="bridge network", network={network!r}, driver="bridge", subnet={subnet!r}, gateway=data.gateway,
    opts={options!r},
)
if linked != "right":
    server.shell(name="VXLAN", commands=[data.link + "vxlan_make"])
docker.container(
    name="container", container={container!r}, image={image!r}, networks=[{network!r}],
    extra_args=["--ip", data.address], env_vars=["VALUE=" + data.value], labels=["bench=" + data.digest],
    command=shlex.join({command!r}), force=bool(seen) and not right,
)
"""


class Pyinfra(Tool):
    """`pyinfra inventory.py deploy.py -y`."""

    name = "pyinfra"

    @classmethod
    def install_once(cls) -> None:
        """Install pyinfra."""
        peers.environment("pyinfra", ["pyinfra>=3,<4"])

    @classmethod
    def version(cls) -> str:
        """Return pyinfra's and paramiko's versions."""
        return peers.version("pyinfra", "pyinfra", "paramiko")

    def call(self, job: Job, variant: str) -> Call:
        """Write an inventory with the shares of all robots, and the deploy."""
        hosts = [
            (
                member.robot,
                {
                    "ssh_hostname": member.underlay,
                    "link": link_script(job, member),
                    "digest": config_hash(member),
                    "address": member.address,
                    "gateway": member.gateway,
                    "value": member.value,
                },
            )
            for member in job.members
        ]
        common = {
            "ssh_user": "root",
            "ssh_key": str(KEY),
            "ssh_known_hosts_file": str(KNOWN_HOSTS),
            "ssh_strict_host_key_checking": "yes",
            "ssh_allow_agent": False,
            "ssh_look_for_keys": False,
        }
        deploy = DEPLOY.format(
            container=CONTAINER,
            network=NETWORK,
            subnet=SUBNET,
            image=IMAGE,
            command=list(COMMAND),
            options=[f"com.docker.network.bridge.name={BRIDGE}", f"com.docker.network.driver.mtu={MTU}"],
        )
        (self.folder / "inventory.py").write_text(INVENTORY.format(common=common, hosts=hosts))
        (self.folder / "deploy.py").write_text(deploy)
        count = str(len(job.members))
        words = ("inventory.py", "deploy.py", "-y", "--parallel", count, "--no-wait")
        return Call((str(peers.CACHE / "pyinfra" / "bin" / "pyinfra"), *words), {"PYINFRA_PROGRESS": "off"})
