"""What a robot's own configuration files say, from its options. Pure: values in, texts out."""

from __future__ import annotations

from srprov.lab.places import REGISTRY_PORT, Site
from srprov.lab.spec import Robot, Sshd

SSHD_BEHIND_PROXY = 2022
"""Where the sshd of a robot with latency listens: port 22 is its delaying proxy's."""

SSHD_CONFIG = """\
%(listen)s
HostKey /etc/ssh/ssh_host_ed25519_key
PermitRootLogin %(root)s
PasswordAuthentication no
KbdInteractiveAuthentication no
UsePAM no
UseDNS no
PrintMotd no
PrintLastLog no
MaxStartups %(startups)s
MaxSessions %(sessions)d
AcceptEnv LANG LC_*
PidFile /run/sshd.pid
Subsystem sftp internal-sftp
"""

DAEMON_JSON = """\
{
  "data-root": "/var/lib/docker",
  "exec-opts": ["native.cgroupdriver=cgroupfs"],
  "insecure-registries": ["%(registry)s"],
  "log-level": "warn",
  "registry-mirrors": ["http://%(registry)s"],
  "shutdown-timeout": 5,
  "storage-driver": "overlay2"
}
"""

DATE = """\
#!/bin/sh
# The clock of this robot is off, for everybody who asks `date` for the time.
for word; do
    case $word in -d* | --date* | -r* | --reference* | -s* | --set* | -f* | --file*) exec /run/lab/date "$@" ;; esac
done
offset=%+f
[ ! -e /run/lab/clock ] || read -r offset </run/lab/clock
exec /run/lab/date -d "$offset seconds" "$@"
"""

SYSTEMCTL = """\
#!/bin/sh
# No systemd runs on this robot: units are enabled by their links, and the next boot runs them.
for word; do
    case $word in daemon-reload | stop) exit 0 ;; esac
done
exec /run/lab/systemctl --root=/ "$@"
"""

NOISE_MARK = "# Written by the lab: the option bashrc.\n"


def sshd(site: Site, robot: Robot) -> str:
    """/etc/ssh/sshd_config. The address behind the proxy is the robot's own: it is part of SSH_CONNECTION."""
    limits = robot.sshd or Sshd()
    behind = f"ListenAddress {site.address(robot.name, robot.lan)}:{SSHD_BEHIND_PROXY}"
    # A provisioner opens many connections at once; sshd's own limits drop such bursts.
    return SSHD_CONFIG % {
        "listen": behind if robot.ssh_latency_ms else "Port 22",
        "root": "no" if robot.unprivileged else "prohibit-password",
        "startups": limits.max_startups or "500:30:1000",
        "sessions": limits.max_sessions or 200,
    }


def docker_daemon(site: Site) -> str:
    """/etc/docker/daemon.json."""
    return DAEMON_JSON % {"registry": f"{site.controller}:{REGISTRY_PORT}"}


def hosts(name: str) -> str:
    """/etc/hosts."""
    return f"127.0.0.1 localhost\n127.0.1.1 {name}\n::1 localhost ip6-localhost\n"


def date(offset_s: float) -> str:
    """A `date` that is off by so many seconds; boot.sh binds it over the real one."""
    return DATE % offset_s


def noise(text: str) -> str:
    """~/.bashrc and ~/.profile with the text of the option."""
    return NOISE_MARK + text + ("" if text.endswith("\n") else "\n")
