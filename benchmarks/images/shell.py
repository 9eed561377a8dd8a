"""What people type without a tool: `docker save | ssh docker load`, in a loop or with some care, and a registry."""

from __future__ import annotations

import contextlib
import shutil
import socket
import subprocess
import time

from benchmarks.images.tool import Tool
from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS, Trouble
from benchmarks.provisioning.tool import Call

SSH = f"ssh -i {KEY} -o UserKnownHostsFile={KNOWN_HOSTS} -o StrictHostKeyChecking=yes -o BatchMode=yes"
HEAD = """\
set -eo pipefail
image={image} builder=root@{builder}
targets="{targets}"
on() {{ local who=$1; shift; {ssh} "$who" "$@"; }}
run="docker rm -f bench >/dev/null 2>&1; docker run -d --name bench --network none $image >/dev/null"
each() {{ # run a function for all targets at once
  local pids= pid target
  for target in $targets; do "$1" "$target" & pids="$pids $!"; done
  for pid in $pids; do wait "$pid"; done
}}
"""
LOOP = """\
for target in $targets; do
  on $builder docker save $image | on root@$target "docker load -q >/dev/null && { $run; }"
done
"""
PARALLEL = """\
rm -f lacking.*
id=$(on $builder docker image inspect -f '{{.Id}}' $image)
look() { on root@$1 "docker inspect -f '{{.Image}}' bench 2>/dev/null" | grep -qx "$id" || touch lacking.$1; }
each look
targets=$(ls | sed -n 's/^lacking\\.//p')
test -n "$targets" || exit 0
on $builder "docker save $image%s" >image.tar
load() { on root@$1 "docker load -q >/dev/null && { $run; }" <image.tar; }
each load
"""
PULL = """\
here=%(registry)s/$image
on $builder "docker tag $image $here && docker push -q $here >/dev/null"
pull() {
  on root@$1 "docker pull -q $here >/dev/null && id=\\$(docker image inspect -f '{{.Id}}' $here) &&
    { test \\"\\$(docker inspect -f '{{.Image}}' bench 2>/dev/null)\\" = \\$id || { docker tag $here $image; $run; }; }"
}
each pull
"""
REGISTRY_PORT = 5001
REGISTRY = """\
version: 0.1
log: {{level: warn}}
storage: {{filesystem: {{rootdirectory: {folder}}}}}
http: {{addr: "{address}"}}
"""
TRUST = """\
grep -q {address} /etc/docker/daemon.json ||
  sed -i 's|"insecure-registries": \\[|&"{address}", |' /etc/docker/daemon.json && kill -HUP $(cat /run/docker.pid)
"""


class Shell(Tool):
    """A bash script on the controller."""

    script = ""

    def call(self, image: str) -> Call:
        """Write the script into a file: what comes by stdin, ssh would read."""
        targets = " ".join(address for _, address in self.fleet.targets)
        head = HEAD.format(image=image, builder=self.fleet.builder[1], targets=targets, ssh=SSH)
        (self.folder / "script.sh").write_text(head + self.script)
        return Call(("bash", "script.sh"))


class Loop(Shell):
    """One robot after the other, always everything, as how-tos have it."""

    name = "save | load, a loop"
    script = LOOP


class Parallel(Shell):
    """The builder read once, robots that run the image left alone, all others at once."""

    name = "save | load, at once"
    script = PARALLEL % ""


class Packed(Shell):
    """The same with what is sent compressed."""

    name = "save | gzip -1 | load, at once"
    script = PARALLEL % " | gzip -1"


class Pull(Shell):
    """The builder pushes to Debian's docker-registry on the controller, and all robots pull."""

    name = "docker-registry, pull"

    @classmethod
    def version(cls) -> str:
        """Return the registry's version."""
        said = subprocess.run(["docker-registry", "--version"], capture_output=True, text=True, timeout=30, check=False)
        return " ".join(said.stdout.split()[:1] + said.stdout.split()[-1:])

    def begin(self) -> None:
        """Start an empty registry, which robots trust without TLS."""
        super().begin()
        address = f"{self.fleet.lab.site.controller}:{REGISTRY_PORT}"
        self.script = PULL % {"registry": address}
        for name, _ in (self.fleet.builder, *self.fleet.targets):
            self.fleet.lab.enter(name, TRUST.format(address=address))
        config = self.folder / "registry.yml"
        config.write_text(REGISTRY.format(folder=self.folder / "registry", address=address))
        with open(self.folder / "registry.log", "wb") as log:
            self.server = subprocess.Popen(["docker-registry", "serve", str(config)], stdout=log, stderr=log)
        deadline = time.monotonic() + 10
        while not self._listens():
            if time.monotonic() > deadline:
                raise Trouble("docker-registry does not listen")
            time.sleep(0.05)

    def _listens(self) -> bool:
        with contextlib.suppress(OSError):
            socket.create_connection((str(self.fleet.lab.site.controller), REGISTRY_PORT), 1).close()
            return True
        return False

    def end(self) -> None:
        """End it, and remove what it has."""
        self.server.terminate()
        self.server.wait(10)
        shutil.rmtree(self.folder / "registry", ignore_errors=True)
