"""The pure parts of the provisioning benchmark: a wrong median or slope would be believed."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest

from benchmarks.provisioning import job, startup, stats, surface
from benchmarks.provisioning.fake_names import identity


def run(tool: str, seconds: float, scenario: str = "fresh", **more: Any) -> dict[str, Any]:
    about = {"robots": 12, "latency_ms": 0, "tool": tool, "scenario": scenario, "seconds": seconds, "problem": ""}
    return {**about, "cpu": 1.0, "rss_mib": 50.0, "sent": 1024, "received": 2048, **more}


def test_medians_are_per_tool_and_ratios_are_to_the_floor_of_the_same_scenario() -> None:
    rows = [run("srprov", s) for s in (3.0, 9.0, 4.0)] + [run("floor", s) for s in (1.0, 2.0, 8.0)]
    rows += [run("srprov", 1.0, "nothing"), run("floor", 0.5, "nothing")]
    found = {(row["scenario"], row["tool"]): row for row in stats.medians(rows)}
    assert found["fresh", "srprov"]["seconds"] == 4.0
    assert found["fresh", "srprov"]["ratio"] == 2.0
    assert (found["fresh", "floor"]["least"], found["fresh", "floor"]["most"]) == (1.0, 8.0)
    assert found["nothing", "srprov"]["ratio"] == 2.0


def test_a_failed_run_is_counted_and_its_time_is_not() -> None:
    found = stats.medians([run("a", 1.0), run("a", 0.01, problem="exit 1"), run("b", 0.01, problem="exit 1")])
    assert (found[0]["seconds"], found[0]["failed"], found[0]["runs"]) == (1.0, 1, 1)
    assert found[1]["seconds"] is None
    assert "| 1 of 1 |" in stats.table(found).splitlines()[-1]


def test_without_a_floor_there_is_no_ratio() -> None:
    assert stats.medians([run("srprov", 1.0)])[0]["ratio"] is None


def test_the_table_has_a_row_per_median_in_the_order_of_the_scenarios() -> None:
    text = stats.table(stats.medians([run("x", 2.0, "changed"), run("x", 1.0), run("x", 0.5, "nothing")]))
    assert [line.split(" | ")[2] for line in text.splitlines()[2:]] == ["fresh", "nothing", "changed"]
    assert len({line.count("|") for line in text.splitlines()}) == 1


def test_a_plane_is_found_again() -> None:
    points = [(x, y, 1.5 + 0.25 * x - 2.0 * y) for x in range(1, 5) for y in range(1, 4)]
    assert stats.plane(points) == pytest.approx((1.5, 0.25, -2.0))
    with pytest.raises(ValueError, match="plane"):
        stats.plane([(1, 1, 1), (2, 2, 2), (3, 3, 3)])


def test_a_line_is_found_again() -> None:
    assert stats.line([(100, 3.0), (300, 7.0), (1000, 21.0)]) == pytest.approx((1.0, 0.02))


def test_the_floors_script_is_shell_and_names_every_peer() -> None:
    whole = job.make([(f"robot{n}", f"10.213.0.{10 + n}") for n in range(1, 26)])
    for member in whole.members:
        script = job.floor_script(whole, member)
        assert subprocess.run(["sh", "-n"], input=script, text=True, timeout=10, check=False).returncode == 0
        assert sum(f"dst {other.underlay} self" in script for other in whole.members) == 24


def test_a_changed_job_differs_in_one_service() -> None:
    whole = job.make([("robot1", "10.213.0.11"), ("robot2", "10.213.0.12")])
    differing = [a for a, b in zip(whole.members, whole.changed.members, strict=True) if a != b]
    assert [member.robot for member in differing] == ["robot2"]
    assert job.config_hash(whole.members[1]) != job.config_hash(whole.changed.members[1])


def test_the_surface_leaves_failed_runs_out_and_gives_slopes() -> None:
    about = {"tool": "floor", "problem": ""}
    rows = [
        {**about, "robots": x, "services": y, "seconds": 1 + 0.1 * x + 0.5 * y} for x in (1, 6, 12) for y in (1, 6, 12)
    ]
    rows.append({**rows[0], "seconds": 99.0, "problem": "exit 1"})
    assert surface.slopes(surface.medians(rows)).splitlines()[-1] == "| floor | 1.000 | 0.1000 | 0.5000 | 1.60 | 8.20 |"


def test_start_up_times_are_multiples_of_the_first_command() -> None:
    assert (
        startup.table({"python": [0.01, 0.02, 0.03], "srprov": [0.1]}).splitlines()[-1] == "| `srprov` | 100.0 | 5.0 |"
    )


def test_simulated_robots_have_names_and_addresses_of_the_recorded_ones_length() -> None:
    found = [identity(number, "robot13") for number in range(2000)]
    assert {len(name) for name, _ in found} == {7}
    assert {len(address) for _, address in found} == {len("10.213.0.23")}
    assert len(set(found)) == len({name for name, _ in found}) == len({address for _, address in found}) == 2000


def test_what_srprov_reports_is_a_table_of_medians_per_phase() -> None:
    def report(facts: float) -> dict[str, Any]:
        sums = {"connections": 12, "round_trips": 36, "bytes_sent": 12288, "bytes_received": 1024}
        return {**sums, "phases": {"facts": facts, "plan": 0.1}, "duration_s": 1.0}

    rows = [run("srprov", 1.0, reported=report(facts)) for facts in (0.5, 0.25, 0.75)] + [
        run("floor", 1.0, reported={})
    ]
    lines = stats.phases(rows).splitlines()
    assert lines[2] == "| 12 | 0 ms | fresh | srprov | 0.50 | 0.10 | 1.00 | 1.0 | 3.0 | 12 | 1 |"
    assert len({line.count("|") for line in lines}) == 1
    assert stats.phases([run("floor", 1.0, reported={})]) == ""
