"""Which machine a robot is and what is plugged into it: board, serial numbers, USB devices.

Takes files of /sys and /etc; gives words. Pure.
Source: sysfs-class-dmi, sysfs-bus-usb, the devicetree specification, machine-id(5).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from srprov.facts.answers import Files
from srprov.untrusted import LIST_LENGTH, text

_USB = re.compile(r"/sys/bus/usb/devices/([0-9A-Za-z.:-]{1,40})/idVendor")
_ID = re.compile(r"[0-9a-f]{4}")
_MACHINE = re.compile(r"[0-9a-f]{32}")
_ROOT_HUBS = "1d6b"
"""The vendor that the kernel gives to the hubs that are part of the machine."""
_NO_SERIALS = frozenset({"", "0", "none", "default string", "to be filled by o.e.m.", "0123456789"})


def equipment(files: Files, processor: str) -> dict[str, Any]:
    """Return the facts of a machine by their names."""
    usb = sorted(_usb(files))[:LIST_LENGTH]
    board_serial = _word(files, "/sys/firmware/devicetree/base/serial-number")
    serials = [f"{name.partition(' ')[0]} {serial}" for name, serial in usb if _tells(serial)]
    machine = _word(files, "/etc/machine-id")
    return {
        "processor": processor,
        "board": _board(files),
        "machine_id": machine if _MACHINE.fullmatch(machine) else "",
        "usb": tuple(name for name, _ in usb),
        "serials": (*([f"board {board_serial}"] if _tells(board_serial) else []), *serials),
    }


def _board(files: Files) -> str:
    for path in ("/sys/firmware/devicetree/base/model", "/proc/device-tree/model"):
        if model := _word(files, path):
            return model
    vendor, product = (_word(files, f"/sys/class/dmi/id/{name}") for name in ("sys_vendor", "product_name"))
    return text(f"{vendor} {product}")


def _usb(files: Files) -> Iterator[tuple[str, str]]:
    """Return `vendor:product name` and the serial number of each device."""
    for path in files:
        if match := _USB.fullmatch(path):
            place = f"/sys/bus/usb/devices/{match[1]}"
            vendor, product = (_word(files, f"{place}/{name}") for name in ("idVendor", "idProduct"))
            if _ID.fullmatch(vendor) and _ID.fullmatch(product) and vendor != _ROOT_HUBS:
                name = text(f"{vendor}:{product} {_word(files, f'{place}/product')}")
                yield name, _word(files, f"{place}/serial")


def _tells(serial: str) -> bool:
    return serial.lower() not in _NO_SERIALS


def _word(files: Files, path: str) -> str:
    return text(files.get(path, ("",))[0])
