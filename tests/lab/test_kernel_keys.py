"""What root's programs keep in the kernel's keyrings, on a real robot: who reads it, and whether the plan says so."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from srprov.planning.security_options import UNCONFINED
from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import built

pytestmark = pytest.mark.lab

ROBOT = "robot1"
READER = r"""
#include <stdio.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>
enum { LINK = 8, SEARCH = 10, READ = 11, SET_TIMEOUT = 15, SECONDS = 300, SESSION = -3, USER = -4 };
int main(int count, char **word) {
  char found[64] = {0};
  long key;
  if (count > 2) {
    key = syscall(SYS_add_key, "user", word[1], word[2], strlen(word[2]), USER);
    return key < 0 || syscall(SYS_keyctl, SET_TIMEOUT, key, SECONDS) < 0;
  }
  syscall(SYS_keyctl, LINK, USER, SESSION, 0, 0);
  key = syscall(SYS_keyctl, SEARCH, USER, "user", word[1], 0);
  if (key < 0 || syscall(SYS_keyctl, READ, key, found, sizeof found - 1, 0) < 0) return 1;
  puts(found);
  return 0;
}
"""


@pytest.mark.skipif(not shutil.which("gcc"), reason="nothing here makes a program that asks for a key")
def test_the_plan_says_that_keys_of_root_are_read_without_a_profile(lab: Lab, tmp_path: Path) -> None:
    """Root of a container has root's number, by which the kernel knows whose keys are whose; usual ones ask in vain."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    program = built(tmp_path, "key", READER)
    subprocess.run([str(program), "srprov-test-disk", "its password"], check=True)  # root's, of each robot of a lab

    path = tmp_path / "keys.edf"
    usual = busybox(volumes=["./bin:/x"])
    services = {"a": {**usual, "security_opt": ["seccomp=unconfined"]}, "b": usual}
    path.write_text(edf("keys", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    words = (str(path), "-i", inventory)
    assert UNCONFINED in " ".join(lab.srprov("plan", *words).out.split())
    refused = lab.srprov("apply", *words, "--yes")
    assert refused.code == 9 and UNCONFINED in refused.err, refused

    done = lab.srprov("apply", *words, "--yes", "--allow", "security-opt", "--settle", "0", "--no-probe")
    assert done.code == 0, done
    for service, has in (("a", True), ("b", False)):
        said = lab.shell(ROBOT, "docker", "exec", f"srprov.keys.{service}", "/x/key", "srprov-test-disk", check=False)
        assert ("its password" in said.out) == has, said
