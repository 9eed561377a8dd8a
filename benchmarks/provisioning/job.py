"""The job that every tool does, as data, and the files that srprov and the floor need for it.

On each of N robots: a Docker bridge network, a VXLAN link to the N-1 others, and one busybox container with an address
of its own, from an image that is there already. Process 1 of the container ends at once on TERM.
"""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

IMAGE = "busybox"
COMMAND = ("sh", "-c", "trap 'exit 0' TERM; while :; do sleep 3600 & wait $!; done")
NETWORK = "bench"
BRIDGE = "bench0"
LINK = "benchvx0"
CONTAINER = "bench"
SUBNET = "10.99.0.0/16"
VNI = 4711
PORT = 4790
MTU = 1450
FLOOD = "00:00:00:00:00:00"


class Member(msgspec.Struct, frozen=True):
    """One robot's share."""

    robot: str
    underlay: str
    service: str
    address: str
    gateway: str
    value: str = "first"
    """What the variable VALUE of its container says; the scenario `changed` changes one."""


class Job(msgspec.Struct, frozen=True):
    """All robots' shares."""

    members: tuple[Member, ...]

    @property
    def changed(self) -> Job:
        """The same job with another value for the last robot's service."""
        return Job((*self.members[:-1], replace(self.members[-1], value="second")))

    def peers(self, member: Member) -> list[str]:
        """Return the underlay addresses of all others."""
        return [other.underlay for other in self.members if other is not member]


def make(robots: Sequence[tuple[str, str]]) -> Job:
    """Return the job for robots (name, underlay address)."""
    return Job(tuple(_member(index, name, address) for index, (name, address) in enumerate(robots, 1)))


def _member(index: int, robot: str, underlay: str) -> Member:
    return Member(
        robot=robot,
        underlay=underlay,
        service=f"svc{index:03}",
        address=f"10.99.{1 + index // 200}.{10 + index % 200}",
        gateway=f"10.99.0.{index}",
    )


def words() -> str:
    """Return the container's command for a shell."""
    return shlex.join(COMMAND)


def config_hash(member: Member) -> str:
    """Return the hash that the floor and the peers keep as a label."""
    return hashlib.sha256(
        json.dumps([IMAGE, COMMAND, msgspec.structs.asdict(member)], sort_keys=True).encode()
    ).hexdigest()[:16]


def link_script(job: Job, member: Member) -> str:
    """Return the shell lines that make the VXLAN link right; nothing happens where it is right already.

    The floor and all peers run these lines, so that none has a better or worse way to do it.
    """
    peers = job.peers(member)
    wanted = " ".join(f"'{FLOOD} dst {vtep} self permanent'" for vtep in peers)
    batch = "".join(f"fdb append {FLOOD} dev {LINK} dst {vtep} self permanent\\n" for vtep in peers)
    return f"""
vxlan_right() {{
  case "$(ip -o -d link show dev {LINK} 2>/dev/null)" in
    *"mtu {MTU} "*" master {BRIDGE} "*"vxlan id {VNI} local {member.underlay} "*"dstport {PORT}"*) ;;
    *) return 1 ;;
  esac
  have=$(bridge fdb show dev {LINK} 2>/dev/null)
  for entry in {wanted}; do
    case "$have" in *"$entry"*) ;; *) return 1 ;; esac
  done
}}
vxlan_make() {{
  ip link del dev {LINK} 2>/dev/null || true
  ip link add {LINK} type vxlan id {VNI} local {member.underlay} dstport {PORT} &&
  ip link set dev {LINK} mtu {MTU} master {BRIDGE} up &&
  printf '{batch}' | bridge -batch -
}}
"""


def floor_script(job: Job, member: Member) -> str:
    """Compile the whole job of one robot to one script: one check, and the work only where the check fails."""
    digest = config_hash(member)
    run = (
        f"docker run -d --name {CONTAINER} --network {NETWORK} --ip {member.address} --env VALUE={member.value} "
        f"--label bench={digest} {IMAGE} {words()}"
    )
    # a running container holds its network, so one call of Docker's client tells both
    return f"""{link_script(job, member)}
seen=$(docker container inspect -f '{{{{.State.Running}}}} {{{{.Config.Labels.bench}}}}' {CONTAINER} 2>/dev/null)
vxlan_right && linked=1 || linked=
test "$seen" = "true {digest}" && test -n "$linked" && exit 0
set -e
if test "$seen" != "true {digest}"; then
  if test -n "$seen"; then docker stop {CONTAINER} >/dev/null; docker rm {CONTAINER} >/dev/null; fi
  docker network inspect {NETWORK} >/dev/null 2>&1 || docker network create --driver bridge --subnet {SUBNET} \\
    --gateway {member.gateway} -o com.docker.network.bridge.name={BRIDGE} \\
    -o com.docker.network.driver.mtu={MTU} {NETWORK} >/dev/null
fi
test -n "$linked" || vxlan_make
test "$seen" = "true {digest}" || {run} >/dev/null
echo changed
"""


def edf(job: Job, name: str = "bench") -> dict[str, Any]:
    """Return the experiment for srprov: a service per robot; srprov decides which robot runs which."""
    services = {
        member.service: {"image": IMAGE, "command": list(COMMAND), "environment": {"VALUE": member.value}}
        for member in job.members
    }
    return {"edf": 1, "name": name, "services": services}
