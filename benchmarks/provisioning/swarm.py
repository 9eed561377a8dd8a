"""Docker Swarm: one stack with a service per robot, and Swarm's own overlay in place of bridge and VXLAN.

`swarm init` on the first robot and `swarm join` on the others are set-up and not measured with the job. The measured
command is one SSH connection to the first robot: `docker stack deploy`, then asking until every service is as wished.
`--resolve-image never` because no registry is to be asked; `--detach` because the CLI's own waiting adds five seconds.
"""

from __future__ import annotations

import json

from benchmarks.provisioning.job import COMMAND, IMAGE, SUBNET, Job
from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS
from benchmarks.provisioning.tool import Call, Tool

DEPLOY = """\
set -e
version=$(docker version -f '{{.Client.Version}}')
case "$version" in 1*|20.*|23.*|24.*|25.*) detach= ;; *) detach=--detach=true ;; esac
docker stack deploy --resolve-image never $detach -c - bench >/dev/null <<'EOF'
%(stack)s
EOF
# a task's own specification tells whether it is the new one
look='{{.Status.State}} {{.Spec.ContainerSpec.Env}}'
until
  tasks=$(docker stack ps -q --filter desired-state=running bench)
  seen=$(test -z "$tasks" || docker inspect -f "$look" $tasks | sort)
  test "$seen" = "%(wanted)s"
do sleep 0.05; done
"""
GONE = 'for i in $(seq 150); do test -n "$(%s)" || break; sleep 0.1; done'


class Swarm(Tool):
    """`docker stack deploy`."""

    name = "Docker Swarm"
    vxlan = False

    def begin(self) -> None:
        """Make the first robot a manager and let the others join."""
        (first, address), *others = self.lab.robots
        self.lab.enter(first, f"docker swarm init --advertise-addr {address} --listen-addr {address} >/dev/null")
        token = self.lab.enter(first, "docker swarm join-token -q worker").strip()
        for name, own in others:
            words = f"--token {token} --advertise-addr {own} --listen-addr {own} {address}:2377"
            self.lab.enter(name, f"docker swarm join {words} >/dev/null")

    def end(self) -> None:
        """Remove the stack and leave the swarm; what comes next needs the stack's subnet, so wait until it is free."""
        first = self.lab.robots[0][0]
        self.lab.enter(first, "docker stack rm bench >/dev/null 2>&1; true")
        self.lab.everywhere(GONE % "docker ps -q")
        self.lab.everywhere("docker swarm leave --force >/dev/null 2>&1; true")
        self.lab.everywhere(GONE % "docker network ls -q --filter driver=overlay")

    def call(self, job: Job, variant: str) -> Call:
        """Write the stack into the command."""
        services = {
            member.service: {
                "image": IMAGE,
                "command": list(COMMAND),
                "environment": {"VALUE": member.value},
                "networks": ["net"],
                "deploy": {"placement": {"constraints": [f"node.hostname=={member.robot}"]}},
            }
            for member in job.members
        }
        networks = {"net": {"driver": "overlay", "ipam": {"config": [{"subnet": SUBNET}]}}}
        # in a compose file a lone $ begins a variable
        stack = json.dumps({"version": "3.8", "services": services, "networks": networks}).replace("$", "$$")
        wanted = "\n".join(sorted(f"running [VALUE={member.value}]" for member in job.members))
        script = DEPLOY % {"stack": stack, "wanted": wanted}
        options = ("-i", str(KEY), "-o", f"UserKnownHostsFile={KNOWN_HOSTS}", "-o", "StrictHostKeyChecking=yes")
        return Call(("ssh", *options, "-o", "BatchMode=yes", f"root@{job.members[0].underlay}", "sh"), stdin=script)
