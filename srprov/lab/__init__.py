"""The embedded lab: N robots on this one machine, each a real host for SSH, Docker and the network.

Takes a number of robots and a lab-spec.yml, gives running robots, an inventory and a known_hosts.
It may touch: its own folders (places.py), its own cgroups, its bridge and its firewall rules. Several
labs, told apart by names, can be up side by side. Only `srprov/cli/lab.py` calls it; the rest of
srprov sees hosts that answer SSH.

    lab.py        up, down, kill, restart: the order of things
    overview.py   the robots of a lab and how they are, and all labs of this machine
    faults.py     partition, heal, a crashed or stopped engine: what comes and goes while the lab is up
    spec.py       lab-spec.yml -> Robot values
    places.py     names, folders and addresses of one lab
    sites.py      which labs there are on this machine, and what they share
    machine.py    programs, and what is missing
    state.py      what is remembered in /run
    members.py    which robots the lab has, by that
    cgroups.py    one group per robot: whatever runs in it is the robot's
    network.py    bridge, NAT, cables (cable.py: slow and lossy ones; partition.py: who cannot reach whom)
    disk.py       a robot's own files (users.py, config.py, figures.py)
    robot.py      boot, ready, kill, enter (engine.py: its Docker; latency.py: the proxy before its sshd)
    arm64.py      a robot of another architecture (engine_proxy.py: a program of its own, before its engine)
    boot.sh       PID 1 of a robot
    delay.py      the delaying proxy, a program of its own
    images.py     what the mirror serves (trust.py: what this machine trusts, tarfiles.py: layers,
                  oci.py: written as a registry stores it)
    registry.py   the mirror
    inventory.py  the Ansible inventory and the known_hosts
"""
