"""All contestants, by the names that `--tools` takes."""

from __future__ import annotations

from benchmarks.provisioning.ansible import Ansible, Mitogen
from benchmarks.provisioning.pyinfra import Pyinfra
from benchmarks.provisioning.swarm import Swarm
from benchmarks.provisioning.tool import Floor, Srprov, SrprovAtOnce, Tool

TOOLS: dict[str, type[Tool]] = {
    "floor": Floor,
    "srprov": Srprov,
    "srprov0": SrprovAtOnce,
    "pyinfra": Pyinfra,
    "ansible": Ansible,
    "mitogen": Mitogen,
    "swarm": Swarm,
}
