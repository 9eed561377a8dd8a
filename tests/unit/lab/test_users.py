"""A robot's own users: passwords of several robots that are made at once."""

from __future__ import annotations

import ctypes
import ctypes.util
from concurrent.futures import ThreadPoolExecutor

from srprov.lab import users


def test_passwords_of_robots_that_boot_at_once_are_right() -> None:
    """crypt(3) has one place for all results, which threads wrote to at the same time."""
    with ThreadPoolExecutor(4) as robots:
        hashes = list(robots.map(users.hash_of, ["kuka-4711"] * 24))
    crypt = ctypes.PyDLL(str(ctypes.util.find_library("crypt"))).crypt
    crypt.restype = ctypes.c_char_p
    assert [crypt(b"kuka-4711", one.encode()).decode() for one in hashes] == hashes
