"""What robots and containers used: both versions of cgroups and odd machines, by tables of what their files say."""

from __future__ import annotations

import pytest

from srprov.trials.cgroup import Used, added, counters, group, highest, mounts, row
from srprov.trials.files import by_file
from srprov.trials.hosts import difference, read
from tests.bounded import bounded

V1_MOUNTS = """\
32 31 0:29 / /sys/fs/cgroup/cpu,cpuacct rw,nosuid shared:9 - cgroup cgroup rw,cpu,cpuacct
36 31 0:32 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory
37 31 0:34 / /sys/fs/cgroup/blk\\040io rw - cgroup cgroup rw,blkio
40 31 0:37 / /sys/fs/cgroup/systemd rw - cgroup cgroup rw,xattr,name=systemd
41 31 0:38 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw,nsdelegate
"""
V1_GROUPS = """\
7:blkio:/docker/c0ffee
4:memory:/docker/c0ffee
2:cpu,cpuacct:/docker/c0ffee
1:name=systemd:/docker/c0ffee
0::/
"""
V1_FILES = """\
/sys/fs/cgroup/cpu,cpuacct/docker/c0ffee/cpuacct.usage:1482446789
/sys/fs/cgroup/cpu,cpuacct/docker/c0ffee/cpu.stat:nr_periods 40
/sys/fs/cgroup/cpu,cpuacct/docker/c0ffee/cpu.stat:nr_throttled 4
/sys/fs/cgroup/cpu,cpuacct/docker/c0ffee/cpu.stat:throttled_time 250000000
/sys/fs/cgroup/memory/docker/c0ffee/memory.max_usage_in_bytes:23437312
/sys/fs/cgroup/memory/docker/c0ffee/memory.stat:rss 4096
/sys/fs/cgroup/memory/docker/c0ffee/memory.stat:total_rss 1290240
/sys/fs/cgroup/memory/docker/c0ffee/memory.oom_control:oom_kill_disable 0
/sys/fs/cgroup/memory/docker/c0ffee/memory.oom_control:oom_kill 2
/sys/fs/cgroup/blk io/docker/c0ffee/blkio.throttle.io_service_bytes:8:0 Read 4096
/sys/fs/cgroup/blk io/docker/c0ffee/blkio.throttle.io_service_bytes:8:0 Write 8192
/sys/fs/cgroup/blk io/docker/c0ffee/blkio.throttle.io_service_bytes:8:16 Write 1000
/sys/fs/cgroup/blk io/docker/c0ffee/blkio.throttle.io_service_bytes:Total 13288
"""
V2_MOUNTS = "25 30 0:23 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate,memory_recursiveprot\n"
V2_GROUPS = "0::/system.slice/docker-c0ffee.scope\n"
V2 = "/sys/fs/cgroup/system.slice/docker-c0ffee.scope"
V2_FILES = f"""\
{V2}/cpu.stat:usage_usec 1482446
{V2}/cpu.stat:user_usec 1400000
{V2}/cpu.stat:nr_throttled 4
{V2}/cpu.stat:throttled_usec 250000
{V2}/memory.peak:23437312
{V2}/memory.stat:anon 1290240
{V2}/memory.stat:anon_thp 0
{V2}/memory.events:oom 2
{V2}/memory.events:oom_kill 2
{V2}/io.stat:8:0 rbytes=4096 wbytes=8192 rios=1 wios=2 dbytes=0 dios=0
{V2}/io.stat:8:16 rbytes=0 wbytes=1000 rios=0 wios=1 dbytes=0 dios=0
"""
NETWORK = """\
/proc/7/net/dev:Inter-|   Receive                                                |  Transmit
/proc/7/net/dev: face |bytes    packets errs drop fifo frame compressed multicast|bytes    packets errs
/proc/7/net/dev:    lo:     900       9    0    0    0     0          0         0      900       9    0    0    0 0 0 0
/proc/7/net/dev:  eth0:    3000       7    0    0    0     0          0         0     1300       5    0    0    0 0 0 0
/proc/7/net/dev:eth1:10 1 0 0 0 0 0 0 20 1 0 0 0 0 0 0
"""
ALL = {
    "cpu_s": pytest.approx(1.482446, abs=1e-6), "throttled_s": 0.25, "memory_peak_bytes": 23437312,
    "memory_anon_bytes": 1290240, "oom_kills": 2, "disk_read_bytes": 4096, "disk_written_bytes": 9192,
    "net_received_bytes": 3010, "net_sent_bytes": 1320,
}  # fmt: skip
NOTHING = dict.fromkeys(ALL)


@pytest.mark.parametrize(
    ("there", "groups", "said", "missing"),
    [
        pytest.param(V1_MOUNTS, V1_GROUPS, V1_FILES, (), id="v1"),
        pytest.param(V2_MOUNTS, V2_GROUPS, V2_FILES, (), id="v2"),
        pytest.param(
            V2_MOUNTS, V2_GROUPS, V2_FILES.replace("memory.peak", "x"), ("memory_peak_bytes",), id="v2 before 5.19"
        ),
        pytest.param(
            V1_MOUNTS, V1_GROUPS, V1_FILES.replace(":8:", ":x "), ("disk_read_bytes", "disk_written_bytes"),
            id="v1 that counts only where a limit is",
        ),
        pytest.param(
            V2_MOUNTS.replace("0:23 /", "0:23 /system.slice"), V2_GROUPS,
            V2_FILES.replace("/system.slice", ""), (), id="v2 of which a part is seen",
        ),
        pytest.param(
            V1_MOUNTS, V1_GROUPS.replace("4:memory:/docker/c0ffee\n", ""), V1_FILES,
            ("memory_peak_bytes", "memory_anon_bytes", "oom_kills"), id="v1 with memory off, as on a Raspberry Pi",
        ),
        pytest.param(
            V1_MOUNTS.replace("cgroup rw,memory", "cgroup rw,hugetlb"),
            V1_GROUPS.replace("4:memory:/docker/c0ffee\n", "").replace("0::/", "0::/docker/c0ffee"),
            V1_FILES[: V1_FILES.index("/sys/fs/cgroup/memory")] + V1_FILES[V1_FILES.index("/sys/fs/cgroup/blk io") :]
            + V2_FILES[V2_FILES.index(f"{V2}/memory.peak") : V2_FILES.index(f"{V2}/io")].replace(
                V2, "/sys/fs/cgroup/unified/docker/c0ffee"),
            (), id="v1 with memory of v2",
        ),
    ],
)  # fmt: skip
def test_the_counters_of_a_container_are_read(there: str, groups: str, said: str, missing: tuple[str, ...]) -> None:
    one = group(7, groups.splitlines(), mounts(there.splitlines()))
    found = counters(one, by_file(said + NETWORK), own_network=True)
    assert found == {**ALL, **dict.fromkeys(missing)}


@pytest.mark.parametrize(
    ("there", "groups"),
    [
        ("", V1_GROUPS),
        (V1_MOUNTS, ""),
        (V1_MOUNTS, "junk\n::\n1:memory\n"),
        ("25 30 0:23\nx - y\n - cgroup2\n", V2_GROUPS),
        (V2_MOUNTS, "0::/../../other\n"),  # of another namespace
        (V2_MOUNTS, "0::/\n"),  # the root's counters would be the machine's
        (V2_MOUNTS.replace("0:23 /", "0:23 /elsewhere"), V2_GROUPS),
        (V2_MOUNTS, "0::/with:colon\n"),
        (V2_MOUNTS, "0::/" + "x" * 2000 + "\n"),
        (V2_MOUNTS, "0::/bell\x07\n"),
    ],
)
def test_what_cannot_be_seen_is_not_asked_for(there: str, groups: str) -> None:
    one = group(7, groups.splitlines(), mounts(there.splitlines()))
    assert one.files == ("/proc/7/net/dev",)
    assert counters(one, by_file(NETWORK), own_network=False) == NOTHING


@pytest.mark.parametrize("said", ["", "\0", "no path: 1", V2_FILES.replace(" ", ""), f"{V2}/cpu.stat:usage_usec -5"])
def test_answers_that_say_nothing_give_nothing(said: str) -> None:
    one = group(7, V2_GROUPS.splitlines(), mounts(V2_MOUNTS.splitlines()))
    found = counters(one, by_file(said), own_network=True)
    assert {key for key, value in found.items() if value is not None} <= {"memory_peak_bytes"}


def test_a_container_that_is_started_again_goes_on_where_it_was() -> None:
    first = {**NOTHING, "cpu_s": 2.0, "memory_peak_bytes": 50, "net_sent_bytes": 10}
    again = {**NOTHING, "cpu_s": 0.5, "memory_peak_bytes": 20, "oom_kills": 1}
    assert added(first, again) == {
        **NOTHING, "cpu_s": 2.5, "memory_peak_bytes": 50, "oom_kills": 1, "net_sent_bytes": 10,
    }  # fmt: skip
    assert highest({"memory_anon_bytes": 9, "cpu_s": 1.0}, {"memory_anon_bytes": 3, "cpu_s": 2.0}) == {
        "memory_anon_bytes": 9, "memory_peak_bytes": None, "cpu_s": 2.0,
    }  # fmt: skip


def test_how_long_nobody_looked_is_by_the_controllers_clock() -> None:
    used = Used(counters={"cpu_s": 1.5}, moment=1000.25, finished=1002.0)
    assert row(used, 1.5) == {**NOTHING, "cpu_s": 1.5, "unread_s": 0.25}
    assert row(used, None)["unread_s"] is None
    assert row(Used(), 1.5)["unread_s"] is None


HOST = """\
/proc/stat:cpu  1000 10 200 90000 50 3 4 20 7 0
/proc/stat:cpu0 500 5 100 45000 25 1 2 10 3 0
/proc/stat:cpu1 500 5 100 45000 25 2 2 10 4 0
/proc/meminfo:MemAvailable:    2000 kB
/disks:/sys/block/sda/device
/disks:/sys/block/mmcblk0/device
/proc/uptime:500.25 900.00
/proc/net/dev:  wlan0: 1000 1 0 0 0 0 0 0 500 1 0 0 0 0 0 0
/proc/net/dev:srpv0a1b: 600 1 0 0 0 0 0 0 300 1 0 0 0 0 0 0
/proc/diskstats:   8       0 sda 10 0 100 0 20 0 200 0 0 0 0
/proc/diskstats:   8       1 sda1 10 0 100 0 20 0 200 0 0 0 0
/proc/diskstats: 179       0 mmcblk0 1 0 8 0 1 0 16 0 0 0 0
/proc/diskstats: 253       0 dm-0 10 0 100 0 20 0 200 0 0 0 0
/sys/class/thermal/thermal_zone0/temp:47250
/sys/class/thermal/thermal_zone1/temp:51000
/sys/class/thermal/thermal_zone2/temp:-273000
/sys/class/power_supply/BAT0/type:Battery
/sys/class/power_supply/BAT0/capacity:81
/sys/class/power_supply/mouse/type:Battery
/sys/class/power_supply/mouse/scope:Device
/sys/class/power_supply/mouse/capacity:5
/sys/class/power_supply/AC/type:Mains
/sys/devices/platform/soc/soc:firmware/get_throttled:50000
"""
LATER = (
    HOST.replace("cpu  1000 10 200 90000 50 3 4 20", "cpu  1150 10 250 90100 99 3 4 30")
    .replace("500.25", "503.75")
    .replace("600 1 0 0 0 0 0 0 300", "1600 1 0 0 0 0 0 0 700")
    .replace("sda 10 0 100 0 20 0 200", "sda 10 0 102 0 20 0 208")
    .replace(":51000", ":63500")
    .replace("capacity:81", "capacity:79")
    .replace("2000 kB", "1500 kB")
)
USED = {
    "measured_s": 3.5, "cpus": 2, "cpu_s": 2.0, "cpu_steal_s": pytest.approx(0.1),
    "memory_available_start_bytes": 2048000, "memory_available_end_bytes": 1536000,
    "disk_read_bytes": 1024, "disk_written_bytes": 4096, "net_received_bytes": 0, "net_sent_bytes": 0,
    "overlay_received_bytes": 1000, "overlay_sent_bytes": 400, "temperature_start_c": 51.0, "temperature_end_c": 63.5,
    "battery_start_percent": 81, "battery_end_percent": 79, "throttled": False,
}  # fmt: skip


def test_a_robots_totals_are_what_its_counters_grew_by() -> None:
    assert difference(read(HOST), read(LATER), "wlan0", ["srpv0a1b"]) == USED
    without = difference(read(HOST), read(LATER), "", [])
    gone = ("net_received_bytes", "net_sent_bytes", "overlay_received_bytes", "overlay_sent_bytes")
    assert without == {**USED, **dict.fromkeys(gone)}


@pytest.mark.parametrize(
    ("before", "after", "slowed"),
    [
        ("get_throttled:0", "get_throttled:50000", True),  # it was too hot and too weak meanwhile
        ("get_throttled:50000", "get_throttled:50005", True),  # it is now
        ("get_throttled:50000", "get_throttled:50000", False),  # it was once, before
        ("get_throttled:zz", "get_throttled:50000", None),
    ],
)
def test_a_raspberry_pi_says_whether_it_was_slowed_down(before: str, after: str, slowed: bool | None) -> None:
    one, other = (text.replace("get_throttled:50000", bits) for text, bits in ((HOST, before), (LATER, after)))
    assert difference(read(one), read(other), "", [])["throttled"] is slowed


@pytest.mark.parametrize(("count", "slowed"), [(3, False), (4, True)])
def test_intels_counters_say_it_too(count: int, slowed: bool) -> None:
    path = "/sys/devices/system/cpu/cpu1/thermal_throttle/core_throttle_count"
    one, other = (
        read(text.split("/sys/devices/platform")[0] + f"{path}:{said}\n") for text, said in ((HOST, 3), (LATER, count))
    )
    assert difference(one, other, "", [])["throttled"] is slowed


def test_of_a_robot_that_was_restarted_or_not_read_again_only_the_moments_are_known() -> None:
    start = {key: value for key, value in USED.items() if "_start_" in key}
    assert difference(read(HOST), None, "wlan0", []) == {**start, "cpus": 2}
    restarted = difference(read(LATER), read(HOST), "wlan0", [])
    assert "cpu_s" not in restarted and restarted["temperature_end_c"] == 51.0


@pytest.mark.parametrize(
    "said", ["", "\n", "/proc/stat:cpu x y\n/proc/uptime:soon\n/disks:/sys/block/*/device\n", "\0" * 99]
)
def test_a_robot_that_says_nothing_has_no_zeros(said: str) -> None:
    found = difference(read(said), read(said), "wlan0", ["srpv0a1b"])
    assert {value for value in found.values()} == {None}


@pytest.mark.parametrize(
    "piece",
    [
        "/proc/stat:cpu 1 2 3 4 5 6 7 8\n",
        "/proc/stat:cpu" + " 9" * 1000 + "\n",
        "/proc/self/mountinfo:1 1 0:1 / /x\\040 rw - cgroup cgroup " + "a," * 1000 + "\n",
        "/sys/class/power_supply/B{}/capacity:50\n/sys/class/thermal/thermal_zone{}/temp:1\n",
        "/proc/net/dev: eth{}: 1 2 3 4 5 6 7 8 9 10\n/disks:/sys/block/d{}/device\n",
        "/chrony:" + "1," * 500 + "\n",
        "a" * 100,
    ],
)
def test_an_answer_without_end_is_read_in_time(piece: str) -> None:
    flood = "".join(piece.replace("{}", str(number)) for number in range((8 << 20) // len(piece)))

    def work() -> int:
        reading = read(flood)
        there = mounts(by_file(flood).get("/proc/self/mountinfo", ()))
        one = group(7, by_file(flood).get("/proc/7/cgroup", ()), there)
        return len(counters(one, by_file(flood), own_network=True)) + len(difference(reading, reading, "eth0", []))

    assert bounded(work) > 0
