"""Many guesses at what a file outside of the experiment's folder says: no message tells which of them is right."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import checked
from srprov.errors import Diagnostic

NAMES = [f"TOKEN_{letter}" for letter in "ABCDEFGHIJKLMNOP"]
PARAMETERS = f"parameters: {{{', '.join(f'{name}: [1, 2]' for name in NAMES)}}}\n"
MERGED = {
    "parameters": ("services: {a: {cdf: CDF}}\n" + PARAMETERS, "environment: {GUESS: x}"),
    "seeds": (
        "services: {a: {cdf: CDF}, z: {image: busybox, depends_on: [nobody]}}\n"
        f"volumes: {{{', '.join(f'{name}: {{seed: seed}}' for name in NAMES)}}}\n",
        "volumes: ['GUESS:/x']",
    ),
    "ports": (
        f"services: {{a: {{cdf: CDF, ports: [{', '.join(f'{8000 + n}:99' for n in range(16))}]}}}}\n",
        "ports: ['PORT:80']",
    ),
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("exp/seed", "mine"):
        (tmp_path / name).mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "exp")
    return tmp_path


def told(cdf: str, edf: str, says: str) -> set[Diagnostic]:
    Path("../mine/p.cdf").write_text(f"cdf: 1\nimage: busybox\n{says}\n")
    Path("t.cdf").write_text("cdf: 1\nextends: ../mine/p.cdf\n")
    Path("e.edf").write_text("edf: 1\nname: nav\n" + edf.replace("CDF", cdf))
    return set(checked(["e.edf"], outside=True)[0])


@pytest.mark.parametrize("cdf", ["../mine/p.cdf", "t.cdf"])
@pytest.mark.parametrize("kind", MERGED)
def test_no_place_tells_which_guess_is_right(here: Path, kind: str, cdf: str) -> None:
    edf, says = MERGED[kind]
    found = [told(cdf, edf, says.replace("GUESS", name).replace("PORT", f"{8000 + n}")) for n, name in enumerate(NAMES)]
    assert found[0] and all(one == found[0] for one in found)
    (one,) = (one for one in found[0] if "of which nothing is shown" in one.message)
    assert (one.location.file, one.location.line, one.path) == ("e.edf", 1, "")


def test_ports_that_a_cdf_in_the_folder_guesses_have_no_line(here: Path) -> None:
    Path("../mine/p.cdf").write_text("cdf: 1\nimage: busybox\nports: ['8003:80']\n")
    Path("t.cdf").write_text(
        f"cdf: 1\nextends: ../mine/p.cdf\nports: [{', '.join(f'{8000 + n}:99' for n in range(9))}]\n"
    )
    (one,) = checked(["t.cdf"], outside=True)[0]
    assert (one.location.line, one.path) == (1, "") and "of which nothing is shown" in one.message


def test_what_is_wrong_in_the_folder_alone_is_all_that_is_told_where_the_rest_fits(here: Path) -> None:
    edf = "services: {a: {cdf: CDF}, z: {image: busybox, depends_on: [nobody]}}\n"
    assert [one.message for one in told("../mine/p.cdf", edf, "")] == ["there is no service 'nobody'"]
