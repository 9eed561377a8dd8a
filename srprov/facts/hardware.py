"""Hardware tags: one word for each kind of equipment that a service may require.

Takes device paths, interfaces and a few files of /proc and /sys; gives words. Pure. `TAGS` is the whole list
(docs/facts.md says the same); `srprov_tags` of the inventory come on top.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from srprov.facts.answers import Devices, Files
from srprov.facts.model import Link

TAGS: Mapping[str, str] = {
    "audio": "a PCM device in /dev/snd",
    "camera": "/dev/video*, other than a video codec or image processor",
    "can": "a CAN interface (hardware, not vcan)",
    "gpio": "/dev/gpiochip*",
    "gpu": "/dev/nvidia0…, /dev/nvhost-gpu or /dev/dri/renderD*",
    "i2c": "/dev/i2c-*",
    "jetson": "the board's model says Jetson",
    "joystick": "/dev/input/js*",
    "nvidia": "/dev/nvidia0… or /dev/nvhost-gpu",
    "raspberrypi": "the board's model says Raspberry Pi",
    "rt": "a PREEMPT_RT kernel",
    "serial": "/dev/ttyUSB*, /dev/ttyACM* or /dev/serial/by-id/*",
    "spi": "/dev/spidev*",
    "wifi": "a wireless interface",
}
"""Tag -> what it is detected by. The machine's architecture, by Docker's name, is a tag too."""

# Boards show their codecs and image processors as /dev/video10 and up, with no camera attached.
_NO_CAMERA = re.compile(r"codec|-isp|hevc|pispbe|rpivid|decoder|encoder|vpu|hantro|rkvdec|rga", re.IGNORECASE)
_BY_PATH = {
    "audio": r"/dev/snd/pcm.+",
    "gpio": r"/dev/gpiochip[0-9]+",
    "gpu": r"/dev/(nvidia[0-9]+|nvhost-gpu|dri/renderD[0-9]+)",
    "i2c": r"/dev/i2c-[0-9]+",
    "joystick": r"/dev/input/js[0-9]+",
    "nvidia": r"/dev/(nvidia[0-9]+|nvhost-gpu)",
    "serial": r"/dev/(ttyUSB[0-9]+|ttyACM[0-9]+|serial/by-id/.+)",
    "spi": r"/dev/spidev.+",
}


def detect_tags(
    devices: Devices, files: Files, links: Sequence[Link], wireless: Sequence[str], arch: str
) -> tuple[str, ...]:
    """Return the detected tags, sorted; `wireless` names the wireless interfaces, `arch` is Docker's name or empty."""
    found = {tag for tag, path in _BY_PATH.items() if any(re.fullmatch(path, device) for device in devices.known)}
    board = _board(files)
    checks = {
        "camera": any(_is_camera(path, files) for path in devices.known),
        "can": any(link.kind == "can" for link in links),
        "jetson": "jetson" in board,
        "raspberrypi": "raspberry pi" in board,
        "rt": _is_realtime(files),
        "wifi": bool(wireless),
        arch: bool(arch),
    }
    return tuple(sorted(found | {tag for tag, holds in checks.items() if holds}))


def _board(files: Files) -> str:
    paths = ("/sys/firmware/devicetree/base/model", "/proc/device-tree/model")
    return " ".join(line for path in paths for line in files.get(path, ())[:1]).lower()


def _is_camera(path: str, files: Files) -> bool:
    if not re.fullmatch(r"/dev/video[0-9]+", path):
        return False
    name = files.get(f"/sys/class/video4linux/{path.removeprefix('/dev/')}/name", ("",))[0]
    return not _NO_CAMERA.search(name)


def _is_realtime(files: Files) -> bool:
    version = files.get("/proc/sys/kernel/version", ("",))[0]
    return files.get("/sys/kernel/realtime", ("",))[0].strip() == "1" or bool(re.search(r"PREEMPT[_ ]RT\b", version))
