"""Robots that are reached by ports of another one, as behind a gateway: it does not pass for them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.conftest import Lab, part_of_lab

pytestmark = pytest.mark.lab

PORT = 2202
PASSWORD = "robot2-s-own-word"
PASSED_ON = f"""sysctl -q -w net.ipv4.ip_forward=1 && nft add table ip gateway &&
nft 'add chain ip gateway to {{ type nat hook prerouting priority -100; }}' &&
nft 'add chain ip gateway from {{ type nat hook postrouting priority 100; }}' &&
nft add rule ip gateway to tcp dport {PORT} dnat to ADDRESS:22 &&
nft add rule ip gateway from ip daddr ADDRESS masquerade"""
ITSELF = f"""nft delete table ip gateway && useradd -m pi &&
printf '#!/bin/sh\\ncat >>/root/told\\n' >/usr/local/bin/told &&
chmod 755 /usr/local/bin/told && cp -a /etc/pam.d /etc/pam.d.kept &&
printf 'auth optional pam_exec.so expose_authtok quiet /usr/local/bin/told\\nauth sufficient pam_permit.so\\n\\
account required pam_permit.so\\nsession required pam_permit.so\\n' >/etc/pam.d/sshd &&
/usr/sbin/sshd -p {PORT} -o PasswordAuthentication=yes -o UsePAM=yes -o PidFile=/run/gateway.pid \\
</dev/null >/dev/null 2>&1"""
"""Whatever is typed is let in, and told."""
CLEANED = """nft delete table ip gateway 2>/dev/null; [ ! -e /run/gateway.pid ] || kill $(cat /run/gateway.pid)
[ ! -e /etc/pam.d.kept ] || { rm -rf /etc/pam.d && mv /etc/pam.d.kept /etc/pam.d; }
userdel -r pi; rm -f /usr/local/bin/told /root/told; true"""


def test_a_gateway_with_its_own_key_is_told_no_password_of_a_robot_behind_it(lab: Lab, tmp_path: Path) -> None:
    """robot1 passes a port on to robot2; then it answers there itself, with the key by which it is known as robot1."""
    first, second = (str(lab.site.address(robot)) for robot in ("robot1", "robot2"))
    keys = {line.split()[0]: line for line in lab.site.known_hosts.read_text(encoding="utf-8").splitlines()}
    known = tmp_path / "known_hosts"
    known.write_text(f"{keys[first]}\n{keys[second].replace(second, f'[{first}]:{PORT}')}\n", encoding="utf-8")
    options = {"ansible_ssh_common_args": f"-o UserKnownHostsFile={known}"}
    behind = {"ansible_host": first, "ansible_port": PORT, **options}
    passed_on = part_of_lab(lab, ["robot1", "robot2"], tmp_path / "lab.yml", robot1=options, robot2=behind)
    asked = {"ansible_user": "pi", "ansible_password": PASSWORD}
    himself = part_of_lab(lab, ["robot1", "robot2"], tmp_path / "pi.yml", robot1=options, robot2={**behind, **asked})
    try:
        lab.shell("robot1", "sh", "-c", PASSED_ON.replace("ADDRESS", second))
        honest = lab.srprov("facts", "-i", passed_on)
        assert honest.code == 0, honest
        lab.shell("robot1", "sh", "-c", ITSELF)
        lying = lab.srprov("facts", "-i", himself)
        told = lab.shell("robot1", "sh", "-c", "cat /root/told 2>/dev/null; true").out
        known.write_text(f"{keys[first]}\n", encoding="utf-8")
        new = lab.srprov("facts", "-i", himself)
        told += lab.shell("robot1", "sh", "-c", "cat /root/told 2>/dev/null; true").out
    finally:
        lab.shell("robot1", "sh", "-c", CLEANED)
    assert PASSWORD not in told
    assert lying.code == 4 and "robot2: its host key changed" in lying.err, lying
    assert new.code == 4 and "robot2: its host key is unknown" in new.err, new
