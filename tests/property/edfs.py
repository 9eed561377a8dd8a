"""Random EDFs that validate, with every field that an export converts: for what must hold of any experiment."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

NAMES = ["alfalfa", "camera", "map-server", "xylo_1", "x-service", "talker", "nine0", "very-long-name-of-a-service"]
TEXTS = st.text(
    st.one_of(
        st.sampled_from("ab $${}'\"\\:#-=,\n\t"), st.characters(exclude_categories=["Cs", "Cc", "Cn", "Zl", "Zp"])
    ),
    max_size=20,
).filter(lambda text: "{{" not in text and "secret://" not in text.lower() and "\ufeff" not in text)
WORDS = st.text("abcXYZ019_./-", min_size=1, max_size=12)
PATHS = WORDS.map(lambda word: f"/m/{word.strip('./') or 'x'}").filter(
    lambda path: "/../" not in f"{path}/" and "//" not in path
)
LINES = TEXTS.filter(lambda text: "\n" not in text)
VARIABLES = st.dictionaries(
    st.from_regex(r"[A-Z_][A-Z0-9_]{0,8}|x-[a-z]|[a-zA-Z0-9_.$é:{}-]{1,5}", fullmatch=True), TEXTS, max_size=4
)
SECONDS = st.sampled_from(["500ms", "1s", "1500ms", "90s", "1m30s", "2h", "250us", "10s"])
SIZES = st.sampled_from(["64m", "1g", "1048576", "100k", "1.5g"])
PORTS = st.integers(1, 65535)


def maybe(strategy: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Return what is often not there."""
    return st.one_of(st.none(), st.none(), strategy)


HEALTH = st.fixed_dictionaries(
    {"test": st.one_of(LINES.filter(bool), st.lists(LINES, min_size=1, max_size=3).map(lambda some: ["CMD", *some]))},
    optional={"interval": SECONDS, "timeout": SECONDS, "retries": st.integers(1, 9), "start_period": SECONDS},
)
PLAIN: dict[str, st.SearchStrategy[Any]] = {
    "command": st.lists(TEXTS, max_size=4),
    "entrypoint": st.lists(TEXTS, max_size=3),
    "working_dir": LINES.map(lambda text: f"/{text}"),
    "user": st.sampled_from(["robot", "1000", "1000:1000", "0:44", "$USER"]),
    "stop_signal": st.sampled_from(["SIGINT", "KILL", "9", "SIGRTMIN+3"]),
    "stop_grace_period": SECONDS,
    "healthcheck": st.one_of(HEALTH, st.just({"disable": True})),
    "devices": st.lists(
        st.sampled_from(["/dev/ttyUSB0", "/dev/video0:/dev/cam", "/dev/i2c-1:r", "/dev/a$b:/dev/x:rw"]),
        max_size=3, unique=True,
    ),
    "expose": st.lists(PORTS.map(str) | PORTS.map(lambda port: f"{port}/udp"), max_size=3, unique=True),
    "ulimits": st.dictionaries(
        st.sampled_from(["nofile", "rtprio", "memlock"]),
        st.integers(-1, 9999) | st.fixed_dictionaries({"soft": st.integers(0, 9), "hard": st.integers(9, 99)}),
        max_size=2,
    ),
    "cap_add": st.lists(st.sampled_from(["NET_ADMIN", "SYS_NICE", "ALL"]), max_size=2, unique=True),
    "cap_drop": st.lists(st.sampled_from(["MKNOD", "CAP_NET_RAW"]), max_size=2, unique=True),
    "privileged": st.booleans(),
    "sysctls": st.dictionaries(st.sampled_from(["net.a.b", "kernel.msgmax"]), st.integers(1, 99), max_size=2),
    "group_add": st.lists(st.sampled_from(["video", "44", "dialout"]), max_size=2, unique=True),
    "security_opt": st.lists(st.sampled_from(["no-new-privileges:true", "seccomp=unconfined"]), unique=True),
    "device_cgroup_rules": st.lists(st.sampled_from(["c 81:* rmw", "b 7:0 r"]), max_size=2, unique=True),
    "tty": st.booleans(),
    "stdin_open": st.booleans(),
    "init": st.booleans(),
    "read_only": st.booleans(),
    "tmpfs": st.lists(st.sampled_from(["/t1", "/t2:size=64m,mode=1777", "/t3:noexec"]), max_size=3, unique=True),
    "labels": st.dictionaries(
        st.from_regex(r"[a-z]{1,6}(\.[a-z]{1,4})?|x-[a-z]|[a-zA-Z0-9_. $é:{}#-]{1,5}", fullmatch=True), TEXTS,
        max_size=3,
    ),
    "logging": st.fixed_dictionaries(
        {"driver": st.sampled_from(["json-file", "local"])}, optional={"options": st.just({"max-size": "1m"})}
    ),
    "mem_limit": SIZES.filter(lambda size: size not in ("100k",)),
    "mem_reservation": st.just("100k"),
    "oom_score_adj": st.integers(-1000, 1000),
    "cpus": st.sampled_from([0.5, 1, 1.5, 0.01]),
    "cpuset": st.sampled_from(["0", "0-2", "0,1"]),
    "pids_limit": st.integers(1, 9999),
    "shm_size": SIZES,
    "ipc": st.sampled_from(["host", "private", "shareable", "none"]),
    "pid": st.just("host"),
    "gpus": st.one_of(st.just("all"), st.integers(1, 4)),
    "runtime": st.just("nvidia"),
    "restart": st.sampled_from(["no", "always", "unless-stopped", "on-failure", "on-failure:3"]),
    "pull_policy": st.sampled_from(["missing", "always", "never"]),
    "environment": VARIABLES,
    "cost": st.integers(0, 100),
    "requires": st.just({"tags": ["camera"], "memory": "1g"}),
    "extra_hosts": st.dictionaries(
        st.sampled_from(["cloud", "base.lan"]),
        st.sampled_from(["192.0.2.7", "2001:db8::1", ["192.0.2.1", "192.0.2.2"]]),
        max_size=2,
    ),
    "secrets": st.lists(
        st.sampled_from(["key", {"source": "cert", "target": "/etc/cert", "mode": "0444"}]), max_size=2, unique_by=str
    ),
    "robot": st.just("r1"),
    "env_file": st.just("vars.env"),
    "data": st.just([{"path": "ship/deep/b.bin", "target": "/data/b"}]),
}  # fmt: skip
FIELDS = st.fixed_dictionaries({}, optional=PLAIN)


@st.composite
def mounts(draw: st.DrawFn) -> list[Any]:
    """Return volumes of all kinds, each at a place of its own."""
    sources = draw(
        st.lists(
            st.sampled_from(["data", "seeded", "/dev/shm", "/opt/a $b", "./ship", "./ship/deep", "./ship/one.txt"]),
            max_size=4, unique=True,
        )
    )  # fmt: skip
    found: list[Any] = []
    for index, source in enumerate(sources):
        target = f"/v{index}{draw(PATHS)}"
        read_only = draw(st.booleans())
        if draw(st.booleans()) or " " in source:
            kind = "volume" if "/" not in source else "bind"
            one = {"type": kind, "source": source, "target": target, **({"read_only": True} if read_only else {})}
            if source.startswith("/opt") and draw(st.booleans()):
                one["bind"] = {"create_host_path": draw(st.booleans())}
            found.append(one)
        else:
            found.append(f"{source}:{target}" + (":ro" if read_only else ""))
    if draw(st.booleans()):
        found.append({"type": "tmpfs", "target": "/long", "tmpfs": {"size": "1m", "mode": "0700"}})
    return found


def _is_named(mount: Any) -> bool:
    source = mount.get("source", "/") if isinstance(mount, dict) else mount.partition(":")[0]
    return "/" not in source


@st.composite
def experiments(draw: st.DrawFn) -> dict[str, Any]:
    """Return an EDF as JSON values; the files that it names are those of `write`."""
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=4, unique=True))
    services: dict[str, Any] = {}
    for index, name in enumerate(names):
        one = draw(FIELDS)
        one |= draw(
            st.sampled_from(
                [{"image": "busybox:1.36"}, {"image": "ros:humble"}, {"cdf": "tool.cdf"}, {"cdf": "own.cdf"}]
            )
        )
        one |= {"volumes": given} if (given := draw(mounts())) else {}
        network = draw(st.sampled_from(["overlay", "overlay", "overlay", "host", "both", "none"]))
        one |= {"network": network} if network != "overlay" else {}
        several = draw(st.sampled_from([1, 1, 1, 2]))
        if several > 1:  # each has volumes of its own, which nobody else can share
            one |= {"replicas": several, "volumes": [own for own in one.get("volumes", []) if not _is_named(own)]}
        if network == "overlay":
            if several == 1 and (ports := draw(st.lists(st.integers(1024, 65000), max_size=2, unique=True))):
                one["ports"] = [
                    f"{port + 100 * index % 500}:{port}" if draw(st.booleans()) else str(port) for port in ports
                ]
            if several == 1 and draw(st.booleans()):
                one["hostname"] = f"host-{index}"
        if network == "none":
            one.pop("extra_hosts", None)
        earlier = {n: draw(st.sampled_from(["started", "completed"])) for n in names[:index] if draw(st.booleans())}
        waits = {n: how if services[n].get("restart") not in ("always", "unless-stopped") else "started"
                 for n, how in earlier.items()}  # fmt: skip
        one |= {"depends_on": {n: {"condition": how} for n, how in waits.items()}} if waits else {}
        services[name] = one
    alone = [name for name in names if all(name not in one.get("depends_on", {}) for one in services.values())]
    for name in alone:
        if draw(st.integers(0, 3)) == 0:
            services[name]["profiles"] = ["debug"]
    if any("seeded" in str(one.get("volumes")) for one in services.values()):
        seeds = {"volumes": {"seeded": {"seed": "./ship"}}}
    else:
        seeds = {}
    secrets = {"key": {"env": "API_KEY"}, "cert": {"file": "cert.pem"}}
    head = draw(st.fixed_dictionaries({}, optional={"description": LINES.filter(bool), "authors": st.just(["Ada"])}))
    return {"edf": 1, "name": "generated", **head, "secrets": secrets, **seeds, "services": services}


def write(folder: Path, document: dict[str, Any]) -> Path:
    """Write an EDF with the files that it may name; return its path."""
    (folder / "ship" / "deep").mkdir(parents=True)
    files = {
        "ship/one.txt": "one", "ship/deep/b.bin": "\0\1", "cert.pem": "never",
        "vars.env": "A=from a file\nQUOTED='x # $y'\nB=it's\nEMPTY=\n",
        "tool.cdf": "cdf: 1\nbase: debian\nfiles: [{src: ship/one.txt, dest: /one}]\n"
        "environment: {IN_IMAGE: 'a $b'}\nuser: robot\n",
        "own.cdf": "cdf: 1\ndockerfile: {context: docker, args: {V: '2'}, target: last}\n",
        "docker/Dockerfile": "ARG V\nFROM busybox AS last\nCOPY x /x\n", "docker/x": "x",
    }  # fmt: skip
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    edf = folder / "generated.edf"
    edf.write_text(json.dumps(document, ensure_ascii=False))
    return edf
