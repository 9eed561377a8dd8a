"""A container with SYS_PTRACE on a real robot: what it takes over there, and what the plan says."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest

from srprov.planning.graver import TAKES_OVER
from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import built

pytestmark = pytest.mark.lab

ROBOT = "robot1"
SYS_ADMIN = 21
WAIT_S = 30.0
TRACER = r"""
#include <stdio.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>
static char text[4096];
static void of_file(const char *path) {
  FILE *file = fopen(path, "r");
  size_t count = file ? fread(text, 1, sizeof text - 1, file) : 0;
  text[count] = 0;
  if (file) fclose(file);
}
int main(int words, char **word) {
  int last = getpid(), next, status, newest;
  char path[64], *rights;
  if (words > 1) return strcmp(word[1], "well") != 0;
  for (;;) {
    for (next = last + 1; next < last + 20; next++) {
      if (ptrace(PTRACE_ATTACH, next, 0, 0) < 0) continue;
      waitpid(next, &status, __WALL);
      snprintf(path, sizeof path, "/proc/%d/status", next);
      of_file(path);
      if ((rights = strstr(text, "CapEff:"))) printf("took over %.24s\n", rights), fflush(stdout);
      ptrace(PTRACE_DETACH, next, 0, 0);
      last = next;
    }
    of_file("/proc/loadavg");
    if (strrchr(text, ' ') && sscanf(strrchr(text, ' '), "%d", &newest) == 1 && newest > last + 2) last = newest - 2;
  }
}
"""


@pytest.mark.skipif(not shutil.which("gcc"), reason="nothing here makes a program that traces")
def test_the_plan_says_that_a_container_takes_over_what_its_engine_starts(lab: Lab, tmp_path: Path) -> None:
    """A health check has all rights of root's until it runs; usual containers see it, and cannot trace it."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    built(tmp_path, "trace", TRACER)

    path = tmp_path / "tracing.edf"
    check = {"test": ["CMD", "/x/trace", "well"], "interval": "1s", "timeout": "10s"}
    usual = {**busybox("/x/trace"), "volumes": ["./bin:/x"], "healthcheck": check, "cpus": 0.5}
    services = {"a": {**usual, "cap_add": ["SYS_PTRACE"]}, "b": usual}
    path.write_text(edf("tracing", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    words = (str(path), "-i", inventory)
    assert TAKES_OVER in " ".join(lab.srprov("plan", *words).out.split())
    refused = lab.srprov("apply", *words, "--yes")
    assert refused.code == 9 and TAKES_OVER in refused.err, refused

    done = lab.srprov("apply", *words, "--yes", "--allow", "capability", "--settle", "0", "--no-probe")
    assert done.code == 0, done
    end = time.monotonic() + WAIT_S
    while not (found := _taken(lab, "a")) and time.monotonic() < end:
        time.sleep(1)
    if lab.shell(ROBOT, "cat", "/sys/module/apparmor/parameters/enabled", check=False).out.strip() != "Y":
        assert found, "engines, or kernels, mend it: say so in docs/policy.md"
    assert not _taken(lab, "b")


def _taken(lab: Lab, service: str) -> list[str]:
    """Return the rights of what a service took over that has more than it was given."""
    said = lab.shell(ROBOT, "docker", "logs", f"srprov.tracing.{service}").out
    rights = [line.split()[-1] for line in said.splitlines() if line.startswith("took over")]
    return [one for one in rights if int(one, 16) >> SYS_ADMIN & 1]
