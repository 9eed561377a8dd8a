"""Who may write to a file of the user's, by its owner, its group, its mode and its access list. Asks the system."""

from __future__ import annotations

import functools
import os
import stat
import struct

_ACCESS_LIST = "system.posix_acl_access"
_WRITE = 2
_USER, _OWN_GROUP, _GROUP, _MASK = 0x02, 0x04, 0x08, 0x10
"""Kinds of entries of an access list; source: acl(5), linux/posix_acl_xattr.h."""


def others_may_write(path: str | os.PathLike[str], about: os.stat_result) -> bool:
    """Return whether somebody but the user and root may write to a file, or put others into a folder."""
    if about.st_uid not in (0, os.geteuid()) or about.st_mode & stat.S_IWOTH:
        return True
    if not about.st_mode & stat.S_IWGRP:
        return False  # where there is an access list, this bit stands for all of its entries
    users, groups = _listed(path, about.st_gid)
    return bool(users - {0, os.geteuid()}) or not all(map(is_nobody_elses_group, groups))


def _listed(path: str | os.PathLike[str], group: int) -> tuple[set[int], set[int]]:
    """Return the users and groups that the access list of a file lets write to it; without one the file's group."""
    try:
        entries = [*struct.iter_unpack("<HHI", os.getxattr(path, _ACCESS_LIST)[4:])]
    except (OSError, struct.error):
        return set(), {group}
    most = next((rights for kind, rights, _ in entries if kind == _MASK), _WRITE)
    writing = [(kind, number) for kind, rights, number in entries if rights & most & _WRITE]
    users = {number for kind, number in writing if kind == _USER}
    own = {group for kind, _ in writing if kind == _OWN_GROUP}
    return users, own | {number for kind, number in writing if kind == _GROUP}


@functools.lru_cache(maxsize=64)
def is_nobody_elses_group(number: int) -> bool:
    """Return whether a group is root's, or the user's own as many systems give one to each user, without others."""
    import grp  # only few files are a group's
    import pwd

    try:
        group, user = grp.getgrgid(number), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    owner = "root" if number == 0 else user.pw_name
    # who has it as his first group is not among its members
    others = {one.pw_name for one in pwd.getpwall() if one.pw_gid == number and one.pw_uid not in (0, os.geteuid())}
    return group.gr_name == owner and not others and set(group.gr_mem) <= {owner}
