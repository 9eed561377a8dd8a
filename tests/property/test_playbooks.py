"""Laws for any playbooks of users, wherever they stand and whatever their robots hold already; on robots in memory.

applied playbooks leave an empty plan, and a second apply sends nothing but questions
an item acts after every item above it that acts, and `before` playbooks act before any container
after a failure at any command, the next apply ends where an undisturbed one would have
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from hypothesis import given, note, settings
from hypothesis import strategies as st

from srprov.definitions.playbook import read
from srprov.definitions.playbookmodel import ADDED, AFTER, BEFORE, Playbook
from srprov.execution import RunOptions
from srprov.planning.plan import Plan
from srprov.planning.text import plan_text
from tests.conftest import examples
from tests.fakes import Fault, World
from tests.worlds import Experiment, experiment, plan_for, run, service

FAST = RunOptions(settle_s=0.0, forks=1)
LIMITS = settings(derandomize=True, deadline=None, max_examples=examples(40))
PLACES = {BEFORE: "first.yml", ADDED: "35-mine.yml", AFTER: "last.yml"}


@st.composite
def items(draw: st.DrawFn, place: str) -> list[str]:
    """Return some items of one playbook; each may need those above it."""
    written: list[str] = []
    above: list[str] = []
    for number in range(draw(st.integers(0, 3))):
        name = f"{place}{draw(st.sampled_from('zyxwv'))}{number}"
        needs = sorted(draw(st.sets(st.sampled_from(above), max_size=2))) if above else []
        if draw(st.booleans()):
            identity, text = (
                f"command:{name}",
                f"- command: {name}\n  argv: [touch, /opt/{name}]\n  creates: /opt/{name}\n",
            )
        else:
            path = f"/var/lib/srprov/hello/{name}"
            identity, text = f"file:{path}", f"- file: {path}\n  content: {draw(st.sampled_from(['a', 'b']))}\n"
        written.append(text + (f"  needs: {needs}\n" if needs else ""))
        above.append(identity)
    return written


PLAYBOOKS = st.fixed_dictionaries({place: items(place) for place in PLACES})


def of(written: dict[str, list[str]]) -> tuple[Experiment, tuple[Playbook, ...]]:
    """Return the experiment with its playbooks, and the user's own."""
    made: dict[str, Playbook] = {}
    with tempfile.TemporaryDirectory() as folder:
        for place, name in PLACES.items():
            file = Path(folder) / name
            file.write_text("".join(written[place]))
            made[place] = read(str(file), name, name, place)
    services = (service("a", robot="r1"), service("b", robot="r2", depends_on={"a": "started"}))
    return experiment(*services, playbooks=(made[BEFORE], made[AFTER])), (made[ADDED],)


def planned(world: World, written: dict[str, list[str]]) -> Plan:
    """Plan with permission."""
    what, own = of(written)
    return plan_for(world, what, allowed=frozenset({"playbook"}), playbooks=own)


def world_with(marks: set[str]) -> World:
    """Return two robots, on which some commands' work is done already."""
    world = World().add("r1", "r2")
    for robot in world.robots.values():
        robot.disk.marks |= marks
    return world


MARKS = st.sets(st.sampled_from([f"/opt/{p}{w}{n}" for p in PLACES for w in "zyxwv" for n in range(3)]), max_size=12)


@LIMITS
@given(old=PLAYBOOKS, written=PLAYBOOKS, marks=MARKS)
def test_applied_playbooks_leave_nothing_to_do(
    old: dict[str, list[str]], written: dict[str, list[str]], marks: set[str]
) -> None:
    """Over any older version of them; what acts does so in the order in which it stands."""
    world = world_with(marks)
    assert run(world, planned(world, old), FAST).exit_code == 0
    plan = planned(world, written)
    note(plan_text(plan))
    numbers = {step.id: step.number for step in plan.steps if step.want}
    for host in ("r1", "r2"):
        mine = [f"{host}/{text.split(chr(10))[0][2:].replace(': ', ':')}" for p in PLACES for text in written[p]]
        acting = [numbers[one] for one in mine if one in numbers]
        assert acting == sorted(acting)
    assert run(world, plan, FAST).exit_code == 0
    assert planned(world, written).empty
    before = len(world.done())
    assert run(world, planned(world, written), FAST).exit_code == 0
    assert len(world.done()) == before


@LIMITS
@given(written=PLAYBOOKS, marks=MARKS, at=st.integers(1, 25), how=st.sampled_from(["refuse", "lost", "lost-after"]))
def test_a_failure_is_healed_by_the_next_apply(
    written: dict[str, list[str]], marks: set[str], at: int, how: str
) -> None:
    """Whichever command fails, the robots end as they would have."""
    calm, world = world_with(marks), world_with(marks)
    assert run(calm, planned(calm, written), FAST).exit_code == 0
    world.fault = Fault(at=at, how=how)
    run(world, planned(world, written), FAST)
    world.fault = None
    for robot in world.robots.values():
        robot.gone = False
    assert run(world, planned(world, written), FAST).exit_code == 0
    assert planned(world, written).empty
    kept = [{name: robot.disk.files.keys() for name, robot in one.robots.items()} for one in (calm, world)]
    assert kept[0] == kept[1]
    assert [robot.disk.marks for robot in calm.robots.values()] == [robot.disk.marks for robot in world.robots.values()]
