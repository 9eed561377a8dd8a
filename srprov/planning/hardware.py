"""Which devices of a robot a container asks for: by their names, by rules, and graphics. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from srprov.definitions.containermodel import Runtime
from srprov.modules.mount_kind import plain
from srprov.planning.graver import noted, of_device, of_rule

Places = Callable[[str], bool]
_DEVICES = re.compile(r"/dev/(?!(shm|fd)(/|\Z))")
"""Not what containers write to, nor a link to what a process has open, behind which `..` leads anywhere."""
_ELSEWHERE = "not below /dev, as in a volume or a container's own files"
OTHERS = "below a folder that a container of the experiment writes to"


def of_hardware(run: Runtime, written: Places) -> Iterator[tuple[str, str]]:
    """Yield kind and words of the devices that a container asks for; `written` tells what containers write to."""
    for path, _, rights in run.devices:
        below_dev = _DEVICES.match(plain(path)) and ".." not in path.split("/")  # an engine goes by links first
        where = OTHERS if written(path) else "" if below_dev else _ELSEWHERE
        if where:
            yield "privileged", f"the device {path} ({rights}; {where}: it may be any device, which is as good as root)"
        else:
            yield "device", noted(path, "; ".join(filter(None, (rights, of_device(plain(path))))))
    for rule in run.device_cgroup_rules:
        yield "device", noted(f"cgroup rule {rule}", of_rule(rule))
    if run.gpus:
        yield "gpu", f"gpus: {run.gpus}"
