"""The pure parts of the images benchmark: wrong bytes or ratios would be believed."""

from __future__ import annotations

import gzip
import json
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import pytest

from benchmarks.images import compare, content, demo, link, quote, shell, table
from benchmarks.provisioning.quote import replaced


def run(tool: str, seconds: float, **more: Any) -> dict[str, Any]:
    about = {"robots": 12, "image_mib": 480, "link": "full", "case": "two", "tool": tool, "problem": ""}
    figures = {"cpu": 1.0, "rss_mib": 50.0, "sent": 24 << 20, "received": 2 << 20, "per_robot": 21 << 20}
    return {**about, "seconds": seconds, **figures, "missing": 20 << 20, **more}


def test_medians_are_per_case_and_ratios_are_to_save_and_load_of_the_same_case() -> None:
    rows = [run("thin", s) for s in (3.0, 9.0, 4.0)] + [run(table.MEASURE, 16.0), run("thin", 1.0, case="nothing")]
    found = {(row["case"], row["tool"]): row for row in table.medians(rows)}
    thin = found["two", "thin"]
    assert (thin["seconds"], thin["least"], thin["most"], thin["ratio"]) == (4.0, 3.0, 9.0, 0.25)
    assert thin["excess"] == pytest.approx(1.05)
    assert found["nothing", "thin"]["ratio"] is None


def test_a_failed_run_is_counted_and_its_figures_are_not() -> None:
    found = table.medians([run("a", 1.0), run("a", 0.01, problem="exit 1"), run("b", 0.01, problem="exit 1")])
    assert (found[0]["seconds"], found[0]["failed"], found[0]["runs"]) == (1.0, 1, 1)
    assert found[1]["seconds"] is None


def test_the_table_begins_with_the_full_link_and_has_a_row_per_median_in_the_order_of_the_cases() -> None:
    rows = [run("a", 1.0, link="50mbit"), run(table.MEASURE, 1.0), run("a", 2.0, case="fresh"), run("a", 1.0)]
    lines = table.table(table.medians(rows)).replace("\\|", "/").splitlines()
    assert [line.split(" | ")[2:5] for line in lines[2:]] == [
        ["full", "fresh", "a"],
        ["full", "two", table.MEASURE.replace("|", "/")],
        ["full", "two", "a"],
        ["50mbit", "two", "a"],
    ]
    assert len({line.count("|") for line in lines}) == 1


def test_what_nobody_lacked_is_no_divisor() -> None:
    assert table.medians([run("a", 1.0, case="nothing", missing=0)])[0]["excess"] is None


def test_a_layer_is_the_same_each_time_and_another_for_another_seed(tmp_path: Path) -> None:
    sizes = [content.write_layer(tmp_path / name, 1 << 20, seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))]
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b != c and len(a) >= 1 << 20
    assert sizes[0] == pytest.approx(len(gzip.compress(a, 1)), rel=0.01)
    with tarfile.open(tmp_path / "a") as archive:
        assert sum(member.size for member in archive) == 1 << 20


def test_a_context_has_its_dockerfile_and_its_layers(tmp_path: Path) -> None:
    content.write_layer(tmp_path / "1.tar", 1000, 1)
    content.context(tmp_path / "context", ["FROM busybox", "ADD 1.tar /"], [tmp_path / "1.tar"])
    with tarfile.open(tmp_path / "context") as archive:
        assert archive.getnames() == ["Dockerfile", "1.tar"]
        dockerfile = archive.extractfile("Dockerfile")
        assert dockerfile is not None and dockerfile.read() == b"FROM busybox\nADD 1.tar /\n"


def test_a_link_is_full_or_a_rate() -> None:
    assert (link.rate("full"), link.rate("50mbit"), link.rate("800kbit")) == ("", "50mbit", "800kbit")
    for word in ("", "50", "50mbit; reboot", "0mbit"):
        with pytest.raises(ValueError, match="neither"):
            link.rate(word)


@pytest.mark.parametrize("script", [shell.LOOP, shell.PARALLEL % "", shell.PULL % {"registry": "10.0.0.1:5001"}])
def test_the_scripts_are_bash(script: str) -> None:
    head = shell.HEAD.format(image="bench/robot:1", builder="10.0.0.1", targets="10.0.0.2", ssh=shell.SSH)
    assert subprocess.run(["bash", "-n"], input=head + script, text=True, timeout=10, check=False).returncode == 0


def test_what_is_measured_again_replaces_its_earlier_runs(tmp_path: Path) -> None:
    file = tmp_path / "images.json"
    assert compare.kept(file, [run("a", 1.0)]) == []
    file.write_text(json.dumps({"runs": [run("a", 1.0), run("a", 2.0, link="50mbit"), run("b", 3.0)]}))
    assert compare.kept(file, [run("a", 9.0)]) == [run("a", 2.0, link="50mbit"), run("b", 3.0)]


def test_the_docs_say_what_was_measured() -> None:
    for name, part in quote.parts(quote.measured(quote.RESULTS), quote.measured(quote.RESULTS, "demo")).items():
        text = (quote.ROOT / name).read_text(encoding="utf-8")
        assert replaced(text, part, quote.BEGIN, quote.END) == text, "python -m benchmarks.images.quote writes it anew"


def test_the_demos_job_is_in_the_docs_alone_with_both_ways_side_by_side() -> None:
    runs = [
        {"way": way, "case": case, "seconds": seconds, "copies": seconds / 4, "bytes": 2**20}
        for way, seconds in (("thin", 3.0), ("thin", 4.0), ("thin", 90.0), ("whole", 8.0))
        for case in demo.CASES
    ]
    parts = quote.parts([], demo.medians(runs))
    assert parts["README.md"] == ""
    assert "| top layers changed, all of it | 4.0 s | 8.0 s | 0.50 |" in parts["docs/images.md"].splitlines()


def test_the_readme_has_most_robots_at_full_speed_and_the_docs_have_all() -> None:
    labs = [{"robots": 1}, {"robots": 12}, {"robots": 40, "image_mib": 120, "link": "50mbit"}]
    parts = quote.parts(table.medians(run(tool, 2.0, **lab) for lab in labs for tool in ("a", table.MEASURE)))
    heads = [line.split(" | ")[0] for line in parts["docs/images.md"].splitlines() if "MiB, " in line[:30]]
    assert heads == [
        "| 1 robot, 480 MiB, the lab's full speed",
        "| 12 robots, 480 MiB, the lab's full speed",
        "| 40 robots, 120 MiB, 50 Mbit/s for all together",
    ]
    assert parts["README.md"].splitlines()[-2:] == [
        "| a | 2.0 s, 26.0 MiB |",
        "| save \\| load, at once | 2.0 s, 26.0 MiB |",
    ]
    assert "12 robots" in parts["README.md"] and "40 robots" not in parts["README.md"]
