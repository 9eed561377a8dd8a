"""Whatever a robot answers, its facts are plain values within bounds, and nothing raises."""

import json
import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.facts_table import facts_table
from srprov.definitions.model import Host
from srprov.facts.answers import parse_traffic
from srprov.facts.document import facts_document
from srprov.facts.host import host_queries, parse_host
from srprov.facts.model import HostFacts
from srprov.facts.probes import ENGINE, PROBES, Probe
from srprov.wire import Reply
from tests.conftest import examples

HOST = Host(name="robot1", address="robot1.example")

# as transport decodes them: every byte becomes some character
raw = st.binary(max_size=400).map(lambda data: data.decode("utf-8", "replace"))
latin = st.binary(max_size=400).map(lambda data: data.decode("latin-1"))
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
number = st.one_of(st.integers(), st.floats(), st.just("nan"), st.just("9" * 400), st.text(max_size=6)).map(str)


def shaped(fields: tuple[str, ...]) -> st.SearchStrategy[object]:
    """Return objects with the names that parsers look for, and anything as their values."""
    return st.dictionaries(st.sampled_from(fields), json_values, max_size=len(fields))


address = shaped(("local", "prefixlen", "tentative"))
link = st.fixed_dictionaries(
    {"ifname": st.text(max_size=18)},
    optional={
        "mtu": json_values,
        "flags": json_values,
        "address": json_values,
        "linkinfo": shaped(("info_kind", "info_data")) | st.just({"info_kind": "vxlan", "info_data": {"id": 2**70}}),
        "addr_info": st.lists(address, max_size=3) | json_values,
        "ifalias": json_values,
    },
)
route = shaped(("dst", "dev", "metric"))
paths = st.sampled_from(
    [
        "/proc/loadavg",
        "/proc/sys/fs/binfmt_misc/qemu-aarch64",
        "/proc/meminfo",
        "/proc/sys/kernel/hostname",
        "/sys/devices/system/cpu/online",
        "/etc/os-release",
        "/sys/class/net/eth0/speed",
        "/etc/machine-id",
        "/sys/class/dmi/id/product_name",
        "/sys/bus/usb/devices/1-3/idVendor",
        "/sys/bus/usb/devices/1-3/idProduct",
        "/sys/bus/usb/devices/1-3/serial",
    ]
)
file_lines = st.lists(
    st.one_of(
        st.tuples(paths, raw).map(":".join),
        number.map("/proc/loadavg:{}".format),
        st.tuples(st.sampled_from(["MemTotal", "MemAvailable", "SwapTotal", "SwapFree"]), number).map(
            lambda pair: f"/proc/meminfo:{pair[0]}: {pair[1]} kB"
        ),
        st.tuples(number, number).map(lambda pair: f"/sys/devices/system/cpu/online:{pair[0]}-{pair[1]}"),
        number.map("/sys/class/net/eth0/speed:{}".format),
        st.tuples(raw, raw).map("/etc/hosts:{0[0]} {0[1]}".format),
        st.tuples(raw, number, raw).map("/etc/passwd:{0[0]}:x:{0[1]}:0::{0[2]}:/bin/sh".format),
    ),
    max_size=8,
).map("\n".join)
counters = st.lists(
    st.one_of(
        number.map("{} 1.0".format), st.lists(number, max_size=17).map(lambda row: f"  eth0: {' '.join(row)}"), raw
    ),
    max_size=6,
).map("\n".join)
plausible = {
    "identity": st.dictionaries(
        st.sampled_from(["clock", "machine", "uid", "connection", "user"]), raw | number, max_size=5
    ).map(lambda words: "\n".join(f"{key} {value}" for key, value in words.items())),
    "files": file_lines,
    "cpus": number,
    "processor": raw.map("model name\t: {}".format),
    "links": st.lists(link, max_size=4).map(json.dumps),
    "routes": st.lists(route, max_size=4).map(json.dumps),
    "devices": st.lists(raw, max_size=4).map(lambda names: "\n".join(f"dev /dev/{name}" for name in names)),
    "wireless": st.lists(raw, max_size=4).map(
        lambda names: "\n".join(f"wireless {name}\n\ttx bitrate: {name} MBit/s" for name in names)
    ),
    "disk": st.lists(st.tuples(number, number, number), max_size=4).map(
        lambda rows: "\n".join(f"/dev/x {a} {b} {c} 1% /" for a, b, c in rows)
    ),
    "wireguard": st.lists(st.sampled_from(["tools", "kernel", "userspace"]) | raw, max_size=4).map("\n".join),
    "rules": st.lists(st.sampled_from(["nftables", "iptables", "none"]) | raw, max_size=4).map("\n".join),
    "hidden": st.lists(st.lists(link, max_size=3).map(json.dumps) | raw, max_size=3).map("\n".join),
    "traffic": counters,
}
engine = shaped(("Version", "ApiVersion", "Arch", "Driver", "DockerRootDir", "SecurityOptions")) | json_values


def reply_to(probe: str) -> st.SearchStrategy[Reply]:
    out = plausible[probe] | raw | latin | json_values.map(json.dumps)
    return st.builds(Reply, status=st.integers(), out=out, err=raw, ok=st.booleans())


engine_reply = st.builds(
    Reply, status=st.sampled_from([0, 200, 404, 500]), out=engine.map(json.dumps) | raw, err=raw, ok=st.booleans()
)
FITS = Draft202012Validator(data.schema("facts"))
"""Made once: `jsonschema.validate` looks at the schema itself each time."""
all_replies = st.tuples(*(reply_to(probe.name) for probe in PROBES), *(engine_reply for _ in ENGINE))


@pytest.mark.parametrize("probe", [*PROBES, Probe("traffic", "", parse_traffic)], ids=lambda probe: probe.name)
def test_no_parser_raises(probe: object) -> None:
    parse: Callable[[str], object] = probe.parse  # type: ignore[attr-defined]
    name: str = probe.name  # type: ignore[attr-defined]

    @settings(max_examples=examples(60), deadline=None)
    @given(out=plausible[name] | raw | latin | json_values.map(json.dumps))
    def check(out: str) -> None:
        parse(out)

    check()


@settings(max_examples=examples(150), deadline=None)
@given(replies=all_replies, now=st.none() | st.floats(0, 4e9), later=st.none() | reply_to("traffic"))
def test_facts_are_plain_and_bounded(replies: tuple[Reply, ...], now: float | None, later: Reply | None) -> None:
    facts = parse_host(HOST, replies, None, now=now, later=later)
    document = facts_document({"robot1": facts}, {})
    FITS.validate(json.loads(json.dumps(document, allow_nan=False)))
    assert all(text.isprintable() for text in _texts(document["robots"]))
    assert all(math.isfinite(n) for n in (facts.load1, facts.clock_offset_s, facts.speed_mbit, facts.traffic_mbit))
    assert 1 <= facts.cpus <= 4096
    assert 0 <= facts.memory_available <= facts.memory_total
    assert 0 <= facts.swap_free <= facts.swap_total
    assert 0 <= facts.disk_free <= facts.disk_total
    assert len(facts_table({"robot1": facts}, {}).splitlines()) <= 4


@given(count=st.integers(0, 30))
def test_any_number_of_replies_is_read(count: int) -> None:
    assert isinstance(parse_host(HOST, [Reply(status=0, out="{}")] * count, None), HostFacts)
    assert len(host_queries()) == len(PROBES) + len(ENGINE)


def _texts(value: object) -> list[str]:
    if isinstance(value, dict):
        return [text for pair in value.items() for item in pair for text in _texts(item)]
    if isinstance(value, list):
        return [text for item in value for text in _texts(item)]
    return [value] if isinstance(value, str) else []
