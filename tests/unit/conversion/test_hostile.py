"""Projects of other tools that want to keep the importer busy: read in two seconds, or refused."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from srprov import regular_file
from srprov.conversion.compose import Wanted, draft
from srprov.conversion.experiment import MOST_SERVICES
from srprov.conversion.project import Making
from srprov.conversion.subnets import Subnets
from srprov.errors import UsageError
from tests.bounded import bounded

CONSTRAINT = "node.hostname == r1" + " " * 200_000 + "x"


def wanted(folder: Path, text: str) -> Wanted:
    """Return the import of a file."""
    (folder / "compose.yml").write_text(text)
    return Wanted(files=[str(folder / "compose.yml")], folder=str(folder / "new"))


def test_blanks_in_a_constraint_are_read_in_time(tmp_path: Path) -> None:
    """They could be the value's, or stand behind it."""
    text = f"services: {{a: {{image: x, deploy: {{placement: {{constraints: ['{CONSTRAINT}']}}}}}}}}\n"
    made = wanted(tmp_path, text)
    assert bounded(lambda: len(draft(made).edf["services"])) == 1


def test_services_that_could_name_each_other_are_read_in_time(tmp_path: Path) -> None:
    """The words of all others are gathered once."""
    words = " ".join(f"w{n}" for n in range(60))
    one = "  s{n}: {{image: x, command: '{words}'}}\n"
    made = wanted(tmp_path, "services:\n" + "".join(one.format(n=n, words=words) for n in range(MOST_SERVICES)))
    assert bounded(lambda: len(draft(made).edf["services"])) == MOST_SERVICES


def test_more_services_than_an_instance_has_are_refused(tmp_path: Path) -> None:
    """Each is compared with all others."""
    made = wanted(tmp_path, "services:\n" + "".join(f"  s{n}: {{image: x}}\n" for n in range(MOST_SERVICES + 1)))
    with pytest.raises(UsageError, match=f"{MOST_SERVICES + 1} services"):
        bounded(lambda: draft(made).edf)


def test_files_of_secrets_are_looked_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not once more for each service that names a file of variables."""
    (tmp_path / "l.env").write_text("A=1\n")
    services = "".join(f"  s{n}: {{image: x, env_file: [l.env]}}\n" for n in range(200))
    secrets = "".join(f"  t{n}: {{file: ./t{n}}}\n" for n in range(500))
    made = wanted(tmp_path, f"services:\n{services}secrets:\n{secrets}")
    looked: list[None] = []
    identities = regular_file.identities

    def counted(paths: Iterable[str]) -> set[tuple[int, int]]:
        given = list(paths)
        looked.extend(None for _ in given)
        return identities(given)

    monkeypatch.setattr(regular_file, "identities", counted)
    assert len(draft(made).edf["services"]) == 200
    assert len(looked) < 3000


def test_subnets_are_read_once_and_an_address_is_looked_for_in_all_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hosts = ", ".join(f"'h{n}:10.{n}.0.7'" for n in range(100))
    services = "".join(f"  s{n}: {{image: x, networks: [n], extra_hosts: [{hosts}]}}\n" for n in range(20))
    subnets = ", ".join(f"{{subnet: 10.{n}.0.0/24}}" for n in range(0, 200, 2))
    made = wanted(tmp_path, f"services:\n{services}networks: {{n: {{ipam: {{config: [{subnets}]}}}}}}\n")
    read: list[object] = []
    network = ipaddress.ip_network
    monkeypatch.setattr(ipaddress, "ip_network", lambda *given: read.append(given) or network(*given))
    monkeypatch.setattr(ipaddress.IPv4Network, "__contains__", lambda *_: read.append("in"))
    found = draft(made).edf["services"]
    assert found["s0"]["extra_hosts"] == sorted(f"h{n}=10.{n}.0.7" for n in range(1, 100, 2))
    assert len(read) < 300


def test_an_address_is_in_a_subnet_of_its_version() -> None:
    configs = [{"subnet": one} for one in ("10.1.0.0/24", "10.1.0.0/16", "fd00::/64", "::/128", "no", "10.1.0.1/8")]
    found = Subnets.of({"n": {"ipam": {"config": configs}}, "none": None})
    assert all(map(found.have, ("10.1.0.0", "10.1.255.255", "fd00::1", "fd00::ffff:ffff:ffff:ffff", "::")))
    assert not any(map(found.have, ("10.2.0.0", "10.0.255.255", "fd00:0:0:1::", "::1", "0.0.0.0", "host-gateway")))


class Taken(set[str]):
    """Names that are looked up, and never gone through."""

    def __iter__(self) -> Iterator[str]:
        """Say no."""
        raise AssertionError("gone through")


def test_names_that_are_taken_are_not_gone_through_for_each() -> None:
    making = Making("lab")
    assert making.free("a", "", Taken({"a", "a-2"}), Taken({"a-3"})) == "a-4"
    assert making.free("a", "r1", Taken({"a"})) == "a-r1"


def test_thousands_of_things_of_one_name_are_refused(tmp_path: Path) -> None:
    mounts = "".join(f"      - '/v/{chr(0x4E00 + n)}'\n" for n in range(1100))
    with pytest.raises(UsageError, match="more than 1000 things would be called 'a-v'"):
        draft(wanted(tmp_path, f"services:\n  a:\n    image: x\n    volumes:\n{mounts}"))


def test_one_secret_of_many_services_is_found_at_once(tmp_path: Path) -> None:
    services = "".join(f"  s{n}: {{image: x, secrets: [t1, t2]}}\n" for n in range(5))
    made = draft(wanted(tmp_path, f"services:\n{services}secrets: {{t1: {{file: ./k}}, t2: {{file: ./l}}}}\n"))
    assert sorted(made.edf["secrets"]) == ["t1", "t2"]
