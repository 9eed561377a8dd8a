"""What a container may be told to run with: the same words, forms and ceilings that an EDF is held to.

A plan file or a playbook states them in the form that definitions are read into, past the schema. Permissions are asked
by these words, so one that is written in another way must not get there. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov.definitions.container_words import ADDED, lengths, too_much
from srprov.definitions.containermodel import Runtime, of_links
from srprov.names import label_fault
from srprov.published import may_be_published_at

HOST = r"[A-Za-z0-9]([A-Za-z0-9._-]{0,61}[A-Za-z0-9])?"
"""A name in a hosts file."""
HOSTNAME = re.compile(rf"({HOST})?")
_ULIMITS = {
    *("core", "cpu", "data", "fsize", "locks", "memlock", "msgqueue", "nice", "nofile", "nproc", "rss", "rtprio"),
    *("rttime", "sigpending", "stack"),
}
_LONGEST_S = 24 * 3600.0
_MOST = 20_000
"""Entries of one list or map, merged of all files that it may come from."""
_LEAST_CPUS = 0.01
"""An engine takes no less, and a figure that is rounded to 0 is no limit at all."""
_MOST_PORTS = _MOST_RETRIES = 1000
_PORTS = range(1, 65_536)
_PROTOCOLS = ("tcp", "udp")
_SIZES = range(1 << 62)
_WORDS = {
    "restart": (re.compile(r"no|always|unless-stopped|on-failure(:[0-9]{1,6})?"), "a policy such as on-failure:3"),
    "ipc": (re.compile(r"(host|private|shareable|none)?"), "host, private, shareable or none"),
    "pid": (re.compile(r"(host)?"), "host"),
    "gpus": (re.compile(r"(all|[1-9][0-9]{0,5})?"), "'all' or a number"),
    "pull_policy": (re.compile(r"missing|always|never|build"), "missing, always, never or build"),
    "working_dir": (re.compile(r"(/.*)?", re.DOTALL), "an absolute path"),
    "cpuset": (re.compile(r"([0-9]{1,4}(-[0-9]{1,4})?(,(?!\Z)|\Z))*"), "processors such as 0-2,5"),
    "runtime": (re.compile(r"([A-Za-z0-9][A-Za-z0-9_.-]{0,127})?"), "a runtime of the engine"),
    "hostname": (HOSTNAME, "a host's name"),
}
_ITEMS = {
    "cap_add": re.compile(r"(CAP_)?[A-Z_]+"),
    "cap_drop": re.compile(r"(CAP_)?[A-Z_]+"),
    "device_cgroup_rules": re.compile(r"[acb] ([0-9]+|\*):([0-9]+|\*) [rwm]{1,3}"),
}
_LISTS = (
    *("devices", "ulimits", "group_add", "security_opt", "environment", "sysctls", "labels", "extra_hosts"),
    *_ITEMS,
)


def broken(run: Runtime) -> Iterator[str]:
    """Return what an EDF could not say, with the field at its beginning."""
    if wrong := too_much(lengths(run), ADDED):
        yield wrong
    for name, (form, words) in _WORDS.items():
        if not form.fullmatch(getattr(run, name)):
            yield f"{name}: expected {words}, not {getattr(run, name)[:60]!r}"
    for name in _LISTS:
        if len(getattr(run, name)) > _MOST:
            yield f"{name}: more than {_MOST} entries"
    for name, ports in (("ports", run.ports), ("expose", run.expose)):
        if len(ports) > _MOST_PORTS:
            yield f"{name}: more than {_MOST_PORTS} ports"
    for name, form in _ITEMS.items():
        yield from (f"{name}: {one[:60]!r} cannot be" for one in getattr(run, name) if not form.fullmatch(one))
    for name, *ends in run.ulimits:
        if name not in _ULIMITS or min(ends) < -1:
            yield f"ulimits: {name[:60]!r} with {ends} cannot be"
    for path, inside, rights in run.devices:
        if not (path.startswith("/") and inside.startswith("/") and re.fullmatch(r"[rwm]{1,3}", rights)):
            yield f"devices: {path[:60]!r} cannot be"
    for address, published, into, protocol in run.ports:
        if not may_be_published_at(address):
            yield f"ports: {published} cannot be published at {address[:60]!r}"
        if published not in _PORTS or into not in _PORTS or protocol not in _PROTOCOLS:
            yield f"ports: {published}:{into}/{protocol[:20]} cannot be"
        elif of_links(("", published, into, protocol)):
            yield f"ports: {published}/{protocol} is one that overlays have"
    for port, protocol in run.expose:
        if port not in _PORTS or protocol not in _PROTOCOLS:
            yield f"expose: {port}/{protocol[:20]} cannot be"
    for label in run.labels:
        if label == "" or label_fault(label):
            yield f"labels: {label[:60]!r} cannot be"
    for host, _ in run.extra_hosts:
        if not re.fullmatch(HOST, host):
            yield f"extra_hosts: {host[:60]!r} cannot be"
    if run.logging and not re.fullmatch(r"[A-Za-z0-9/:._-]{0,200}", run.logging.driver):
        yield f"logging: {run.logging.driver[:60]!r} cannot be"
    yield from _figures(run)


def _figures(run: Runtime) -> Iterator[str]:
    check = run.healthcheck
    seconds = [run.stop_grace_s, *((check.interval_s, check.timeout_s, check.start_period_s) if check else ())]
    for one in seconds:
        if not 0 <= one <= _LONGEST_S:
            yield f"{'stop_grace_s' if one == run.stop_grace_s else 'healthcheck'}: {one} is not within 24 hours"
    tests = ((), ("NONE",), ("CMD",), ("CMD-SHELL",))
    if check and (check.retries not in range(1 if check.test else 0, _MOST_RETRIES + 1) or check.test[:1] not in tests):
        yield "healthcheck: its test or its retries cannot be"
    if run.oom_score_adj not in range(-1000, 1001):
        yield f"oom_score_adj: {run.oom_score_adj} is not within -1000 and 1000"
    for name in ("mem_limit", "mem_reservation", "pids_limit", "shm_size"):
        if getattr(run, name) not in _SIZES:
            yield f"{name}: {getattr(run, name)} is too large or less than nothing"
    if run.cpus != 0 and not _LEAST_CPUS <= run.cpus <= _MOST:
        yield f"cpus: {run.cpus} is too large, or less than {_LEAST_CPUS}"
