"""A new experiment: the files that `srprov init` writes. Pure; tests validate them and apply them."""

from __future__ import annotations

import re
from collections.abc import Mapping

from srprov.regular_file import WHOLE

EXPERIMENT = """\
# An experiment: the services that run on your robots. `srprov schema edf` explains every field.
edf: 1
name: {name}
description: A talker says a word every second, and a listener on another robot hears it.

services:
  talker:
    cdf: talker.cdf # what its container is made of; see there
    environment:
      WORD: hello # change it, and `srprov plan` shows what follows from that

  listener:
    image: busybox # an image as it is
    depends_on:
      talker: {{ condition: healthy }}
    # services find each other by name, whichever robots they are on
    command:
      - sh
      - -c
      - |
        trap 'exit 0' TERM INT
        while :; do
          echo "heard: $(timeout 2 wget -q -O - http://talker:8080/word.txt)"
          sleep 1 & wait $!
        done

# What `srprov collect` brings home.
results:
  talker: [/out/word.txt]
"""
TALKER = """\
# What the talker's container is made of. srprov builds it on one robot and copies it to those that need it.
cdf: 1
name: talker
description: Serves a word that changes every second.
base: busybox
files:
  - { src: talker.sh, dest: /talker.sh }
environment:
  WORD: nothing # the experiment says otherwise
command: [sh, /talker.sh]
healthcheck:
  test: [CMD, busybox, wget, -q, -O, /dev/null, "http://127.0.0.1:8080/word.txt"]
  interval: 1s
  timeout: 2s
  retries: 10
"""
SCRIPT = """\
#!/bin/sh
trap 'exit 0' TERM INT
mkdir -p /out
busybox httpd -f -p 8080 -h /out &
n=0
while :; do
    n=$((n + 1))
    echo "$WORD #$n" >/out/word.txt
    echo "said: $WORD #$n"
    sleep 1 & wait $!
done
"""
INVENTORY = f"""\
# Your robots, as in Ansible's inventories. These addresses belong to nobody: put yours in their place.
# `srprov doctor -i inventory.yml` says what each robot lacks.
{WHOLE}
all:
  hosts:
    robot1:
      ansible_host: 192.0.2.11
    robot2:
      ansible_host: 192.0.2.12
  vars:
    ansible_user: root # another user needs sudo on the robot
    # ansible_ssh_private_key_file: ~/.ssh/robots # else your ssh configuration and agent decide
"""
IGNORED = """\
# What runs leave behind, and plans.
/collected/
/runs/
*.plan
# Words that are nobody else's business.
.env
*.secret
"""
_LONGEST = 32


def starter(folder: str) -> Mapping[str, str]:
    """Return the files of a new experiment by name; it is called as its folder, as far as names of experiments go."""
    name = re.sub("[^a-z0-9]+", "-", folder.lower()).strip("-")[:_LONGEST].strip("-") or "experiment"
    return {
        "experiment.edf": EXPERIMENT.format(name=name),
        "talker.cdf": TALKER,
        "talker.sh": SCRIPT,
        "inventory.yml": INVENTORY,
        ".gitignore": IGNORED,
    }
