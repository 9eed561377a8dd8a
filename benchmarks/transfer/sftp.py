"""Fetch a file, or the files of a folder, with paramiko's SFTP: KEY ADDRESS PATH HOME."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import paramiko


def main() -> None:
    """Do it as its documentation has it."""
    key, address, path, home = sys.argv[1:]
    client = paramiko.SSHClient()
    client.set_missing_host_key_policy(paramiko.AutoAddPolicy())
    client.connect(address, username="root", key_filename=key)
    sftp = client.open_sftp()
    if stat.S_ISDIR(sftp.stat(path).st_mode or 0):
        for name in sftp.listdir(path):
            sftp.get(f"{path}/{name}", str(Path(home, name)))
    else:
        sftp.get(path, str(Path(home, Path(path).name)))
    client.close()


if __name__ == "__main__":
    main()
