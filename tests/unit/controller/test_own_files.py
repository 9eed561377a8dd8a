"""Files with passwords of robots, keys and files of secrets beside an EDF: somebody is asked before one is shipped."""

from __future__ import annotations

import base64
import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import dsa, ec, ed25519, rsa
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)
from cryptography.hazmat.primitives.serialization.pkcs12 import serialize_key_and_certificates
from msgspec.structs import replace

from srprov import regular_file
from srprov.controller.locking import draft
from srprov.controller.own_files import asked_for, permit_copies
from srprov.controller.owners import Owner, keep
from srprov.controller.plan import make_plan
from srprov.controller.request import PlanRequest
from srprov.controller.secrets import read_secrets
from srprov.controller.source import read_definitions
from srprov.definitions import load_experiment, load_inventory, version_control
from srprov.definitions.lockfile import Lock, dump
from srprov.definitions.model import Inventory
from srprov.errors import DefinitionError, RefusedError
from srprov.facts.gather import Gathering
from srprov.own_records import KEPT_OUT
from srprov.record import RunFolder
from srprov.secret import Vault
from tests.fakes import World
from tests.trial_folders import run_folder, write_experiment
from tests.worlds import inventory as robots_of
from tests.worlds import remembering_all

HOSTS = "all: {hosts: {r1: {}}, vars: {ansible_become_password: kuka-4711}}\n"
EDF = "edf: 1\nname: nav\nservices: {a: {image: busybox, SHIPS}}\nMORE\n"
CDF = "edf: 1\nname: nav\nservices: {a: {cdf: parts/a.cdf}}\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    (tmp_path / "lab").mkdir()
    monkeypatch.chdir(tmp_path / "lab")
    Path("inventory.yml").write_text(HOSTS)
    Path("parts").mkdir()
    yield tmp_path / "lab"


def asked(inventory: str = "inventory.yml") -> list[tuple[str, str]]:
    """Return service -> file, from the folder, of all that is asked for as `outside`."""
    made = asked_for(load_experiment("e.edf"), load_inventory([inventory]))
    paths = ((service, what.partition(": it ")[0]) for service, what in made.experiment.outside)
    return [(service, os.path.relpath(path)) for service, path in paths]


@pytest.mark.parametrize(
    ("ships", "more"),
    [
        ('volumes: [".:/ws"]', ""),
        ('volumes: ["./inventory.yml:/hosts"]', ""),
        ('volumes: ["v:/ws"]', "volumes: {v: {seed: .}}"),
        ("data: [{path: inventory.yml, target: /hosts}]", ""),
        ("data: [{path: ., target: /ws}]", ""),
    ],
)
def test_an_inventory_with_a_password_is_shipped_by_nobody_unasked(here: Path, ships: str, more: str) -> None:
    Path("e.edf").write_text(EDF.replace("SHIPS", ships).replace("MORE", more))
    assert asked() == [("a", "inventory.yml")]
    Path("inventory.yml").write_text("all: {hosts: {r1: {ansible_host: 192.0.2.1}}}\n")
    assert asked() == []


@pytest.mark.parametrize(
    "ships",
    [
        'volumes: [".:/ws"]',
        'volumes: ["./maps:/maps"]',
        'volumes: ["./maps/floor:/floor"]',
        "data: [{path: maps/floor, target: /floor}]",
        "env_file: maps/floor",
        "cdf: a.cdf",
        "cdf: b.cdf",
    ],
)
@pytest.mark.parametrize(
    "kept", [".git/config", "../.git/config", "parts/nav/_darcs/prefs/defaultrepo", "../.aws/credentials"]
)
def test_a_file_that_lies_elsewhere_is_known_by_a_name_that_an_archive_gave_it(
    here: Path, ships: str, kept: str
) -> None:
    """Maps of a stranger's, to be unpacked in the clone or in the user's home: one of them is a hard link."""
    Path(kept).parent.mkdir(parents=True)
    Path(kept).write_text("url=https://me:token@lab.example/nav\n")
    Path("maps").mkdir()
    os.link(kept, "maps/floor")
    Path("maps/walls").write_text("#")
    os.link("maps/walls", "maps/walls-too")
    Path("a.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: maps, dest: /maps}]\n")
    Path("Dockerfile").write_text("FROM busybox\nCOPY . /ws\n")
    Path("b.cdf").write_text("cdf: 1\ndockerfile: Dockerfile\n")
    edf = EDF.replace("SHIPS", ships).replace("MORE", "")
    Path("e.edf").write_text(edf.replace("image: busybox, cdf", "cdf"))
    Path("inventory.yml").write_text("all: {hosts: {r1: {ansible_host: 192.0.2.1}}}\n")
    assert ("a", "maps/floor") in asked() and {path for _, path in asked()} == {"maps/floor"}
    with pytest.raises(RefusedError, match=r"maps/floor: it has another name, elsewhere \(a hard link\)"):
        permit_copies(load_experiment("e.edf"), ())


def test_the_file_of_a_secret_is_no_other_one_by_a_name_that_an_archive_gave_it(here: Path) -> None:
    """The plan shows the name in the folder."""
    Path("../token").write_text("a token")
    Path("e.edf").write_text(
        "edf: 1\nname: nav\nservices: {a: {image: x, secrets: [t]}}\nsecrets: {t: {file: parts/t}}\n"
    )
    Path("parts/t").write_text("a token")
    assert asked() == []
    Path("parts/t").unlink()
    os.link("../token", "parts/t")
    assert asked() == [("a", "parts/t")]
    beside = Path("../lent")  # an archive may put it beside the EDF's folder, too
    beside.mkdir()
    os.link("../token", beside / "t")
    Path("e.edf").write_text(Path("e.edf").read_text().replace("parts/t", "../lent/t"))
    assert asked() == [("a", "../lent/t")]
    Path("e.edf").write_text(Path("e.edf").read_text().replace("../lent/t", "../t"))
    os.link("../token", "../t")  # both are in one folder, such as one of downloads
    assert asked() == [("a", "../t")]


def test_the_lock_is_no_other_one_by_a_name_that_an_archive_gave_it(here: Path) -> None:
    """It goes into records, and with these into bundles."""
    Path("../private.lock").write_text(dump(Lock(digests={"registry.lab/secret:1": f"sha256:{64 * 'a'}"})))
    Path("e.edf").write_text("edf: 1\nname: nav\nservices: {a: {image: busybox}}\n")
    Path("e.lock").write_text(Path("../private.lock").read_text())
    assert asked() == []
    Path("e.lock").unlink()
    Path("e.lock").hardlink_to("../private.lock")
    assert asked() == [("the experiment", "e.lock")]


def test_in_a_home_no_other_name_of_a_file_is_the_folder_s_own(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What an archive that was unpacked there leads to lies there, too."""
    Path("parts/a").write_text("a")
    os.link("parts/a", "parts/b")
    names = version_control.names_in(str(here))
    assert not version_control.is_from_elsewhere(os.lstat("parts/a"), str(here)) and list(names.values()) == [2]
    monkeypatch.setenv("HOME", str(here / "parts"))
    assert version_control.is_from_elsewhere(os.lstat("parts/a"), str(here))


@pytest.mark.parametrize(
    ("ships", "is_asked"),
    [
        ('volumes: [".:/ws"]', True),
        ('volumes: ["./results/token:/t"]', True),
        ('volumes: ["./results/sessions/1/rendered:/r"]', True),
        ('volumes: ["./race:/race"]', False),
        ("data: [{path: results/token, target: /t}]", True),
        ("env_file: results/trials/p1.r1/x.env", True),
        ("cdf: parts/a.cdf", True),
        ("cdf: Dockerfile", True),
        ("cdf: kept/Dockerfile", False),
    ],
)
def test_a_record_beside_an_edf_is_shipped_by_nobody_unasked(here: Path, ships: str, is_asked: bool) -> None:
    """A run of trials has the token by which this machine knows it, and serial numbers of robots."""
    run_folder(here / "results", write_experiment(here / "race"))
    for name in ("results/token", "results/trials/p1.r1/x.env"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text("A=b\n")
    Path("parts/a.cdf").write_text("cdf: 1\nbase: busybox\nfiles: [{src: .., dest: /ws}]\n")
    Path("kept").mkdir()
    for folder in (".", "kept"):
        Path(folder, "Dockerfile").write_text("FROM busybox\nCOPY . /ws\n")
    Path("inventory.yml").write_text("all: {hosts: {r1: {}}}\n")
    edf = EDF.replace("SHIPS", ships).replace("MORE", "")
    Path("e.edf").write_text(edf.replace("image: busybox, cdf", "cdf"))
    assert {path for _, path in asked()} == ({"results"} if is_asked else set())
    Path(".dockerignore").write_text("results/*.jsonl\nresults/trials\n")  # what tells it is not shipped, the rest is
    assert {path for _, path in asked()} == ({"results"} if is_asked else set())
    Path(".dockerignore").write_text("results\n")
    assert bool(asked()) is (is_asked and "Dockerfile" not in ships)


def test_records_of_applies_and_srprov_s_own_folder_are_asked_for(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What proves whose a volume is lies there."""
    Path("inventory.yml").write_text("all: {hosts: {r1: {}}}\n")
    monkeypatch.setenv("XDG_STATE_HOME", str(here / "state"))
    keep(Owner(instance="nav", edf=str(here / "e.edf"), source="s", token="0" * 32))
    with RunFolder(here / "runs", "one") as record:
        record.put("environment.json", lambda: "{}")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: [".:/ws"]').replace("MORE", ""))
    assert asked() == [("a", "runs/one"), ("a", "state/srprov")]


def test_secrets_of_an_export_beside_an_edf_are_asked_for(here: Path) -> None:
    """Its README has the user put them there; a service that mounts `.` got them when the EDF named them no more."""
    Path("inventory.yml").write_text("all: {hosts: {r1: {}}}\n")
    secrets = Path("twin/secrets")
    secrets.mkdir(parents=True)
    (secrets / ".gitignore").write_text(KEPT_OUT)
    (secrets / "db").write_text("value")
    for ships, wanted in (
        (".:/ws", ["twin/secrets"]),
        ("./twin/secrets/db:/db", ["twin/secrets"]),
        ("./parts:/ws", []),
    ):
        Path("e.edf").write_text(EDF.replace("SHIPS", f'volumes: ["{ships}"]').replace("MORE", ""))
        assert sorted({path for _, path in asked()} - {"inventory.yml"}) == wanted, ships


def test_a_second_name_of_what_an_export_keeps_secret_is_asked_for(here: Path) -> None:
    """An archive makes one where it is unpacked beside the export: both names lie in the experiment's folder then."""
    (here / "out").mkdir()
    (here / "out/.gitignore").write_text(KEPT_OUT)
    (here / "out/db").write_text("hunter2")
    os.link("out/db", "parts/map")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: ["./parts:/ws"]').replace("MORE", ""))
    assert asked() == [("a", "parts/map")]


def test_an_experiment_that_lies_in_a_record_has_its_files(here: Path) -> None:
    """As in a bundle that was unpacked, and where a placement is worked out again."""
    edf = write_experiment(here / "results/sessions/1/inputs")
    for name in ("journal.jsonl", "trials"):
        (here / "results" / name).mkdir()
    made = asked_for(load_experiment(str(edf)), Inventory(hosts={}, groups={}))
    assert made.experiment.outside == ()


def test_a_copy_of_it_is_known_by_what_is_in_it(here: Path) -> None:
    Path("parts/old.yml").write_text(HOSTS)
    Path("parts/hosts.yml").symlink_to("../inventory.yml")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: ["./parts:/ws"]').replace("MORE", ""))
    assert asked() == [("a", "parts/old.yml")]


def test_variables_of_it_are_not_taken_by_an_env_file(here: Path) -> None:
    Path("host_vars").mkdir()
    Path("host_vars/r1.yml").write_text("ansible_password: kuka-4711\n")
    Path("e.edf").write_text(EDF.replace("SHIPS", "env_file: host_vars/r1.yml").replace("MORE", ""))
    assert asked() == [("the experiment", "host_vars/r1.yml")]


def test_files_beside_it_and_keys_are_asked_for(here: Path) -> None:
    Path("inventory.yml").unlink()
    Path("hosts.ini").write_text("r1 ansible_ssh_pass=kuka-4711 ansible_ssh_private_key_file=parts/key\n")
    Path("group_vars").mkdir()
    Path("group_vars/all.yml").write_text("ansible_become_pass: kuka-4712\n")
    Path("parts/key").write_text("a key")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: [".:/ws"]').replace("MORE", ""))
    assert asked("hosts.ini") == [("a", one) for one in ("group_vars/all.yml", "hosts.ini", "parts/key")]


@pytest.mark.parametrize(
    ("cdf", "ignore", "is_asked"),
    [
        ("dockerfile: {context: ..}", "", True),
        ("dockerfile: {context: ..}", "inventory.yml\n", False),
        ("dockerfile: {context: ..}", "*\n!parts\n", False),
        ("dockerfile: Dockerfile", "", False),
        ("base: busybox\nfiles: [{src: .., dest: /ws}]", "", True),
        ("base: busybox\nfiles: [{src: ., dest: /ws}]", "", False),
    ],
)
def test_what_goes_into_an_image_is_asked_for(here: Path, cdf: str, ignore: str, is_asked: bool) -> None:
    for folder in (".", "parts"):
        Path(folder, "Dockerfile").write_text("FROM busybox\nCOPY . /ws\n")
    Path(".dockerignore").write_text(ignore)
    Path("parts/a.cdf").write_text(f"cdf: 1\nname: a\n{cdf}\n")
    Path("e.edf").write_text(CDF)
    assert asked() == [("a", "inventory.yml")] * is_asked


@pytest.mark.parametrize("kind", ["OPENSSH PRIVATE KEY", "PRIVATE KEY", "RSA PRIVATE KEY", "PGP PRIVATE KEY BLOCK"])
def test_a_private_key_is_known_by_what_is_in_it(here: Path, kind: str) -> None:
    """Ssh has some by `ansible_ssh_common_args` or its own settings, plans and bundles are signed with others."""
    Path("parts/key").write_text(f"a comment\n-----BEGIN {kind}-----\nb3BlbnNzaC1rZXktdjEAAAAA\n")
    Path("parts/key.pub").write_text("ssh-ed25519 AAAAC3 a@b\n-----BEGIN PUBLIC KEY-----\n")
    Path("inventory.yml").write_text("all: {hosts: {r1: {ansible_ssh_common_args: -i parts/key}}}\n")
    for ships in ('volumes: [".:/ws"]', 'volumes: ["./parts:/p"]', "data: [{path: parts/key, target: /k}]"):
        Path("e.edf").write_text(EDF.replace("SHIPS", ships).replace("MORE", ""))
        assert asked() == [("a", "parts/key")]
    Path("parts/Dockerfile").write_text("FROM busybox\nCOPY . /ws\n")
    Path("e.edf").write_text("edf: 1\nname: nav\nservices: {a: {cdf: parts/Dockerfile}}\n")
    assert asked() == [("a", "parts/key")]


def binary_keys() -> dict[str, bytes]:
    """Give keys and stores as well-known libraries and programs write them."""
    own, password = rsa.generate_private_key(65537, 2048), BestAvailableEncryption(b"kuka-4711")
    curve, edwards = ec.generate_private_key(ec.SECP256R1()), ed25519.Ed25519PrivateKey.generate()
    der, pkcs8, older = Encoding.DER, PrivateFormat.PKCS8, PrivateFormat.TraditionalOpenSSL
    return {
        "rsa, pkcs8": own.private_bytes(der, pkcs8, NoEncryption()),
        "rsa, pkcs1": own.private_bytes(der, older, NoEncryption()),
        "rsa, under a password": own.private_bytes(der, pkcs8, password),
        "curve, pkcs8": curve.private_bytes(der, pkcs8, NoEncryption()),
        "curve, sec1": curve.private_bytes(der, older, NoEncryption()),
        "curve, under a password": curve.private_bytes(der, pkcs8, password),
        "ed25519": edwards.private_bytes(der, pkcs8, NoEncryption()),
        "pkcs12": serialize_key_and_certificates(b"k", own, None, None, NoEncryption()),
        "pkcs12, under a password": serialize_key_and_certificates(b"k", own, None, None, password),
        "dsa": dsa.generate_private_key(1024).private_bytes(der, older, NoEncryption()),
        "rsa, short": bytes.fromhex("3082025d020100028181"),  # libraries make none of 1024 bits any more
        "gpg": bytes.fromhex("9503980469292bd5010800"),
        "gpg, newer": bytes.fromhex("c558046929 2bd516"),
        "dropbear": b"\0\0\0\x0bssh-ed25519\0\0\0\x40" + bytes(64),
        "git-crypt": b"\0GITCRYPTKEY\0\0\0\2",
    }


TEXT_KEYS = {
    "ssh.com": "---- BEGIN SSH2 ENCRYPTED PRIVATE KEY ----\nComment: x\n",
    "putty": "PuTTY-User-Key-File-3: ssh-ed25519\nEncryption: none\n",
    "age": "# created: 2026-01-01T00:00:00Z\nAGE-SECRET-KEY-1QQPQQ\n",
    "wireguard": f"[Interface]\nPrivateKey = {'q' * 43}=\n",
    "networkmanager": f"[wireguard]\nprivate-key={'q' * 43}=\n",
    "openvpn": "#\n# 2048 bit OpenVPN static key\n-----BEGIN OpenVPN Static key V1-----\n",
    "minisign": "untrusted comment: minisign encrypted secret key\nRWRTY0Iy\n",
    "gnupg": "Created: 20260101T000000\nKey: (protected-private-key (rsa (n #00",
    "gnupg, older": "(21:protected-private-key(3:rsa(1:n",
    "jwk": '{"kty": "OKP", "crv": "Ed25519", "d": "nWGxne_9WmC6hEr0kuwsxERJxWl7MmkZcDusAxyuf2A"}',
    "ssh, the first": "SSH PRIVATE KEY FILE FORMAT 1.1\n",
    "bind": "Private-key-format: v1.3\n",
}


def test_a_private_key_is_known_in_forms_of_its_own(here: Path) -> None:
    keys = {**binary_keys(), **{name: text.encode() for name, text in TEXT_KEYS.items()}, "java": b"\xfe\xed\xfe\xed\0"}
    for number, content in enumerate(keys.values()):
        Path(f"parts/key{number:02}").write_bytes(content)
    public = rsa.generate_private_key(65537, 2048).public_key()
    Path("parts/public.der").write_bytes(public.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo))
    Path("parts/public.conf").write_text(f"[Peer]\nPublicKey = {'q' * 43}=\nPrivateKey = PRIVATE\n")
    Path("parts/public.pub").write_text("untrusted comment: minisign public key 0123\nRWQ\n")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: ["./parts:/p"]').replace("MORE", ""))
    assert asked() == [("a", f"parts/key{number:02}") for number in range(len(keys))], list(keys)


@pytest.mark.parametrize("ahead", [0, 1, 2])
@pytest.mark.parametrize("line", [0, 60, 64, 76])
def test_a_private_key_is_known_in_base64_and_in_wide_letters(here: Path, ahead: int, line: int) -> None:
    """Kubectl keeps them so in its settings, and builds in variables; editors of other systems write UTF-16."""
    own = ec.generate_private_key(ec.SECP256R1())
    pem = own.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    der = own.private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption())
    public = own.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)

    def written(content: bytes) -> str:
        text = base64.b64encode(content).decode()
        return "\n    ".join(text[at : at + (line or len(text))] for at in range(0, len(text), line or len(text)))

    Path("parts/config").write_text(f"users:\n- user:\n    client-key-data: |\n    {written(b'#' * ahead + pem)}\n")
    Path("parts/env").write_text(f"SSH_KEY={written(der)}\n")
    Path("parts/wide").write_text(pem.decode(), encoding="utf-16")
    Path("parts/wider").write_text(pem.decode(), encoding="utf-16-be")
    Path("parts/public").write_text(f"certificate: {written(b'#' * ahead + public)}\n")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: ["./parts:/p"]').replace("MORE", ""))
    assert asked() == [("a", f"parts/{name}") for name in ("config", "env", "wide", "wider")]


def test_the_file_of_a_secret_is_shipped_to_no_other_service_unasked(here: Path) -> None:
    Path("parts/token").write_text("a token")
    services = 'a: {image: x, volumes: ["./parts:/parts"]}, b: {image: x, secrets: [t]}'
    Path("e.edf").write_text(f"edf: 1\nname: nav\nservices: {{{services}}}\nsecrets: {{t: {{file: parts/token}}}}\n")
    assert asked() == [("a", "parts/token")]


def test_no_byte_of_a_secret_is_read_for_it(here: Path) -> None:
    """An EDF may name any file as a secret's, and guess what is in it."""
    for name in ("../key", "parts/guess"):
        Path(name).write_text("a key")
    Path("e.edf").write_text(
        EDF.replace("SHIPS", 'secrets: [t], volumes: ["./parts:/parts"]').replace(
            "MORE", "secrets: {t: {file: ../key}}"
        )
    )
    assert asked() == []


def test_a_plan_is_refused_until_it_is_allowed(here: Path) -> None:
    world = World().add("r1", "r2")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: [".:/ws"]').replace("MORE", ""))
    own: Inventory = replace(robots_of(world), own_files=load_inventory(["inventory.yml"]).own_files)
    with remembering_all(world), Gathering(own, world.reader) as look:
        with pytest.raises(RefusedError, match=r"a: outside \(.*/lab/inventory\.yml\)"):
            make_plan(load_experiment("e.edf"), look, PlanRequest(), Vault())
        made = make_plan(load_experiment("e.edf"), look, PlanRequest(allowed=("outside",)), Vault())
    assert [one.kind for one in made.plan.permissions] == ["outside"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("field.yml", "all: {hosts: {r9: {ansible_password: kuka-4712}}}\n"),
        ("inventory.yml~", HOSTS.replace("4711", "4710")),
        ("field.ini", "[arms]\nr9 ansible_ssh_pass=kuka-4712\n"),
        ("field.json", '{"_meta": {"hostvars": {"r9": {"ansible_become_pass" : "kuka-4712"}}}}\n'),
        ("host_vars", "'ansible_ssh_password': kuka-4712\n"),
        ("group_vars", "---\nansible_ssh_private_key_passphrase: kuka-4712\n"),
        ("field.py", "for one in hosts.values():\n    one['ansible_password'] = 'kuka-4712'\n"),
        ("field.sh", 'echo "{\\"ansible_password\\": \\"kuka-4712\\"}"\n'),
    ],
)
def test_a_password_of_robots_is_known_by_its_word_in_whatever_file(here: Path, name: str, text: str) -> None:
    """The user has another inventory than the one at hand, or an editor keeps what one was."""
    Path("parts/README").write_text("ansible_password is the variable of the login's; see ansible_become_password\n")
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: ["./parts:/ws"]').replace("MORE", ""))
    assert asked() == []
    Path("parts", name).write_text(text)
    assert asked() == [("a", f"parts/{name}")]
    Path("parts", name).unlink()
    Path("parts", "large").write_text("x" * (7 << 20) + text)  # an inventory of 10,000 robots has some MiB
    assert asked() == [("a", "parts/large")]


def test_the_file_of_a_secret_stays_one_in_the_next_version_of_the_edf(here: Path) -> None:
    """It was allowed for one service; then the project is pulled, and its EDF mounts the folder and names no secret."""
    Path("parts/token").write_text("a token")
    secret = "a: {image: x, secrets: [t]}}\nsecrets: {t: {file: parts/token}}\n"
    ships = 'a: {image: x, volumes: ["./parts:/parts"]}}\n'
    for text, allowed in ((ships, ()), (secret, ("secret",))):
        Path("e.edf").write_text(f"edf: 1\nname: nav\nservices: {{{text}")
        assert asked() == []
        read_secrets(load_experiment("e.edf"), allowed)
    Path("e.edf").write_text(f"edf: 1\nname: nav\nservices: {{{ships}")
    assert asked() == [("a", "parts/token")]
    with pytest.raises(RefusedError, match="parts/token"):
        permit_copies(load_experiment("e.edf"), ())


@pytest.mark.parametrize(
    ("service", "more"),
    [
        ("image: x, secrets: [t, u]", ", u: {env: NOBODY_HAS_THIS}"),
        ("image: x, secrets: [t, u]", ", u: {file: parts/nowhere}"),
        ("cdf: ../elsewhere.cdf, secrets: [t]", ""),
        ("cdf: {git: 'https://host.example/a.git', path: a.cdf}, secrets: [t]", ""),
        ("image: x, secrets: [t], environment: [NOBODY_HAS_THIS]", ""),
        ("image: x, secrets: [t], no_such_key: 1", ", u: {file: [1]}, v: 1"),
    ],
)
def test_the_file_of_a_secret_is_one_also_where_the_run_that_was_allowed_it_failed(
    here: Path, service: str, more: str
) -> None:
    """Whoever writes the EDF has its first version fail: by a mistake, or by what its user does not allow."""
    Path("parts/token").write_text("a token")
    Path("../elsewhere.cdf").write_text("cdf: 1\nimage: x\n")
    secrets = f"secrets: {{t: {{file: parts/token}}{more}}}\n"
    Path("e.edf").write_text(f"edf: 1\nname: nav\nservices: {{a: {{{service}}}}}\n{secrets}")
    with pytest.raises((DefinitionError, RefusedError)):
        read_secrets(read_definitions("e.edf", ("secret",)), ("secret",))
    Path("e.edf").write_text('edf: 1\nname: nav\nservices: {a: {image: x, volumes: ["./parts:/parts"]}}\n')
    assert asked() == [("a", "parts/token")]


def test_what_nobody_allowed_makes_no_file_one_of_a_secret(here: Path) -> None:
    """Any EDF could name any file, and other experiments would have to ask for it."""
    Path("parts/token").write_text("a token")
    secrets = "a: {image: x, secrets: [t]}}\nsecrets: {t: {file: parts/token}}\n"
    Path("e.edf").write_text(f"edf: 1\nname: nav\nservices: {{{secrets}")
    with pytest.raises(RefusedError):
        read_secrets(read_definitions("e.edf", ("secret-command",)), ("secret-command",))
    Path("e.edf").write_text('edf: 1\nname: nav\nservices: {a: {image: x, volumes: ["./parts:/parts"]}}\n')
    assert asked() == []


def test_a_file_of_a_secret_is_known_by_another_name_that_the_disk_has_for_it(here: Path) -> None:
    """Disks of Windows have one in any case; here a hard link is one."""
    for name in ("keys", "parts"):
        Path(name).mkdir(exist_ok=True)
    Path("keys/token").write_text("a token")
    Path("parts/TOKEN").hardlink_to("keys/token")
    services = 'a: {image: x, volumes: ["./parts:/parts"]}, b: {image: x, secrets: [t]}'
    Path("e.edf").write_text(f"edf: 1\nname: nav\nservices: {{{services}}}\nsecrets: {{t: {{file: keys/token}}}}\n")
    assert asked() == [("a", "parts/TOKEN")]


@pytest.mark.parametrize("ships", ['volumes: [".:/ws"]', "data: [{path: ., target: /ws}]"])
def test_a_folder_that_nobody_may_look_into_hides_no_file_beside_it(
    here: Path, monkeypatch: pytest.MonkeyPatch, ships: str
) -> None:
    """A stranger's archive has a `CVS` that is closed to all: it is not shipped, and what lies beside it is."""
    opened = regular_file.real_folder

    def closed(path: str) -> contextlib.AbstractContextManager[int]:
        if os.path.basename(path) == "CVS":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return opened(path)

    monkeypatch.setattr(regular_file, "real_folder", closed)
    Path("CVS").mkdir(mode=0)
    Path("e.edf").write_text(EDF.replace("SHIPS", ships).replace("MORE", ""))
    assert asked() == [("a", "inventory.yml")]


def test_a_lock_has_no_hash_of_them_unasked(here: Path) -> None:
    """It is kept in git: whoever has the hash of all but a password tries words until one fits."""
    Path("e.edf").write_text(EDF.replace("SHIPS", 'volumes: [".:/ws"]').replace("MORE", ""))
    Path(".git").mkdir()
    Path(".git/config").write_text("[remote]\nurl = https://me:mine@git.example/lab\n")
    robots = load_inventory(["inventory.yml"])
    with pytest.raises(RefusedError, match=r"outside \(.*/inventory\.yml\)"):
        draft("e.edf", Lock(), (), (), robots)
    assert set(draft("e.edf", Lock(), (), {"outside"}, robots).files) == {"e.edf", "inventory.yml"}
