"""The paper's cost function against numbers worked out by hand from its formulas."""

import pytest

from srprov.assignment.cost import at_slot, jain, load, terms
from srprov.definitions.model import Placement, Weights
from tests.unit.assignment.worlds import GIB, cost_terms, robot, service

CPU = Weights(cpu=1.0, memory=0.0, swap=0.0, bandwidth=0.0)
MEMORY = Weights(cpu=0.0, memory=1.0, swap=0.0, bandwidth=0.0)
SWAP = Weights(cpu=0.0, memory=0.0, swap=1.0, bandwidth=0.0)
BANDWIDTH = Weights(cpu=0.0, memory=0.0, swap=0.0, bandwidth=1.0)


@pytest.mark.parametrize(
    ("alpha", "weights", "facts", "expected"),
    [
        # alpha * beta^4, beta = load / CPUs
        (100, CPU, {"load1": 0.0, "cpus": 4}, 0.0),
        (100, CPU, {"load1": 2.0, "cpus": 4}, 6.25),
        (100, CPU, {"load1": 3.0, "cpus": 4}, 31.640625),
        (10, CPU, {"load1": 0.4, "cpus": 1}, 0.256),
        (100, CPU, {"load1": 4.0, "cpus": 4}, 100.0),
        (100, CPU, {"load1": 31.0, "cpus": 4}, 100.0),
        (0, CPU, {"load1": 4.0, "cpus": 4}, 0.0),
        # alpha * beta^4, beta = used / total
        (100, MEMORY, {"memory_total": 8 * GIB, "memory_available": 8 * GIB}, 0.0),
        (100, MEMORY, {"memory_total": 8 * GIB, "memory_available": 4 * GIB}, 6.25),
        (50, MEMORY, {"memory_total": 10 * GIB, "memory_available": 1 * GIB}, 32.805),
        (100, MEMORY, {"memory_total": 8 * GIB, "memory_available": 0}, 100.0),
        (100, MEMORY, {"memory_total": 0, "memory_available": 0}, 0.0),
        # alpha * beta, beta = used / total, 0 without swap
        (100, SWAP, {"swap_total": 0, "swap_free": 0}, 0.0),
        (100, SWAP, {"swap_total": 4 * GIB, "swap_free": 4 * GIB}, 0.0),
        (100, SWAP, {"swap_total": 4 * GIB, "swap_free": 3 * GIB}, 25.0),
        (30, SWAP, {"swap_total": 4 * GIB, "swap_free": 0}, 30.0),
        # alpha * (1 - beta)^4, beta = free / reference (1000 Mbit/s)
        (100, BANDWIDTH, {"speed_mbit": 1000.0}, 0.0),
        (100, BANDWIDTH, {"speed_mbit": 10000.0, "traffic_mbit": 500.0}, 0.0),
        (100, BANDWIDTH, {"speed_mbit": 1000.0, "traffic_mbit": 500.0}, 6.25),
        (100, BANDWIDTH, {"speed_mbit": 100.0}, 65.61),
        (100, BANDWIDTH, {"speed_mbit": 6.0}, 97.6215137296),
        (100, BANDWIDTH, {"speed_mbit": 100.0, "traffic_mbit": 130.0}, 100.0),
        (100, BANDWIDTH, {"speed_mbit": 0.0}, 0.0),
    ],
)
def test_each_term_is_the_papers(alpha: float, weights: Weights, facts: dict[str, float], expected: float) -> None:
    """Each term is the papers."""
    found = cost_terms(service("s", cost=alpha), robot("r", **facts), weights, Placement())
    assert found.total == pytest.approx(expected, abs=1e-12)


def test_the_terms_are_weighted_and_summed() -> None:
    """The terms are weighted and summed."""
    facts = robot(
        "r",
        load1=2.0,
        memory_total=10 * GIB,
        memory_available=2 * GIB,
        swap_total=10 * GIB,
        swap_free=7 * GIB,
        traffic_mbit=400.0,
    )
    found = cost_terms(service("s", cost=10), facts, Weights(cpu=0.4, memory=0.3, swap=0.2, bandwidth=0.1), Placement())
    # 10 * 0.5^4 * 0.4, 10 * 0.8^4 * 0.3, 10 * 0.3 * 0.2, 10 * (1 - 0.6)^4 * 0.1
    assert found.cpu == pytest.approx(0.25)
    assert found.memory == pytest.approx(1.2288)
    assert found.swap == pytest.approx(0.6)
    assert found.bandwidth == pytest.approx(0.0256)
    assert found.total == pytest.approx(2.1044)


def test_the_reference_bandwidth_is_the_experiments() -> None:
    """The reference bandwidth is the experiments."""
    facts = robot("r", speed_mbit=50.0)
    assert cost_terms(service("s"), facts, BANDWIDTH, Placement(bandwidth_reference_mbit=50.0)).total == 0.0
    half = cost_terms(service("s"), facts, BANDWIDTH, Placement(bandwidth_reference_mbit=100.0))
    assert half.total == pytest.approx(0.625)


def test_an_unknown_speed_counts_as_the_reference_and_is_said() -> None:
    """An unknown speed counts as the reference and is said."""
    found = load(robot("r", speed_mbit=0.0, traffic_mbit=700.0), 1000.0)
    assert found.bandwidth == 1.0
    assert "link speed unknown" in found.notes[0]
    assert load(robot("r"), 1000.0).notes == ()


@pytest.mark.parametrize(
    ("slot", "slots", "beta"), [(0, 4, 0.25), (1, 4, 0.5), (3, 4, 1.0), (1, 2, 0.75), (1, 1, 1.0), (9, 2, 1.0)]
)
def test_a_later_slot_raises_the_cpu_load_only(slot: int, slots: int, beta: float) -> None:
    """A later slot raises the cpu load only."""
    idle = load(robot("r", load1=1.0, memory_available=4 * GIB), 1000.0)
    raised = at_slot(idle, slot, slots)
    assert raised.cpu == beta
    assert (raised.memory, raised.swap, raised.bandwidth) == (idle.memory, idle.swap, idle.bandwidth)
    assert terms(100, raised, CPU).total == pytest.approx(100 * beta**4)


def test_the_number_of_slots_is_the_robots_else_the_experiments() -> None:
    """The number of slots is the robots else the experiments."""
    facts, placement = robot("r"), Placement(slots_per_robot=2)
    assert cost_terms(service("s"), facts, CPU, placement, slot=1).total == pytest.approx(0.625)
    assert cost_terms(service("s"), facts, CPU, placement, slot=1, slots=4).total == pytest.approx(0.0390625)


@pytest.mark.parametrize(
    ("costs", "expected"),
    [([1, 1, 1, 1], 1.0), ([1, 0, 0, 0], 0.25), ([3, 3, 0, 0], 0.5), ([1, 2, 3], 36 / 42), ([0, 0], 1.0), ([], 1.0)],
)
def test_jains_index(costs: list[float], expected: float) -> None:
    """Jains index."""
    assert jain(costs) == pytest.approx(expected)
