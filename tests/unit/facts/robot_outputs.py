"""What real robots answer, as the probes ask: an x86 computer, a Raspberry Pi on Wi-Fi, a minimal busybox system."""

import json

from srprov.facts.host import host_queries
from srprov.facts.probes import ENGINE, PROBES
from srprov.wire import Reply

MEMINFO = """\
/proc/meminfo:MemTotal:       24684096 kB
/proc/meminfo:MemFree:        24337516 kB
/proc/meminfo:MemAvailable:   24307996 kB
/proc/meminfo:Buffers:            8880 kB
/proc/meminfo:Cached:            94972 kB
/proc/meminfo:SwapCached:            0 kB
/proc/meminfo:SwapTotal:             0 kB
/proc/meminfo:SwapFree:              0 kB
"""

ETH0 = {
    "ifindex": 4,
    "ifname": "eth0",
    "flags": ["BROADCAST", "MULTICAST", "UP", "LOWER_UP"],
    "mtu": 1400,
    "operstate": "UP",
    "link_type": "ether",
    "address": "02:fc:00:00:00:01",
    "addr_info": [
        {"family": "inet", "local": "192.0.2.2", "prefixlen": 24, "scope": "global", "label": "eth0"},
        {"family": "inet6", "local": "fd00::2", "prefixlen": 64, "scope": "global", "nodad": True},
        {"family": "inet6", "local": "fe80::fc:ff:fe00:1", "prefixlen": 64, "scope": "link"},
    ],
}
LO = {
    "ifindex": 1,
    "ifname": "lo",
    "flags": ["LOOPBACK", "UP", "LOWER_UP"],
    "mtu": 65536,
    "link_type": "loopback",
    "address": "00:00:00:00:00:00",
    "addr_info": [
        {"family": "inet", "local": "127.0.0.1", "prefixlen": 8, "scope": "host"},
        {"family": "inet6", "local": "::1", "prefixlen": 128, "scope": "host"},
    ],
}
DOCKER0 = {
    "ifname": "docker0",
    "flags": ["NO-CARRIER", "BROADCAST", "MULTICAST", "UP"],
    "mtu": 1500,
    "address": "02:42:5c:6c:9a:3f",
    "linkinfo": {"info_kind": "bridge", "info_data": {"forward_delay": 1500}},
    "addr_info": [{"family": "inet", "local": "172.17.0.1", "prefixlen": 16, "scope": "global"}],
}
VXLAN = {
    "ifname": "srpv7",
    "flags": ["BROADCAST", "MULTICAST", "UP", "LOWER_UP"],
    "mtu": 1350,
    "address": "9a:eb:bc:c5:b1:cd",
    "linkinfo": {"info_kind": "vxlan", "info_data": {"id": 77, "local": "192.0.2.2", "port": 4789, "learning": False}},
    "ifalias": "srprov:hello",
    "addr_info": [{"family": "inet", "local": "10.77.0.1", "prefixlen": 24, "scope": "global"}],
}
WLAN0 = {
    "ifname": "wlan0",
    "flags": ["BROADCAST", "MULTICAST", "UP", "LOWER_UP"],
    "mtu": 1500,
    "address": "d8:3a:dd:00:00:02",
    "addr_info": [{"family": "inet", "local": "10.0.0.5", "prefixlen": 24, "scope": "global", "dynamic": True}],
}
ROUTES = [
    {"dst": "default", "gateway": "192.0.2.1", "dev": "eth0", "flags": []},
    {"dst": "192.0.2.0/24", "dev": "eth0", "protocol": "kernel", "scope": "link", "prefsrc": "192.0.2.2", "flags": []},
    {"dst": "172.17.0.0/16", "dev": "docker0", "protocol": "kernel", "scope": "link", "flags": ["linkdown"]},
]

PING = {"api-version": "1.41", "server": "Docker/20.10.24+dfsg1 (linux)", "ostype": "linux"}
INFO = {
    "ServerVersion": "20.10.24+dfsg1",
    "Driver": "overlay2",
    "DockerRootDir": "/var/lib/docker",
    "SecurityOptions": ["name=apparmor", "name=seccomp,profile=default"],
    "Architecture": "x86_64",
}

NET_DEV = """\
Inter-|   Receive                                      |  Transmit
 face |bytes packets errs drop fifo frame compressed multicast|bytes packets errs drop fifo colls carrier compressed
    lo:    3193      29    0    0    0     0          0         0     3193      29    0    0    0     0       0       0
  eth0: {received}    8577    0    0    0     0       0         0   {sent}    6776    0    0    0     0       0       0
"""
_BEFORE = "1070.46 1976.31", NET_DEV.format(received=279775767, sent=576529)
LATER = Reply(status=0, out="1070.76 1976.90\n" + NET_DEV.format(received=279775767 + 375_000, sent=576529 + 750_000))
"""0.3 s after COMPUTER's own counters."""

COMPUTER = {
    "identity": """\
clock 1795223387.500000000
machine x86_64
bits 64
id uid=0(root) gid=0(root) groups=0(root)
connection 192.0.2.1 5 192.0.2.2 22
""",
    "files": "/proc/loadavg:0.17 0.12 0.09 2/95 13306\n"
    + MEMINFO
    + """\
/proc/sys/kernel/hostname:vm
/proc/sys/kernel/osrelease:6.1.0-37-amd64
/proc/sys/kernel/version:#1 SMP PREEMPT_DYNAMIC Debian 6.1.140-1
/sys/devices/system/cpu/online:0-1
/sys/class/dmi/id/sys_vendor:Intel(R) Client Systems
/sys/class/dmi/id/product_name:NUC11TNHi5
/etc/machine-id:0f1e2d3c4b5a69788796a5b4c3d2e1f0
/sys/bus/usb/devices/usb1/idVendor:1d6b
/sys/bus/usb/devices/usb1/idProduct:0002
/sys/bus/usb/devices/usb1/serial:0000:00:14.0
/sys/bus/usb/devices/1-3/idVendor:046d
/sys/bus/usb/devices/1-3/idProduct:0825
/sys/bus/usb/devices/1-3/product:Webcam C270
/sys/bus/usb/devices/1-3/serial:B1DA5A20
/sys/bus/usb/devices/1-2/idVendor:10c4
/sys/bus/usb/devices/1-2/idProduct:ea60
/sys/bus/usb/devices/1-2/serial:0
/etc/os-release:PRETTY_NAME="Debian GNU/Linux 12 (bookworm)"
/etc/os-release:NAME="Debian GNU/Linux"
/usr/lib/os-release:PRETTY_NAME="not this one"
/sys/class/net/eth0/speed:1000
/etc/passwd:root:x:0:0:root:/root:/bin/bash
/etc/passwd:daemon:x:1:1:daemon:/usr/sbin:/usr/sbin/nologin
/etc/passwd:robot:x:1000:1000:Robot,,,:/home/robot:/bin/bash
"""
    + f"/proc/uptime:{_BEFORE[0]}\n"
    + "".join(f"/proc/net/dev:{line}\n" for line in _BEFORE[1].splitlines()),
    "cpus": "2\n",
    "processor": "model name\t: 11th Gen Intel(R) Core(TM) i5-1135G7 @ 2.40GHz\n",
    "links": json.dumps([LO, ETH0, DOCKER0, VXLAN]),
    "routes": json.dumps(ROUTES),
    "devices": "dev /dev/kvm\ndev /dev/net/tun\ndev /dev/video0\nalias /dev/stderr\nalias /dev/rplidar\n",
    "wireless": "",
    "disk": """\
Filesystem     1024-blocks     Used Available Capacity Mounted on
/dev/vda1        264212084 24175904  82215008      23% /
/dev/vdb1          1000000   400000    500000      45% /var/lib/docker
/dev/vda1        264212084 24175904  82215008      23% /
/dev/vda1        264212084 24175904  82215008      23% /
""",
    "wireguard": "tools\nuserspace\n",
    "rules": "nftables\niptables\nnone\n",
}

PI = {
    "identity": """\
clock 1795223388.25
machine aarch64
bits 64
id uid=0(root) gid=0(root)
connection 10.0.0.1 50022 10.0.0.5 22
user pi
""",
    "files": """\
/proc/loadavg:1.52 0.90 0.40 3/201 2345
/proc/meminfo:MemTotal:        3884408 kB
/proc/meminfo:MemFree:         2337516 kB
/proc/meminfo:MemAvailable:    2942204 kB
/proc/meminfo:SwapTotal:        102396 kB
/proc/meminfo:SwapFree:          51198 kB
/proc/sys/kernel/hostname:turtle7
/proc/sys/kernel/osrelease:6.6.31-v8+
/proc/sys/kernel/version:#1 SMP PREEMPT_RT Debian 1:6.6.31-1+rpt1 (2024-05-29)
/etc/os-release:PRETTY_NAME="Debian GNU/Linux 12 (bookworm)"
/proc/device-tree/model:Raspberry Pi 4 Model B Rev 1.4\0
/sys/firmware/devicetree/base/serial-number:10000000a1b2c3d4\0
/etc/machine-id:not one
/sys/class/video4linux/video0/name:UVC Camera (046d:0825)
/sys/class/video4linux/video10/name:bcm2835-codec-decode
/sys/class/video4linux/video13/name:bcm2835-isp-output0
/etc/hosts:127.0.0.1 localhost
/etc/hosts:# a comment
/etc/hosts:127.0.1.1\tturtle7
/etc/hosts:10.0.0.9   camera.lab camera  # on the mast
/etc/hosts:fd00::9 camera6 \\bad name;
/etc/hosts:fe80::1%wlan0 zone
/etc/hosts:cafe of no address
/etc/passwd:root:x:0:0:root:/root:/bin/bash
/etc/passwd:bin:x:2:2:bin:/bin:/usr/sbin/nologin
/etc/passwd:pi:x:1000:1000:,,,:/home/pi:/bin/bash
/etc/passwd:pi:x:1001:1001:,,,:/home/second:/bin/bash
/etc/passwd:nobody:x:65534:65534:nobody:/nonexistent:/usr/sbin/nologin
/etc/passwd:odd:x:1002:1002::home/odd:/bin/sh
/etc/passwd:up:x:1003:1003::/home/../etc:/bin/sh
/etc/passwd:Upper:x:1004:1004::/home/Upper:/bin/sh
/etc/passwd:cut:x:1005
/etc/passwd:none:x::1006::/home/none:/bin/sh
""",
    "cpus": "4\n",
    "processor": "",
    "links": json.dumps([LO, {**ETH0, "addr_info": [], "flags": ["BROADCAST"]}, WLAN0]),
    "routes": json.dumps([{"dst": "default", "gateway": "10.0.0.1", "dev": "wlan0", "metric": 600}]),
    "devices": """\
dev /dev/video0
dev /dev/video10
dev /dev/ttyUSB0
dev /dev/ttyAMA0
dev /dev/i2c-1
dev /dev/spidev0.0
dev /dev/gpiochip0
dev /dev/input/js0
dev /dev/dri/card0
dev /dev/dri/renderD128
dev /dev/snd/pcmC0D0p
dev /dev/serial/by-id/usb-Silicon_Labs_CP2102_0001-if00-port0
""",
    "wireless": "wireless wlan0\nConnected to 3c:28:6d:00:00:01 (on wlan0)\n\tSSID: lab\n\ttx bitrate: 72.2 MBit/s\n",
    "disk": """\
Filesystem     1024-blocks    Used Available Capacity Mounted on
/dev/root         30358728 5120644  23966784      18% /
/dev/root         30358728 5120644  23966784      18% /
""",
    "wireguard": "tools\nkernel\nuserspace\n",
    "rules": "iptables\nnone\n",
}

BUSYBOX = {
    **COMPUTER,
    "identity": "clock 1795223387.%N\nmachine armv7l\nbits \nid uid=1000(robot) gid=1000(robot)\nconnection \n",
    "disk": """\
Filesystem           1024-blocks    Used Available Capacity Mounted on
/dev/mmcblk0p2       264212084 24175900  82215012  23% /
""",
    "devices": "",
    "wireguard": "",
    "rules": "none\n",
    "spelled": "",
}


def replies(robot: dict[str, str], ping: object = PING, info: object = INFO) -> list[Reply]:
    """Return the replies in the order of `host_queries`; with `ping` None there is no engine."""
    shell = [Reply(status=0, out=robot.get(probe.name, "")) for probe in PROBES]
    if ping is None:
        engine = [Reply(status=0, err="no Docker Engine listens on /var/run/docker.sock", ok=False)] * len(ENGINE)
    else:
        engine = [Reply(status=200, out=json.dumps(value)) for value in (ping, info)]
    found = [*shell, *engine]
    assert len(found) == len(host_queries())
    return found
