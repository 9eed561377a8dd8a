"""Compose projects of chance: every field that robots use, in all its forms, with variables, merges and more files.

A project is a few files of text. Most parts are right, some are not, so that refusals are compared too.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field

from hypothesis import strategies as st

SETTINGS = {"X": "xv", "E": "", "N": "2"}
"""Variables of the command line."""
SERVICES = ("talker", "listener", "driver", "a.b")
NETWORKS = ("lan", "default", "field")
VOLUMES = ("maps", "bags", "m")
PROFILES = ("sim", "real")


@dataclass
class Project:
    """Files by name, the ones that are named on the command line, and the profiles that are on."""

    files: dict[str, str] = field(default_factory=dict)
    main: list[str] = field(default_factory=list)
    profiles: list[str] = field(default_factory=list)


def one(*words: str) -> st.SearchStrategy[str]:
    """Draw one of some texts of YAML."""
    return st.sampled_from(words)


def mostly(good: st.SearchStrategy[str], bad: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Draw what is right, and once in a while what is wrong, or may be."""
    return st.integers(0, 39).flatmap(lambda number: bad if number == 17 else good)


def quoted(parts: st.SearchStrategy[list[str]]) -> st.SearchStrategy[str]:
    """Draw a text in double quotes from parts."""
    return parts.map(lambda pieces: json.dumps("".join(pieces)))


def flow_list(items: st.SearchStrategy[str], most: int = 3) -> st.SearchStrategy[str]:
    """Draw a list."""
    return st.lists(items, min_size=1, max_size=most).map(lambda all_items: f"[{', '.join(all_items)}]")


def flow_map(**fields: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Draw a map that has some of the fields."""
    return st.fixed_dictionaries({}, optional=fields).map(
        lambda drawn: "{" + ", ".join(f"{name}: {text}" for name, text in drawn.items()) + "}"
    )


_PIECES = [
    "$X",
    "${X}",
    "${E:-d}",
    "${E-d}",
    "${U:-",
    "${U-",
    "${X:+",
    "${E+",
    "${X?",
    "}",
    "$$",
    "{",
    "a",
    "/",
    ":",
    " ",
    "-",
]
_nested = st.recursive(
    st.sampled_from(["a", "$X", "${X}", "$$", "{}", "x y", "", "1", "-", "${E}"]),
    lambda inner: st.tuples(one("X", "E", "U"), one(":-", "-", ":+", "+", ":?", "?"), inner).map(
        lambda drawn: "${X}" if drawn[1].endswith("?") else f"${{{drawn[0]}{drawn[1]}{drawn[2]}}}"
    ),
    max_leaves=4,
)
variables = mostly(quoted(st.lists(_nested, max_size=4)), quoted(st.lists(st.sampled_from(_PIECES), max_size=6)))
_WORDS = [
    "run",
    " ",
    "  ",
    "'",
    '"',
    "\\",
    ";",
    "|",
    ">",
    "2>",
    "&&",
    "(",
    ")",
    "$$(",
    "`",
    "a b",
    "--x=1",
    "#",
    "\t",
    "\n",
    "${N}",
]
_CLEAN = [
    "run",
    " ",
    "  ",
    "'a b'",
    '"x  y"',
    "\\\\",
    "\\n",
    "; x",
    "| y",
    "> z",
    "2> f",
    "&& q",
    "$$(ls x)",
    "`a b`",
    "--x=1",
    "#",
    "\t",
    "${N}",
    "''",
]
command = st.one_of(
    quoted(st.lists(st.sampled_from(_CLEAN), max_size=7)),
    quoted(st.lists(st.sampled_from(_CLEAN), max_size=7)),
    quoted(st.lists(st.sampled_from(_WORDS), max_size=7)),
    one(
        "[]",
        "",
        "[a, '', 'b c']",
        "ros2 launch nav2_bringup bringup_launch.py use_sim_time:=true",
        "bash -c 'sleep 1; exec x'",
    ),
)
scalar = st.one_of(
    one(
        "1",
        "010",
        "0x1F",
        "1.50",
        "1e3",
        "true",
        "yes",
        "no",
        "null",
        "",
        "~",
        "''",
        "a b",
        "1_000",
        ".5",
        "-0",
        "0o17",
        "12:30",
    ),
    one(
        "'1.0'",
        '"yes"',
        '"${X}"',
        "'$$X'",
        '"${N}"',
        "-1.5e-7",
        "123456789.25",
        "NULL",
        "on",
        "off",
        "0b11",
        "08",
        "=",
        "a=b",
    ),
    st.integers(-(2**70), 2**70).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
)
names = one("ROS_DOMAIN_ID", "RMW", "A", "B.c", "d-e")
pairs = st.one_of(
    st.dictionaries(names, scalar, max_size=4).map(lambda d: "{" + ", ".join(f"{n}: {v}" for n, v in d.items()) + "}"),
    flow_list(one("A=1", "A", "B.c=x=y", "'d-e='", "RMW=${X}", "A=2", '"Q=a b"')),
)
port = mostly(
    one(
        '"80:80"',
        '"8000-8002:9000-9002/udp"',
        "7400",
        '"127.0.0.1:1:2"',
        '"[::1]:5:6"',
        '"${N}0:80"',
        '"9090"',
        '"11-12:13"',
        "{target: 80}",
        '{target: "81", published: 8081, protocol: udp, host_ip: 10.0.0.1}',
        '"80:80/sctp"',
        '":5"',
        '{target: 80, published: "80", mode: host, name: web, app_protocol: http}',
        "0x50",
        '"5000-5001"',
        '"80/TCP"',
    ),
    one('"x"', '"1:2-3"', "80.5", '"70000"', "{published: 80}", '"80/x"', "true"),
)
mount = mostly(
    one(
        "./config:/config:ro",
        '"maps:/maps"',
        "/dev:/dev",
        "/tmp/.X11-unix:/tmp/.X11-unix:rw",
        '"~/.ros:/root/.ros"',
        '"m:/m"',
        "./a:/b/../c/",
        "/data",
        '"bags:/bags:nocopy,ro"',
        '"../up:/up"',
        "{type: bind, source: ./x, target: /x/}",
        '"./z:/z:z,rshared"',
        "{type: volume, source: maps, target: /v, volume: {nocopy: true}, read_only: true}",
        '"./:/src"',
        '"${X}:/x"',
        "{type: tmpfs, target: /t}",
        "{type: tmpfs, target: /t, tmpfs: {size: 64m, mode: 0755}}",
        '"./config:/config"',
        '"./q:/q:foo"',
        "{type: bind, source: /s, target: /s, bind: {propagation: rslave, create_host_path: false}}",
    ),
    one('"/a:/b:ro:c"', '"unknown:/u"', '""', '"::"', "{type: bind, source: /s}", "{type: x, target: /t}", "5"),
)
device = mostly(
    one(
        "/dev/ttyUSB0",
        "/dev/video0:/dev/video1",
        '"/dev/i2c-1:/dev/i2c-1:rw"',
        "{source: /dev/a, target: /dev/b, permissions: r}",
        '"/dev/ttyUSB0:/dev/gps:rwm"',
        '"${X:-/dev/null}:/dev/x"',
        "vendor.com/class=name",
    ),
    one('"a:b:c:d"', "{target: /x}", "5"),
)
duration = mostly(
    one("10s", "1m30s", "1h", "500ms", "1.5s", '"0"', "2d", "90m", "1us", "${N}s"), one('"10"', "x", "5", '""')
)
size = mostly(
    one("512m", "1g", '"1.5gb"', "1024", "64mib", "0", '"10 mb"', "1kb", "${N}g", '"2t"'),
    one("-1", "x", "true", '"1 x"', '"-5m"'),
)
flag = mostly(one("true", "false", '"true"', '"yes"', '"${T:-false}"', "yes", '"on"'), one("1", "", "x", "[]"))
whole = mostly(one("1", '"2"', "0", "${N}", "10"), one("x", "1.0", "-1", "2.5", "true"))
amount = mostly(one("0.5", '"1.5"', "2", "0", "1.123456789", "${N}", "0.1"), one('"x"', "true"))
test = mostly(
    st.one_of(
        command.filter(lambda text: text.startswith('"')),
        one("[CMD, curl, '-f', x]", "[CMD-SHELL, 'a || b']", "[NONE]"),
    ),
    flow_list(one("CMD", "curl", "1")),
)
health = flow_map(test=test, interval=duration, timeout=duration, retries=whole, start_period=duration, disable=flag)
reserved = mostly(
    one(
        "[{driver: nvidia, count: 1, capabilities: [gpu]}]",
        "[{capabilities: [gpu], device_ids: ['0', '1']}]",
        "[{count: all, capabilities: [gpu, compute]}]",
        "[{capabilities: [gpu], options: {a: b}}]",
    ),
    one("[{driver: nvidia}]", "[]", "[{capabilities: [gpu], count: 1, device_ids: ['0']}]"),
)
limits = flow_map(cpus=amount, memory=one("512m", "1g", "'0'"), pids=whole)
deploy = flow_map(
    replicas=whole,
    mode=one("global", "replicated"),
    labels=pairs,
    restart_policy=flow_map(condition=one("any"), delay=duration),
    resources=flow_map(limits=limits, reservations=flow_map(devices=reserved, memory=one("1g"))),
    placement=flow_map(constraints=one("[node.hostname == r1]"), max_replicas_per_node=whole),
    update_config=flow_map(parallelism=whole, delay=duration, order=one("start-first"), max_failure_ratio=amount),
)
hosts = st.one_of(
    flow_list(one('"r1:10.0.0.1"', '"r2=10.0.0.2"', '"v6:::1"', '"v6=[::1]"', '"host.docker.internal:host-gateway"')),
    one("{r1: 10.0.0.1, r3: [1.1.1.1, 2.2.2.2]}"),
)
limit = mostly(one("1024", '"5"', "0", "-1", "{soft: 1, hard: 2}", "{soft: -1, hard: '5'}"), one("{soft: 1}", "x"))
build = st.one_of(
    one("./robot", ".", "https://github.com/a/b.git", "{}"),
    flow_map(
        context=one("./ctx", "."),
        dockerfile=one("Dockerfile.arm", "d/D"),
        target=one("run"),
        args=pairs,
        labels=pairs,
        network=one("host"),
        cache_from=one("[x]"),
        shm_size=size,
        tags=one("[a, b]"),
        platforms=one("[linux/arm64]"),
        additional_contexts=one("{q: ./q}", "[r=docker-image://x]"),
        no_cache=flag,
        extra_hosts=hosts,
        privileged=flag,
    ),
)
attached = one("{}", "", "{aliases: [a, b]}", "{ipv4_address: 10.1.0.5, priority: 3}", "{driver_opts: {a: 1}}")
networks = st.one_of(
    flow_list(one(*NETWORKS), 2),
    st.dictionaries(one(*NETWORKS), attached, max_size=2).map(
        lambda d: "{" + ", ".join(f"{n}: {v}" for n, v in d.items()) + "}"
    ),
)
depends = mostly(
    one("[driver]", "{driver: {condition: service_started}}"),
    st.one_of(
        flow_list(one(*SERVICES), 2),
        one(
            "{driver: {condition: service_healthy}}",
            "{driver: {condition: service_started, required: false, restart: true}}",
            "{talker: {condition: service_completed_successfully}}",
            "{talker: {condition: x}}",
        ),
    ),
)
env_file = one(
    "e.env",
    "[e.env, f.env]",
    "[{path: f.env, required: false}]",
    "[{path: no.env, required: false}]",
    "[{path: e.env, format: raw}]",
)
FIELDS: dict[str, st.SearchStrategy[str]] = {
    "image": st.one_of(one("ros:humble", '"ros:${TAG:-jazzy}"', "ghcr.io/a/b@sha256:00"), variables),
    "command": command,
    "entrypoint": command,
    "environment": pairs,
    "env_file": env_file,
    "labels": pairs,
    "annotations": pairs,
    "ports": flow_list(port),
    "expose": flow_list(one("1", '"2-3"', '"1"')),
    "volumes": flow_list(mount, 4),
    "devices": flow_list(device),
    "depends_on": depends,
    "networks": networks,
    "network_mode": one("host", "none", "bridge"),
    "healthcheck": health,
    "deploy": deploy,
    "ulimits": flow_map(nofile=limit, rtprio=limit, memlock=limit),
    "extra_hosts": hosts,
    "build": build,
    "gpus": one("all", "[{driver: nvidia, count: 1}]", "[]"),
    "mem_limit": size,
    "shm_size": size,
    "mem_reservation": size,
    "memswap_limit": size,
    "cpus": amount,
    "pids_limit": whole,
    "cpu_shares": whole,
    "oom_score_adj": whole,
    "scale": whole,
    "stop_grace_period": duration,
    "privileged": flag,
    "tty": flag,
    "stdin_open": flag,
    "init": flag,
    "read_only": flag,
    "restart": one("always", "unless-stopped", '"no"', "no", "on-failure:3"),
    "cap_add": flow_list(one("NET_ADMIN", "SYS_NICE", "ALL")),
    "cap_drop": flow_list(one("ALL", "MKNOD")),
    "security_opt": one("[a:b]"),
    "group_add": flow_list(one("dialout", "1000", '"44"')),
    "device_cgroup_rules": one("['c 189:* rmw']"),
    "user": one('"1000:1000"', "root"),
    "tmpfs": one("/run", "[/run, '/tmp:size=1m']"),
    "dns": one("8.8.8.8", "[1.1.1.1, '']"),
    "dns_search": one("lan", "[a, b]"),
    "sysctls": one("{net.core.rmem_max: 2147483647}", "[net.ipv4.ip_forward=1]"),
    "ipc": one("host", "shareable"),
    "pid": one("host"),
    "runtime": one("nvidia"),
    "logging": one("{driver: json-file, options: {max-size: 10m, max-file: 3}}", "{}"),
    "working_dir": one("/ws", "rel"),
    "hostname": variables,
    "container_name": one("robot", '"${X}-c"'),
    "profiles": flow_list(one(*PROFILES), 2),
    "links": one('["driver:d"]', "[talker]"),
    "volumes_from": one("[driver:ro]"),
    "stop_signal": one("SIGINT"),
    "pull_policy": one("always", "if_not_present"),
    "secrets": one("[key]", "[{source: key, target: /k, mode: 0400}]"),
    "configs": one("[cfg, {source: cfg, target: /c}]"),
    "x-note": one("{a: [1]}"),
    "storage_opt": one("{size: 1g}"),
    "platform": one("linux/arm64"),
    "userns_mode": one("host"),
    "cpuset": one('"0,1"'),
    "unknown_key": one("1"),
}
_ODD = {"unknown_key", "links", "volumes_from", "annotations", "scale", "storage_opt", "hostname", "container_name"}
_COMMON = sorted(set(FIELDS) - _ODD)


@st.composite
def fields(draw: st.DrawFn, most: int = 6, tags: bool = False) -> list[str]:
    """Draw some fields of a service, as lines."""
    chosen = draw(st.lists(st.sampled_from(_COMMON * 8 + sorted(_ODD)), max_size=most, unique=True))
    if "networks" in chosen and "network_mode" in chosen and draw(st.integers(0, 30)) != 17:
        chosen.remove("network_mode")
    lines = []
    for name in chosen:
        tag = draw(st.sampled_from(["", "", "", "", "!override ", "!reset "])) if tags else ""
        lines.append(f"{name}: {tag}{draw(FIELDS[name])}")
    return lines


@st.composite
def service(draw: st.DrawFn, name: str, first: bool) -> list[str]:
    """Draw one service, as lines."""
    lines = [line for line in draw(fields(tags=not first)) if name != "driver" or not line.startswith("depends_on")]
    if first and not any(line.startswith(("image:", "build:")) for line in lines):
        lines.append(draw(st.sampled_from(["image: x", "image: x", "image: ${X}", "build: ."])))
    more = draw(st.integers(0, 11))
    if more == 5 and (name != "driver" or draw(st.integers(0, 9)) == 7):
        lines.append(f"extends: {draw(one('driver', 'driver', 'driver', 'talker'))}")
    elif more == 7:
        lines.append("extends: {file: sub/base.yml, service: base}")
    elif more in (2, 3, 9) and first:
        lines.append(draw(one("<<: *one", "<<: [*two, *one]", "<<: [*one, *two]")))
    return [f"  {name}:", *(f"    {line}" for line in lines)] if lines else [f"  {name}: {{}}"]


_TOP = """networks:
  lan: {ipam: {config: [{subnet: 10.1.0.0/16}]}}
  field: {external: true}
volumes:
  bags: {driver: local, driver_opts: {type: none, o: bind, device: ./b}}
  maps:
  m: {external: true}
  b: {name: "${X}"}
secrets: {key: {file: ./key}}
configs: {cfg: {file: ./cfg}}
"""


@st.composite
def projects(draw: st.DrawFn) -> Project:
    """Draw a project."""
    project = Project(
        {"e.env": draw(dotenv), "f.env": "F=1\nG=${F}${X}\n"},
        ["c.yml"],
        draw(st.lists(one(*PROFILES, "*"), max_size=1)),
    )
    if draw(st.booleans()):
        project.files[".env"] = draw(one("TAG=iron\n", "T=true\nA='q'\n", "X=lost\nA=${X}\n", "COMPOSE_PROFILES=sim\n"))
    anchors = "\n".join(
        f"x-{name}: &{name}\n" + ("\n".join(f"  {line}" for line in lines) or "  restart: always")
        for name, lines in (("one", draw(fields(3))), ("two", draw(fields(3))))
    )
    chosen = draw(
        st.lists(one(*SERVICES), max_size=3, unique=True).map(lambda names: [*{**dict.fromkeys(names), "driver": None}])
    )
    body = "\n".join(line for name in chosen for line in draw(service(name, True)))
    include = "include: [sub/more.yml]\n" if draw(st.integers(0, 5)) == 3 else ""
    begin = draw(one("", "name: Fleet 1", "version: '3'"))
    project.files["c.yml"] = f"{begin}\n{include}{anchors}\nservices:\n{body}\n{_TOP}"
    base = "\n".join(
        f"    {line}" for line in ["image: base", *(x for x in draw(fields(5)) if not x.startswith("image"))]
    )
    project.files["sub/base.yml"] = f"services:\n  base:\n{base}\n"
    more = "\n".join(
        f"    {line}" for line in ["image: more", *(x for x in draw(fields(4)) if not x.startswith("image"))]
    )
    project.files["sub/more.yml"] = (
        f"services:\n  more:\n{more}\nvolumes: {{maps: , more: }}\nsecrets: {{other: {{file: ./key}}}}\n"
    )
    for name in ("sub/e.env", "sub/f.env"):
        project.files[name] = "S=1\n"
    if draw(st.integers(0, 2)) == 1:
        project.main.append("d.yml")
        names_of = draw(st.lists(st.sampled_from([*chosen, "extra"]), min_size=1, max_size=2, unique=True))
        over = "\n".join(line for name in names_of for line in draw(service(name, name == "extra")) if "<<" not in line)
        project.files["d.yml"] = f"services:\n{over}\n"
    return project


_LINES = [
    "A=1",
    "B='a b'",
    'C="x y" # c',
    "D=${A}",
    'E1="${A:-z}"',
    "F=a#b",
    "G=a # b",
    "export H=1",
    "I: 2",
    "J = 3",
    "K=",
    "L='$A'",
    'M="a\\nb"',
    "# comment",
    "",
    "N1=$$A",
    'O="\\$A"',
    "P='it\\'s'",
    'Q={"a": 1}',
    "1R=x",
    "S.T=1",
    "V=é",
]
dotenv = st.lists(st.sampled_from(_LINES), max_size=6).map(lambda lines: "\n".join([*lines, ""]))
dotenv = mostly(dotenv, one("bad name=1\n", 'U="open', "A@=1\n", "X\nY=${X}\n"))
