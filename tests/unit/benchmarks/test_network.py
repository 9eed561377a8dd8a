"""The pure parts of the network benchmark: a wrong loss or a shell that mixes answers up would be believed."""

from __future__ import annotations

import json
import os
import socket
import statistics
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks import dispersion
from benchmarks.network import compare, delay, measures, plots, quote, table
from benchmarks.network.link import LINKS
from benchmarks.network.shell import opened
from benchmarks.network.ways import Ends
from benchmarks.provisioning.quote import replaced
from benchmarks.provisioning.robots import Trouble

TARGET = measures.Target("10.0.0.2", 21002, 21003, 1450)


def test_deviation_and_variation_are_those_of_the_sample_and_failures_are_counted() -> None:
    one = dispersion.spread([10.0, None, 12.0, 14.0])
    assert one is not None
    assert (one.count, one.failed, one.mean, one.deviation) == (3, 1, 12.0, 2.0)
    assert one.variation == pytest.approx(2 / 12)
    assert dispersion.spread([1.0, None]) is None


def test_a_loss_compares_what_was_measured_in_the_same_block() -> None:
    base, other = [100.0, 200.0, 300.0, 400.0], [90.0, 190.0, None, 390.0]
    found = dispersion.loss(base, other)
    assert found is not None
    assert found[0] == pytest.approx(100 * 10 / statistics.fmean([100, 200, 400]))
    assert found[1] == pytest.approx(0.0, abs=1e-9), "each pair differs by as much, so the loss is certain"
    assert dispersion.loss([1.0, 2.0], [None, 1.0]) is None


def test_the_papers_means_follow_from_its_tables_and_give_its_losses_within_their_noise() -> None:
    for measure, (*_, said) in table.PAPER.items():
        one, _, (percent, half) = table.paper(measure)
        assert abs(percent - said) < half, measure
        assert one.mean == pytest.approx(
            {"TCP_RR": 446, "UDP_RR": 434, "TCP_STREAM": 97.4, "UDP_STREAM": 102}[measure], 0.01
        )


def test_headers_alone_cost_what_they_cost_in_full_frames() -> None:
    mtus = {"native": 1500, "overlay": 1450, "wireguard": 1374}
    assert table.least("TCP_STREAM", "overlay", mtus) == pytest.approx(100 * 50 / 1448)
    assert table.least("UDP_STREAM", "overlay", mtus) == pytest.approx(100 * 50 / 1472)
    assert table.least("TCP_STREAM", "wireguard", mtus) == pytest.approx(100 * (1 - 1322 / 1498 / (1448 / 1514)))
    assert table.least("TCP_RR", "overlay", mtus) is None


def test_streams_over_the_limited_link_offer_udp_more_than_it_carries() -> None:
    said = measures.command("UDP_STREAM", TARGET, LINKS["limited"])
    assert "-u -b 131M" in said and "-l 1422" in said
    full = measures.command("UDP_STREAM", TARGET, LINKS["full"])
    assert "-b 0" in full and "-t 1" in full


def test_a_transaction_is_a_message_each_way() -> None:
    said = "tcp_lat:\n    latency   =  1120000 ns\n    msg_rate  =      892.8571 /sec\n"
    assert measures.value("TCP_RR", 0, said) == pytest.approx(446.43, abs=0.01)


def test_a_stream_counts_what_the_receiver_got() -> None:
    end = {"sum_sent": {"bits_per_second": 130e6}, "sum_received": {"bits_per_second": 98e6}}
    assert measures.value("UDP_STREAM", 0, "warning: size\n" + json.dumps({"end": end})) == 98.0


@pytest.mark.parametrize(
    ("measure", "code", "said"),
    [("TCP_RR", 124, ""), ("TCP_RR", 0, "no rate"), ("TCP_STREAM", 1, '{"error": "refused"}'), ("UDP_STREAM", 0, "{}")],
)
def test_what_is_no_answer_is_no_figure(measure: str, code: int, said: str) -> None:
    with pytest.raises(Trouble, match=measure):
        measures.value(measure, code, said)


def test_a_shell_gives_each_command_its_own_output_and_code() -> None:
    with opened(["sh"]) as shell:
        assert shell.run("echo a; echo b >&2; false") == (1, "a\nb\n")
        assert shell.run("printf c") == (0, "c")
        assert shell.run("cat") == (0, ""), "a command does not read what is written for the next one"
        with pytest.raises(Trouble, match="no end within"):
            shell.run("sleep 1", limit_s=0.05)


def test_a_cable_is_late_both_ways_and_keeps_the_order() -> None:
    (near, first), (second, far) = (socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in "ab")
    until, end = os.pipe()
    for one in (first, second):
        one.setblocking(False)
    cable = threading.Thread(target=delay.carry, args=((first.fileno(), second.fileno()), 0.05, until))
    cable.start()
    far.settimeout(5)
    near.settimeout(5)
    begun = time.monotonic()
    near.send(b"one")
    near.send(b"two")
    assert [far.recv(100), far.recv(100)] == [b"one", b"two"]
    assert 0.05 <= time.monotonic() - begun < 4
    far.send(b"back")
    assert near.recv(100) == b"back"
    os.close(end)
    cable.join(5)
    assert not cable.is_alive()
    os.close(until)
    for one in (near, first, second, far):
        one.close()


class Recorder:
    """A shell that answers as the programs do, and is interrupted after some commands."""

    def __init__(self, most: int = 10**6) -> None:
        self.most, self.commands = most, list[str]()

    def run(self, command: str, _limit_s: float) -> tuple[int, str]:
        if len(self.commands) == self.most:
            raise KeyboardInterrupt
        self.commands.append(command)
        return 0, "msg_rate = 892 /sec" if "qperf" in command else '{"end": {"sum_received": {"bits_per_second": 1e8}}}'


def blocks_of(monkeypatch: pytest.MonkeyPatch, most: int = 10**6, seed: int = 1) -> tuple[list[str], dict[str, Any]]:
    monkeypatch.setattr(compare.measure, "calm", lambda _: 1.0)
    shell: Any = Recorder(most)
    ends = Ends(shell, TARGET)
    return shell.commands, compare.blocks({"native": ends, "overlay": ends}, LINKS["limited"], 3, seed)


def test_a_block_has_each_measure_of_each_way_once_in_an_order_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    commands, found = blocks_of(monkeypatch)
    parts = [commands[at : at + 8] for at in (0, 8, 16)]
    assert sorted(parts[0]) == sorted(parts[1]) == sorted(parts[2])
    assert parts[0] != parts[1] != parts[2]
    assert commands == blocks_of(monkeypatch)[0] != blocks_of(monkeypatch, seed=2)[0]
    assert found["values"]["TCP_RR"] == {"native": [446.0] * 3, "overlay": [446.0] * 3}


def test_what_is_interrupted_keeps_its_whole_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    _, found = blocks_of(monkeypatch, most=12)
    assert found["repeat"] == 1
    assert {len(values) for ways in found["values"].values() for values in ways.values()} == {1}


VALUES = {
    measure: {"native": [100.0, 102.0, 98.0], "overlay": [96.0, 98.0, 94.0], "swarm": [90.0, None, 91.0]}
    for measure in measures.MEASURES
}
MTUS = {"native": 1500, "overlay": 1450, "swarm": 1450}


def test_the_table_has_the_papers_rows_beside_ours_where_the_link_is_like_the_papers() -> None:
    lines = table.table(table.rows(VALUES, MTUS, LINKS["limited"]), beside=True).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    (ours,) = [line for line in lines if line.startswith("| TCP_STREAM, container, srprov's overlay |")]
    assert "| 4.00 ± 0.00 | 3.45 |" in ours
    (theirs,) = [line for line in lines if line.startswith("| *TCP_STREAM, the paper, container*")]
    assert "| 1.12 ± 3.5" in theirs
    (failed,) = [line for line in lines if line.startswith("| UDP_RR, container, Docker Swarm's overlay |")]
    assert "| 2, 1 failed |" in failed
    full = table.table(table.rows(VALUES, MTUS, LINKS["full"]), beside=False)
    assert "the paper" not in full and "3.45" not in full


def test_a_loss_above_the_papers_is_called_so_and_headers_are_named_where_they_alone_cost_more() -> None:
    values = {measure: {"native": [100.0, 102.0], "overlay": [95.0, 97.0]} for measure in measures.MEASURES}
    values["TCP_RR"]["overlay"] = [90.0, 92.0]
    found = table.rows(values, MTUS, LINKS["limited"])
    said = {line.split(" | ")[0]: line.split(" | ")[-1] for line in table.verdicts(found).splitlines()}
    assert said["| UDP_STREAM"] == said["| UDP_RR"] == "at most the paper's |"
    assert said["| TCP_RR"] == "more than the paper's |"
    assert said["| TCP_STREAM"] == "more than the paper's, which is less than headers cost |"


def test_there_is_a_box_plot_of_all_measures(tmp_path: Path) -> None:
    plots.draw(VALUES, tmp_path / "plot.svg")
    assert "<svg" in (tmp_path / "plot.svg").read_text()


def test_docs_say_what_the_results_say() -> None:
    docs = quote.DOCS.read_text(encoding="utf-8")
    written = replaced(docs, quote.text(quote.RESULTS), quote.BEGIN, quote.END)
    assert written == docs, "python -m benchmarks.network.quote writes it anew"


def test_fewer_repetitions_than_the_papers_are_called_a_trial_run(tmp_path: Path) -> None:
    about = {"missing": {"wireguard": "not built"}, "mtus": MTUS, "repeat": 3, "seed": 1, "idle": 0.97, "seconds": 9}
    about |= {"date": "2026-11-22", "cpus": 2, "kernel": "6.18", "docker": "20.10", "programs": ["iperf3 3.12"]}
    found = {"limited": {**about, "problems": [], "values": VALUES}}
    (tmp_path / "network.json").write_text(json.dumps(found))
    said = quote.text(tmp_path)
    assert "A trial run" in said and "Not measured: `wireguard` (not built)" in said
    found["limited"]["repeat"] = 100
    (tmp_path / "network.json").write_text(json.dumps(found))
    assert "A trial run" not in quote.text(tmp_path)
