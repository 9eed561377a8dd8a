"""Who may write to a file of the user's, by its owner, its group and its mode. Asks the system about groups."""

from __future__ import annotations

import os
import stat


def others_may_write(about: os.stat_result) -> bool:
    """Return whether somebody but the user and root may write to a file, or put others into a folder."""
    if about.st_uid not in (0, os.geteuid()) or about.st_mode & stat.S_IWOTH:
        return True
    return bool(about.st_mode & stat.S_IWGRP) and not is_nobody_elses_group(about.st_gid)


def is_nobody_elses_group(number: int) -> bool:
    """Return whether a group is root's, or the user's own as many systems give one to each user, without others."""
    import grp  # only few files are a group's
    import pwd

    try:
        group, user = grp.getgrgid(number), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    owner = "root" if number == 0 else user.pw_name
    return group.gr_name == owner and set(group.gr_mem) <= {owner}
