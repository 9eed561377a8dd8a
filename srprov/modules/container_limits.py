"""Limits of containers that `docker update` may have changed: they are no part of what an engine lists.

To inspect each container would be another round trip, so the files are read in which the engine keeps what it was told,
in the round trip that there is. Where they cannot be read nothing is said of limits. Pure.

Source: moby, `container/container.go` (hostconfig.json); Docker Engine API 1.41, "Update a container".
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from srprov.modules.container_body import engine_body
from srprov.modules.container_leftover import BUILD_HOST
from srprov.modules.container_params import ContainerParams
from srprov.robot_answers import MOST_LINES
from srprov.untrusted import lines_of
from srprov.wire import Query, Reply

_FIELDS = {
    "Memory": "mem_limit",
    "MemoryReservation": "mem_reservation",
    "CpuQuota": "cpus",
    "NanoCpus": "cpus",
    "CpusetCpus": "cpuset",
    "PidsLimit": "pids_limit",
    "RestartPolicy": "restart",
}
"""The engine's word -> the EDF's."""
_UNSET = {"CpusetCpus": "", "RestartPolicy": ":0"}
"""What stands there when nothing was said; else 0."""
_NUMBERS = "|".join(key for key in _FIELDS if key not in ("CpusetCpus", "RestartPolicy"))
_WRITTEN = (
    f'"({_NUMBERS})":-?[0-9]+|"CpusetCpus":"[0-9,-]*"|"RestartPolicy":\\{{"Name":"[a-z-]*","MaximumRetryCount":[0-9]+'
)
_OF_BUILD = f'"ExtraHosts":["{BUILD_HOST}"'
QUERY = Query(
    command=f"""\
r=/var/lib/docker
while IFS= read -r l || [ "$l" ]; do
  case $l in *'"data-root"'*) r=${{l#*'"data-root"'}}; r=${{r#*'"'}}; r=${{r%%'"'*}};; esac
done 2>/dev/null </etc/docker/daemon.json
grep -EsHo '{_WRITTEN}|{re.escape(_OF_BUILD)}' "$r"/containers/*/hostconfig.json
:""",
    in_place=True,
)
_LINE = re.compile(r'/([0-9a-f]{64})/hostconfig\.json:"([A-Za-z]+)":(.{0,200})')
_POLICY = re.compile(r'\{"Name":"([a-z-]*)","MaximumRetryCount":([0-9]{1,9})')


def limits_of(reply: Reply) -> dict[str, dict[str, str]]:
    """Return container's id -> the engine's word -> what it keeps of it."""
    found: dict[str, dict[str, str]] = {}
    for line in _lines(reply):
        if (match := _LINE.search(line)) and match[2] in _FIELDS:
            policy = _POLICY.fullmatch(match[3])
            found.setdefault(match[1], {})[match[2]] = f"{policy[1]}:{policy[2]}" if policy else match[3].strip('"')
    return found


def of_builds(reply: Reply) -> frozenset[str]:
    """Return the ids of containers that were made for a build of srprov's."""
    found = (_LINE.search(line) for line in _lines(reply) if line.endswith(_OF_BUILD))
    return frozenset(match[1] for match in found if match)


def _lines(reply: Reply) -> list[str]:
    """Return the lines; of an answer with more than are read nothing is said, as of files that cannot be read."""
    lines = lines_of(reply.out, MOST_LINES + 1)
    return lines if len(lines) <= MOST_LINES else []


def changed_limits(want: ContainerParams, found: Mapping[str, str]) -> str:
    """Return in words which limits are not those that the container was made with, or nothing.

    One that is not there at all is no change: an engine drops what its kernel cannot limit, and `docker update` takes
    no limit away, but for that of processes (-1).
    """
    host = engine_body(want)["HostConfig"]
    policy = host["RestartPolicy"]
    wanted = {**host, "RestartPolicy": f"{policy['Name']}:{policy['MaximumRetryCount']}"}
    changed = {
        _FIELDS[key] for key, value in found.items() if value not in (_UNSET.get(key, "0"), str(wanted.get(key, 0)))
    }
    if found.get("PidsLimit") == "-1" and not want.run.pids_limit:
        changed.discard("pids_limit")
    return (
        f"{', '.join(sorted(changed))} {'was' if len(changed) == 1 else 'were'} changed on the robot" if changed else ""
    )
