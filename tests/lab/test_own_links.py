"""A container with NET_ADMIN on a real robot: where it makes links, who is answered by it, and what the plan says."""

from __future__ import annotations

import ipaddress
import shutil
from pathlib import Path

import pytest

from srprov.planning.graver import MAKES_LINKS
from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import built

pytestmark = pytest.mark.lab

ROBOT, NEIGHBOUR = "robot1", "robot2"
LINKER = r"""
#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
static struct { struct nlmsghdr head; struct ifinfomsg link; char rest[256]; } ask;
static struct rtattr *add(int type, const void *data, int size) {
  struct rtattr *one = (void *)((char *)&ask + NLMSG_ALIGN(ask.head.nlmsg_len));
  one->rta_type = type, one->rta_len = RTA_LENGTH(size);
  if (size) memcpy(RTA_DATA(one), data, size);
  ask.head.nlmsg_len = NLMSG_ALIGN(ask.head.nlmsg_len) + RTA_ALIGN(one->rta_len);
  return one;
}
int main(int words, char **word) {
  int card = atoi(word[1]), robot = 0, to = socket(AF_NETLINK, SOCK_RAW, NETLINK_ROUTE);
  struct { struct nlmsghdr head; struct nlmsgerr said; char rest[512]; } answer;
  ask.head = (struct nlmsghdr){NLMSG_LENGTH(sizeof ask.link), RTM_NEWLINK,
    NLM_F_REQUEST | NLM_F_CREATE | NLM_F_EXCL | NLM_F_ACK};
  add(IFLA_IFNAME, "m0", 3), add(IFLA_LINK, &card, 4), add(IFLA_LINK_NETNSID, &robot, 4);
  struct rtattr *info = add(IFLA_LINKINFO, 0, 0);
  add(IFLA_INFO_KIND, "macvlan", 7);
  info->rta_len = (char *)&ask + ask.head.nlmsg_len - (char *)info;
  send(to, &ask, ask.head.nlmsg_len, 0);
  recv(to, &answer, sizeof answer, 0);
  printf("%s\n", strerror(-answer.said.error));
  return answer.said.error != 0;
}
"""


@pytest.mark.skipif(not shutil.which("gcc"), reason="nothing here makes a program that makes links")
def test_the_plan_says_that_a_container_makes_links_in_the_robot_s_network(lab: Lab, tmp_path: Path) -> None:
    """The robot's network has a number in the container's own, as its link's other end is there."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    built(tmp_path, "link", LINKER)

    path = tmp_path / "linking.edf"
    usual = {**busybox(), "volumes": ["./bin:/x"]}
    services = {"a": {**usual, "cap_add": ["NET_ADMIN"]}, "b": usual}
    path.write_text(edf("linking", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    words = (str(path), "-i", inventory)
    refused = lab.srprov("apply", *words, "--yes")
    assert refused.code == 9 and MAKES_LINKS in " ".join(refused.err.split()), refused

    done = lab.srprov("apply", *words, "--yes", "--allow", "capability", "--settle", "0", "--no-probe")
    assert done.code == 0, done
    card = lab.shell(ROBOT, "cat", "/sys/class/net/eth0/ifindex").out.strip()
    assert lab.shell(ROBOT, "docker", "exec", "srprov.linking.b", "/x/link", card, check=False).code != 0
    made = lab.shell(ROBOT, "docker", "exec", "srprov.linking.a", "/x/link", card, check=False)
    assert made.code == 0, f"kernels, or engines, mend it: say so in docs/policy.md ({made})"

    free = str(_network(lab)[-6])
    serve = f"echo mine >/tmp/v2; ifconfig m0 {free} netmask 255.255.255.0 up; httpd -p {free}:5000 -h /tmp"
    lab.shell(ROBOT, "docker", "exec", "srprov.linking.a", "sh", "-c", serve)
    asked = f"import urllib.request as u; print(u.urlopen('http://{free}:5000/v2', timeout=20).read().decode())"
    assert lab.shell(NEIGHBOUR, "python3", "-c", asked).out.strip() == "mine"


def _network(lab: Lab) -> ipaddress.IPv4Network:
    """Return the network that robots are in."""
    words = lab.shell(ROBOT, "ip", "-4", "-o", "addr", "show", "eth0").out.split()
    return ipaddress.IPv4Interface(words[words.index("inet") + 1]).network
