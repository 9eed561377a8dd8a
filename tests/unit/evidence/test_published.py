"""The bundle in docs/evidence is what docs/evidence.md says: for plain tools, for `verify`, and for whoever is curious.

`PUBLISH=1 make evidence` makes it anew, from a commit. It must be when `descriptions.RULES` was raised.
"""

from __future__ import annotations

import getpass
import ipaddress
import re
import socket
import subprocess
import zipfile
from pathlib import Path

import pytest

from srprov.evidence.verify import verify
from srprov.network.addresses import allocate, bridge_macs
from tests.unit.evidence.bundles import Content, unpacked
from tests.unit.evidence.test_questions import QUESTIONS, asked, graph_of

pytestmark = pytest.mark.filterwarnings("ignore:ConjunctiveGraph")  # rdflib's own reader of JSON-LD
FOLDER = Path(__file__).parents[3] / "docs" / "evidence"
BUNDLE, SIGNERS = FOLDER / "race.zip", FOLDER / "signers"
TRIALS = 18
NOBODYS = [ipaddress.ip_network(one) for one in ("192.0.2.0/24", "198.51.100.0/24", "203.0.113.0/24", "127.0.0.0/8",
                                                  "0.0.0.0/32", "2001:db8::/32", "::1/128", "::/128")]  # fmt: skip
"""For documentation, and each machine's own."""
ADDRESS = re.compile(rb"(?<![\w.:])(?:\d{1,3}(?:\.\d{1,3}){3}|[0-9a-f]{1,4}(?::[0-9a-f]{0,4}){3,7})(?![\w.:])")
MAC = re.compile(rb"(?<![\w:])(?:[0-9a-f]{2}:){5}[0-9a-f]{2}(?![\w:])", re.IGNORECASE)
SUBNET = re.compile(rb'"(10\.[0-9.]+/[0-9]+)"')
NOBODYS_CARDS = ("00:00:00:00:00:00", "ff:ff:ff:ff:ff:ff", "00:00:5e:00:53:")
"""None, all, and those for documentation."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle, unpacked by somebody without srprov."""
    target = tmp_path_factory.mktemp("race")
    with zipfile.ZipFile(BUNDLE) as archive:
        archive.extractall(target)
    return target


@pytest.fixture(scope="module")
def everything() -> Content:
    """What is in it."""
    return unpacked(BUNDLE)


def test_plain_tools_find_it_whole_and_signed(folder: Path) -> None:
    subprocess.run(["sha256sum", "-c", "--strict", "--quiet", "manifest-sha256.txt"], cwd=folder, check=True)
    check = ["ssh-keygen", "-Y", "verify", "-f", str(SIGNERS), "-I", "srprov-evidence", "-n", "srprov-bundle",
             "-s", "manifest-sha256.txt.sig"]  # fmt: skip
    manifest = (folder / "manifest-sha256.txt").read_bytes()
    assert subprocess.run(check, cwd=folder, input=manifest, check=False, capture_output=True).returncode == 0
    other = subprocess.run(check, cwd=folder, input=manifest[1:], check=False, capture_output=True)
    assert other.returncode != 0, "of another manifest"


def test_plain_tools_read_its_tables(folder: Path) -> None:
    """The column of a name is found by its name, as a stranger's awk would."""
    program = """NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i; next }
        $at["status"] == "ok" { n[$at["verdict"]]++ }
        END { for (verdict in n) print verdict, n[verdict] }"""
    words = ["awk", "-F,", program, "trials.csv"]
    found = subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True)
    counts = {verdict: int(count) for verdict, count in map(str.split, found.stdout.splitlines())}
    assert 0 < counts["success"] <= sum(counts.values()) <= TRIALS


def test_it_passes_every_check_of_verify() -> None:
    report = verify(str(BUNDLE), str(SIGNERS))
    assert [(one.id, one.details) for one in report.findings if one.result == "fail"] == []
    skipped = {one.id for one in report.findings if one.result == "skipped"} - {"I2", "I3", "I4"}  # it has no images
    assert skipped <= {"S2"}, "other rules, or another version"
    (run,) = (one for one in report.findings if one.id == "J4")
    assert f"{TRIALS} trials" in run.details[0], run


def test_it_tells_nobody_whose_machine_it_was(everything: Content) -> None:
    """Overlays are made by srprov from the experiment's name; all other addresses are for documentation."""
    plan = next(data for name, data in everything.items() if name.endswith("/plan.json"))
    (overlay,) = {ipaddress.IPv4Network(one[1].decode()) for one in SUBNET.finditer(plan)}
    services = allocate("race", overlay, ("referee", "recorder", "runner"), ()).macs.values()
    cards = {*services, *bridge_macs("race", ("robot1", "robot2", "robot3"), services).values()}
    mine = {getpass.getuser(), socket.gethostname(), str(Path.home())} - {"root", "localhost"}
    for name, data in everything.items():
        if "/inputs/" not in name or name.endswith("inventory.yml"):  # else it is the experiment's own
            assert strange_addresses(data, overlay, (*NOBODYS_CARDS, *cards)) == [], name
            assert [word for word in mine if len(word) > 3 and word.encode() in data] == [], name
            assert re.search(rb"(?<![\w.])/(?:tmp|work|root|home/(?!user))/|root@", data) is None, name


def strange_addresses(data: bytes, overlay: ipaddress.IPv4Network, cards: tuple[str, ...]) -> list[str]:
    """Return addresses of IP and of network cards that somebody may have."""
    found = []
    for text in {one[0].decode() for one in ADDRESS.finditer(data)}:
        try:
            address = ipaddress.ip_address(text)
        except ValueError:
            continue
        if not any(address in net for net in (*NOBODYS, overlay) if net.version == address.version):
            found.append(text)
    every = {one[0].decode().lower() for one in MAC.finditer(data)}
    return found + [one for one in every if not one.startswith(cards)]


def test_its_crate_answers_every_question(everything: Content) -> None:
    graph = graph_of(everything["ro-crate-metadata.json"])
    assert [name for name, query in QUESTIONS.items() if not asked(graph, query)] == []
    assert len(asked(graph, QUESTIONS["how long a trial took"])) == TRIALS


def test_it_says_who_may_do_what_with_it(everything: Content) -> None:
    assert b"SPDX-License-Identifier: Apache-2.0" in everything["LICENSE"]
    assert b"The srprov authors" in everything["CITATION.cff"]
    assert b"**the authors must say**" in everything["CHECKLIST.md"]
    assert BUNDLE.stat().st_size < 2_000_000
