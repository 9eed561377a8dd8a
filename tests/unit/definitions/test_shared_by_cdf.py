"""A CDF may be a stranger's: whose data its service shares is the EDF's word."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions import load_experiment
from srprov.definitions.model import Definitions
from srprov.errors import DefinitionError

CDF = "cdf: 1\nname: {0}\nimage: busybox\nvolumes: ['config:/c']\n"
NAV = "  nav: {image: busybox, volumes: ['config:/config']}\n"


def load(folder: Path, services: str) -> Definitions:
    for name in ("one", "two"):
        (folder / f"{name}.cdf").write_text(CDF.format(name))
    (folder / "config").mkdir(exist_ok=True)
    (folder / "e.edf").write_text(f"edf: 1\nname: demo\nservices:\n{services}")
    return load_experiment(str(folder / "e.edf"))


@pytest.mark.parametrize(
    "services",
    [
        f"  lidar: {{cdf: one.cdf}}\n{NAV}",
        f"  lidar: {{cdf: one.cdf, volumes: ['other:/x']}}\n{NAV}",
        "  lidar: {cdf: one.cdf}\n  nav: {cdf: two.cdf}\n",
        "  lidar: {cdf: one.cdf}\n  nav: {cdf: two.cdf, volumes: ['config:/c']}\n",
        f"  lidar: {{cdf: one.cdf, volumes: [{{type: bind, source: config, target: /x}}]}}\n{NAV}",
    ],
)
def test_a_cdf_does_not_choose_whose_volume_it_shares(tmp_path: Path, services: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        load(tmp_path, services)
    (problem,) = caught.value.problems
    message = "the CDF of 'lidar' mounts the volume 'config', which 'nav' has"
    assert (problem.location.line, problem.message) == (4, message)


@pytest.mark.parametrize(
    "services",
    [
        f"  lidar: {{cdf: one.cdf, volumes: ['config:/c']}}\n{NAV}",
        f"  lidar: {{cdf: one.cdf, volumes: [{{type: volume, source: config, target: /c}}]}}\n{NAV}",
        "  lidar: {cdf: one.cdf}\n  nav: {cdf: one.cdf}\n",
        "  lidar: {cdf: one.cdf}\n  nav: {image: busybox, volumes: ['other:/c']}\n",
    ],
)
def test_what_the_edf_says_or_one_cdf_is_shared(tmp_path: Path, services: str) -> None:
    load(tmp_path, services)


@pytest.mark.parametrize("given", ["'config:/r:ro'", "{type: volume, source: config, target: /r, read_only: true}"])
@pytest.mark.parametrize("others", [NAV, ""])
def test_a_cdf_does_not_write_to_what_the_edf_has_it_read_alone(tmp_path: Path, given: str, others: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        load(tmp_path, f"  lidar: {{cdf: one.cdf, volumes: [{given}]}}\n{others}")
    (problem,) = caught.value.problems
    message = "the CDF of 'lidar' may write to the volume 'config', which the EDF has it read alone"
    assert (problem.location.line, problem.message) == (4, message)


@pytest.mark.parametrize(
    "volumes",
    [
        "'config:/c:ro'",  # at the same place the EDF's counts
        "'config:/r:ro', 'config:/w'",
        "'config:/r:rw'",
        "{type: volume, source: config, target: /r}",
    ],
)
def test_what_the_edf_has_it_write_to_or_lays_over_its_cdf_is_no_mistake(tmp_path: Path, volumes: str) -> None:
    load(tmp_path, f"  lidar: {{cdf: one.cdf, volumes: [{volumes}]}}\n{NAV}")


def test_which_volumes_a_cdf_alone_names_is_known(tmp_path: Path) -> None:
    services = load(tmp_path, "  a: {cdf: one.cdf, volumes: ['other:/x']}\n").experiment.services
    assert services["a"].by_cdf == {"config"}
    services = load(tmp_path, "  a: {cdf: one.cdf, volumes: ['config:/x:rw']}\n").experiment.services
    assert services["a"].by_cdf == set()
