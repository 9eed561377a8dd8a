"""Doing a plan: what comes of each step, and that one robot's trouble is not another's."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from srprov.definitions.model import Host
from srprov.execution import Outcome, RunOptions, RunResult, StepResult, conditions, run_plan
from srprov.facts import first_look
from srprov.planning.plan import Plan, Step
from srprov.resource import Action, Change
from srprov.wire import Command, EngineCall, EngineQuery, Reply
from tests.fakes import Behaviour, Fault, World
from tests.worlds import (
    CHECK,
    QUICK,
    Experiment,
    apply,
    events,
    experiment,
    plan_for,
    removal_for,
    run,
    service,
)

SETTLE = RunOptions(settle_s=0.05, wait_timeout_s=2.0)


@pytest.fixture(autouse=True)
def quick_polls(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Poll often: robots in memory answer at once."""
    monkeypatch.setattr(conditions, "_FIRST_PAUSE_S", 0.002)
    monkeypatch.setattr(conditions, "_LONGEST_PAUSE_S", 0.01)
    yield


def pair(**second: object) -> Experiment:
    """Return `a` on r1, and `b` on r2 that depends on it."""
    first = service("a", robot="r1", healthcheck=CHECK)
    return experiment(first, service("b", **{"robot": "r2", "depends_on": {"a": "started"}, **second}))


def world(*names: str) -> World:
    """Return robots, two if none is named."""
    return World().add(*(names or ("r1", "r2")))


def of(result: RunResult, identity: str) -> StepResult:
    """Return what came of one step, by the end of its id."""
    return next(one for one in result.results if one.step.id.endswith(identity))


def outcomes(result: RunResult) -> dict[str, Outcome]:
    """Return the outcome of containers by service."""
    return {one.step.service: one.outcome for one in result.results if one.step.service}


# -- before: what is found ---------------------------------------------------------------------------------------------


def test_everything_is_done_and_verified() -> None:
    """An ordinary run changes every step, and each robot is read before its first act and after each batch."""
    w = world()
    plan = plan_for(w, pair())
    w.log.clear()
    result, heard = events(w, plan)
    assert {one.outcome for one in result.results} == {Outcome.CHANGED}
    assert (result.exit_code, result.interrupted, result.unreachable) == (0, False, {})
    assert [one.step.number for one in result.results] == [step.number for step in plan.steps]
    for host in ("r1", "r2"):
        kinds = [entry.kind for entry in w.log if entry.host == host]
        assert (kinds[0], kinds[-1]) == ("ask", "ask")
    ends = [event.step for event in heard if event.kind == "end"]
    assert sorted(step.number for step in ends if step) == [step.number for step in plan.steps]


def test_somebody_was_faster() -> None:
    """A step whose end is there already sends nothing and is unchanged, not failed."""
    w = world()
    plan = plan_for(w, pair())
    assert run(w, plan).exit_code == 0
    sent = len(w.done())
    result = run(w, plan)
    assert {(one.outcome, one.message) for one in result.results} == {(Outcome.UNCHANGED, "somebody was faster")}
    assert (len(w.done()), result.exit_code) == (sent, 0)


def test_a_removal_that_somebody_did_is_unchanged() -> None:
    """What should go and is gone already is right."""
    w = world()
    apply(w, pair())
    plan = removal_for(w)
    assert run(w, plan).exit_code == 0
    assert {one.outcome for one in run(w, plan).results} == {Outcome.UNCHANGED}


def test_a_bridge_that_a_crashed_engine_left_goes_with_its_network() -> None:
    """The next apply makes the network on it, and the engine never removes a bridge that was there before."""
    w, what = world("r1"), experiment(service("a"), service("b"))
    robot = w.robots["r1"]
    assert apply(w, what).exit_code == 0
    assert run(w, removal_for(w)).exit_code == 0
    assert robot.kernel.links == {}
    plan = plan_for(w, what)
    bridge = next(step.want.params.bridge for step in plan.steps if step.module == "network" and step.want)
    robot.kernel.add_bridge(bridge, 1500)
    assert run(w, plan).exit_code == 0
    assert run(w, removal_for(w)).exit_code == 0
    assert robot.kernel.links == {}


def test_a_robot_that_moved_is_stale() -> None:
    """If another change is due than the planned one, the step fails, says what is due now, and does nothing."""
    w = world("r1")
    what = experiment(service("a"))
    apply(w, what)
    w.robots["r1"].engine.containers["srprov.hello.a"].state = "exited"
    plan = plan_for(w, what)
    w.robots["r1"].engine.containers["srprov.hello.a"].state = "paused"
    sent = len(w.done())
    result = run(w, plan)
    (one,) = result.results
    assert one.outcome is Outcome.FAILED
    assert one.message == "the robot changed since the plan was made: now paused; plan again"
    assert (len(w.done()), result.exit_code) == (sent, 3)


# -- the act -----------------------------------------------------------------------------------------------------------


def test_a_failed_command_names_itself_and_what_was_said() -> None:
    """A failure shows the command, its status and the robot's words; what needs it is skipped and names it."""
    w = world()
    w.robots["r1"].engine.unpullable.add("busybox:latest")
    result = run(w, plan_for(w, pair()))
    image = of(result, "r1/image:busybox:latest")
    assert image.outcome is Outcome.FAILED
    said, command = image.message.split("\n")
    assert said.startswith("manifest for")
    assert command == "  status 404 of POST /images/create?fromImage=busybox&tag=latest"
    assert outcomes(result) == {"a": Outcome.SKIPPED, "b": Outcome.SKIPPED}
    assert of(result, "hello.a").message == "needs #1 (r1/image:busybox:latest), which failed"
    assert of(result, "hello.b").message.endswith("(r1/container:srprov.hello.a), which was skipped")
    assert of(result, "r2/network:srprov.hello").outcome is Outcome.CHANGED
    assert result.exit_code == 3


def test_a_process_that_dies_at_once_did_not_converge() -> None:
    """Docker says started, the look afterwards says exited: the step failed, with code and last words."""
    w = world("r1")
    w.robots["r1"].engine.behaviours["a"] = Behaviour(exits=7, log="loading\nno such topic\n")
    result = run(w, plan_for(w, experiment(service("a"))))
    assert of(result, "hello.a").outcome is Outcome.FAILED
    assert of(result, "hello.a").message == (
        "did not converge: exited with code 7\n  its last lines:\n    loading\n    no such topic"
    )


def test_a_command_without_effect_did_not_converge() -> None:
    """What a robot accepts and does not do is found out by looking, not believed."""
    w = world("r1")
    robot = w.robots["r1"]
    robot.disk.put = lambda _put: None  # type: ignore[method-assign]
    result = run(w, plan_for(w, experiment(service("a", network="none"))))
    hosts = of(result, "/hello/hosts")
    assert (hosts.outcome, hosts.message) == (Outcome.FAILED, "did not converge: not there")


# -- robots that go away -----------------------------------------------------------------------------------------------


def test_a_robot_lost_in_the_middle_stops_nobody_else() -> None:
    """The lost robot's steps are unreachable, those that need them are skipped, the others are done."""
    w = World().add("r1", "r2", "r3")
    what = experiment(*pair().services.values(), service("c", robot="r3"))
    plan = plan_for(w, what)
    w.robots["r1"].fault = Fault(at=2, how="lost")
    result = run(w, plan)
    assert outcomes(result) == {"a": Outcome.UNREACHABLE, "b": Outcome.SKIPPED, "c": Outcome.CHANGED}
    assert of(result, "hello.b").message.endswith("which could not be reached")
    assert result.unreachable == {"r1": "the connection was lost [SRP-310]"}
    assert result.exit_code == 4
    w.robots["r1"].gone = False
    w.robots["r1"].fault = None
    assert apply(w, what).exit_code == 0


def test_a_robot_that_was_never_there_is_unreachable() -> None:
    """A plan may hold steps on a robot without a connection; they say so."""
    w = world()
    plan = plan_for(w, pair())
    w.robots["r1"].gone = True
    result = run(w, plan)
    assert of(result, "r1/network:srprov.hello").outcome is Outcome.UNREACHABLE
    assert of(result, "r1/network:srprov.hello").message == "no connection"
    assert outcomes(result)["b"] is Outcome.SKIPPED


@pytest.mark.parametrize("when", ["before", "after"])
def test_an_engine_that_does_not_answer_is_not_an_empty_one(when: str) -> None:
    """A moved service does not start elsewhere while nobody knows whether its old container still runs."""
    w = world()
    apply(w, experiment(service("a", robot="r1"), service("b", robot="r2")))
    plan = plan_for(w, experiment(service("a", robot="r2"), service("b", robot="r2")))
    engine = w.robots["r1"].engine
    if when == "before":
        engine.down = True
    else:

        def down_after_stop(command: Command) -> None:
            engine.down = isinstance(command, EngineCall) and command.path.endswith("/stop")

        w.robots["r1"].before_command = down_after_stop
    result = run(w, plan)
    removal = of(result, "r1/container:srprov.hello.a")
    assert removal.outcome in (Outcome.UNREACHABLE, Outcome.FAILED)
    assert "did not answer" in removal.message or "closed the connection" in removal.message
    assert of(result, "r2/container:srprov.hello.a").outcome is Outcome.SKIPPED
    assert ("a", "r2") not in w.running()


def test_an_engine_that_dies_before_the_last_look_leaves_the_end_unknown() -> None:
    """What was commanded and could not be seen afterwards is unreachable, not changed."""
    w = world("r1")
    robot = w.robots["r1"]

    def down_for_ever(_command: Command) -> None:
        if robot.commands >= 4:
            robot.engine.query = lambda _query: conditions_reply()  # type: ignore[method-assign]

    def conditions_reply() -> object:
        from srprov.wire import Reply

        return Reply(status=0, ok=False, err="no engine")

    robot.before_command = down_for_ever
    result = run(w, plan_for(w, experiment(service("a"))))
    assert {one.outcome for one in result.results} == {Outcome.UNREACHABLE}
    assert "its state cannot be read: no engine" in result.results[0].message


# -- settling ----------------------------------------------------------------------------------------------------------


def test_a_service_that_dies_while_settling_failed() -> None:
    """A service that ran when it was verified and is gone two looks later is failed, with code and last words."""
    w = world("r1")
    w.robots["r1"].engine.behaviours["a"] = Behaviour(exits=1, lives=1, log="out of memory\n")
    result, heard = events(w, plan_for(w, experiment(service("a"))), SETTLE)
    one = of(result, "hello.a")
    assert one.outcome is Outcome.FAILED
    assert one.message == "did not stay up: exited with code 1\n  its last lines:\n    out of memory"
    assert result.exit_code == 3
    assert [event.outcome for event in heard if event.kind == "end" and event.step == one.step] == [
        Outcome.CHANGED,
        Outcome.FAILED,
    ]


def test_a_job_may_end_while_settling() -> None:
    """A job that exits with 0 is right, and one that exits with 3 is not."""
    for code, outcome in ((0, Outcome.CHANGED), (3, Outcome.FAILED)):
        w = world("r1")
        w.robots["r1"].engine.behaviours["a"] = Behaviour(exits=code, lives=1)
        result = run(w, plan_for(w, experiment(service("a", job=True))), SETTLE)
        assert of(result, "hello.a").outcome is outcome


def test_settling_waits_only_for_fresh_services() -> None:
    """Without a container that was started there is nothing to wait for; zero seconds switch it off."""
    w = world("r1")
    what = experiment(service("a"))
    apply(w, what)
    w.robots["r1"].disk.files.pop("/var/lib/srprov/hello/placement.json")
    began = time.monotonic()
    assert run(w, plan_for(w, what), RunOptions(settle_s=30.0)).exit_code == 0
    assert run(w, removal_for(w), RunOptions(settle_s=30.0)).exit_code == 0
    assert apply(w, what, RunOptions(settle_s=0.0)).exit_code == 0
    assert time.monotonic() - began < 10


def test_a_robot_lost_while_settling_is_unreachable() -> None:
    """If nobody can look any more, the service is neither up nor failed."""
    w = world("r1")
    robot = w.robots["r1"]
    plan = plan_for(w, experiment(service("a")))

    def heard(event: object) -> None:
        robot.gone = robot.gone or "stay up" in getattr(event, "text", "")

    result = run_plan(plan, w.sessions(), heard, SETTLE)
    assert of(result, "hello.a").outcome is Outcome.UNREACHABLE
    assert result.exit_code == 4


# -- waiting -----------------------------------------------------------------------------------------------------------


def test_a_healthy_dependency_is_awaited() -> None:
    """A dependent starts only after its dependency was seen healthy, on whichever robot."""
    w = world()
    w.robots["r1"].engine.behaviours["a"] = Behaviour(healthy_after=4)
    assert apply(w, pair(depends_on={"a": "healthy"})).exit_code == 0
    (start,) = [entry for entry in w.log if entry.kind == "started" and entry.host == "r2"]
    assert start.seen["r1/srprov.hello.a"] == ("running 0", "healthy")


def test_a_completed_dependency_is_awaited() -> None:
    """A dependent of a job starts only after the job exited with 0."""
    w = world()
    w.robots["r1"].engine.behaviours["a"] = Behaviour(exits=0, lives=5)
    what = experiment(service("a", robot="r1", job=True), service("b", robot="r2", depends_on={"a": "completed"}))
    assert apply(w, what).exit_code == 0
    (start,) = [entry for entry in w.log if entry.kind == "started" and entry.host == "r2"]
    assert start.seen["r1/srprov.hello.a"] == ("exited 0", "")


@pytest.mark.parametrize(
    ("behaviour", "job", "condition", "says"),
    [
        (Behaviour(healthy_after=-1), False, "healthy", "srprov.hello.a is unhealthy: connection refused"),
        (Behaviour(healthy_after=9999), False, "healthy", "was not healthy within 0 s"),
        (Behaviour(healthy_after=9999, exits=5, lives=3), False, "healthy", "exited with code 5 before it was healthy"),
        (Behaviour(exits=3, lives=3), True, "completed", "srprov.hello.a exited with code 3"),
        (Behaviour(), True, "completed", "was not completed within 0 s"),
    ],
)
def test_what_never_holds_skips_with_its_reason(behaviour: Behaviour, job: bool, condition: str, says: str) -> None:
    """A condition that cannot hold any more, or not in time, skips the dependent and says why."""
    w = world()
    w.robots["r1"].engine.behaviours["a"] = behaviour
    first = service("a", robot="r1", job=job, healthcheck=None if job else CHECK)
    what = experiment(first, service("b", robot="r2", depends_on={"a": condition}))
    result = run(w, plan_for(w, what), RunOptions(settle_s=0, wait_timeout_s=0.1))
    assert outcomes(result) == {"a": Outcome.CHANGED, "b": Outcome.SKIPPED}
    assert says in of(result, "hello.b").message
    assert result.exit_code == 3


def test_a_dependency_that_somebody_removed_is_not_awaited() -> None:
    """A container that is not there at all will not become healthy; that is known at once."""
    w = world()
    what = pair(depends_on={"a": "healthy"})
    apply(w, what)
    w.robots["r2"].engine.containers.clear()
    plan = plan_for(w, what)
    w.robots["r1"].engine.containers.clear()
    began = time.monotonic()
    result = run(w, plan, RunOptions(settle_s=0, wait_timeout_s=60))
    assert "container srprov.hello.a is not there" in of(result, "hello.b").message
    assert time.monotonic() - began < 10


def test_a_dependency_on_a_lost_robot_skips() -> None:
    """Waiting for a robot that is gone, before or meanwhile, ends with its name."""
    w = world()
    what = pair(depends_on={"a": "healthy"})
    apply(w, what)
    w.robots["r2"].engine.containers.clear()
    plan = plan_for(w, what)
    w.robots["r1"].gone = True
    assert "but r1 is unreachable" in of(run(w, plan), "hello.b").message
    sessions = w.robots
    result = run_plan(plan, sessions, lambda _event: None, QUICK)
    assert "healthy: the connection was lost" in of(result, "hello.b").message


@pytest.mark.parametrize(
    "body",
    [
        "null",
        "[]",
        "{}",
        '{"State": 5}',
        '{"State": {"Health": 5}}',
        '{"State": {"Status": "running", "Health": []}}',
        '{"State": {"Status": [], "Health": {"Status": "unhealthy", "Log": [5]}}}',
        "no json",
    ],
)
def test_garbage_while_waiting_ends_by_the_deadline(body: str) -> None:
    """A robot that answers nonsense about a container's health is waited for and then given up, never a crash."""
    from srprov.wire import Reply

    w = world()
    what = pair(depends_on={"a": "healthy"})
    apply(w, what)
    w.robots["r2"].engine.containers.clear()
    plan = plan_for(w, what)
    engine, known = w.robots["r1"].engine, w.robots["r1"].engine.query

    def query(one: EngineQuery) -> Reply:
        return Reply(status=200, out=body) if one.path.startswith("/containers/srprov") else known(one)

    engine.query = query  # type: ignore[method-assign]
    result = run(w, plan, RunOptions(settle_s=0, wait_timeout_s=0.05))
    assert of(result, "hello.b").outcome is Outcome.SKIPPED


def test_waiting_is_told() -> None:
    """Who waits for longer than a second is told what for."""
    heard: list[str] = []
    w = world()
    apply(w, pair())
    from srprov.resource import Need

    w.robots["r1"].engine.behaviours["a"] = Behaviour(healthy_after=9999)
    need = Need("r1/container:srprov.hello.a", "healthy")
    why = conditions.wait_for(need, w.robots["r1"], deadline_s=1.2, stop=threading.Event(), say=heard.append)
    assert why == "r1/container:srprov.hello.a was not healthy within 1 s"
    assert heard == ["waiting 1 s for r1/container:srprov.hello.a to be healthy"]


# -- interrupts and parallelism ----------------------------------------------------------------------------------------


def test_a_stop_lets_the_running_step_end() -> None:
    """After the stop no further step begins; the one that ran is verified, the rest was not reached."""
    w = world("r1")
    stop = threading.Event()
    plan = plan_for(w, experiment(service("a")))
    w.robots["r1"].before_command = lambda _command: stop.set()
    result = run_plan(plan, w.sessions(), lambda _event: None, QUICK, stop)
    assert [one.outcome for one in result.results] == [Outcome.CHANGED] + [Outcome.NOT_REACHED] * 6
    assert (result.exit_code, result.interrupted) == (130, True)
    assert result.results[1].message == "interrupted"


def test_a_stop_before_the_start_does_nothing() -> None:
    """Nothing is asked of any robot when the stop came first."""
    w = world()
    plan = plan_for(w, pair())
    stop = threading.Event()
    stop.set()
    w.log.clear()
    result = run_plan(plan, w.sessions(), lambda _event: None, QUICK, stop)
    assert {one.outcome for one in result.results} == {Outcome.NOT_REACHED}
    assert w.log == []


def test_a_stop_ends_a_wait() -> None:
    """Who waits for health is woken by the stop, and was not reached: what it waited for did nothing wrong."""
    w = world()
    w.robots["r1"].engine.behaviours["a"] = Behaviour(healthy_after=9999)
    plan = plan_for(w, pair(depends_on={"a": "healthy"}))
    stop = threading.Event()
    timer = threading.Timer(0.2, stop.set)
    timer.start()
    began = time.monotonic()
    options = RunOptions(settle_s=0, wait_timeout_s=60)
    result = run_plan(plan, w.sessions(), lambda _event: None, options, stop)
    assert time.monotonic() - began < 10
    assert outcomes(result) == {"a": Outcome.CHANGED, "b": Outcome.NOT_REACHED}
    assert result.exit_code == 130


def barrier(w: World, timeout: float) -> Callable[[Command], None]:
    """Return a hook that holds the first command of each of two robots until both are there."""
    gate, passed = threading.Barrier(2), set()

    def hold(_command: Command) -> None:
        me = threading.current_thread().ident
        if me not in passed:
            passed.add(me)
            gate.wait(timeout)

    for robot in w.robots.values():
        robot.before_command = hold
    return hold


def test_two_robots_work_at_the_same_time() -> None:
    """A gate that opens only when two robots stand before it opens."""
    w = world()
    plan = plan_for(w, experiment(service("a", robot="r1"), service("b", robot="r2")))
    barrier(w, 10)
    assert run(w, plan).exit_code == 0


def test_one_fork_works_on_one_robot_at_a_time() -> None:
    """With one fork no two robots are ever worked on at once, and dependencies across robots still come to an end."""
    w = world()
    busy: list[str] = []

    def watch(host: str) -> Callable[[Command], None]:
        def note(_command: Command) -> None:
            busy.append(host)
            time.sleep(0.001)
            assert busy.pop() == host and not busy

        return note

    for name, robot in w.robots.items():
        robot.before_command = watch(name)
    w.robots["r1"].engine.behaviours["a"] = Behaviour(healthy_after=3)
    result = apply(w, pair(depends_on={"a": "healthy"}), RunOptions(settle_s=0, forks=1, wait_timeout_s=5))
    assert result.exit_code == 0


def test_one_robot_is_never_worked_on_twice_at_once() -> None:
    """Steps of one robot run one after the other, although batches of it wait for others."""
    w = World().add("r1", "r2", "r3")
    names = "abcdef"
    services = [
        service(name, robot=f"r{i % 3 + 1}", depends_on={names[i - 1]: "started"} if i % 2 else {})
        for i, name in enumerate(names)
    ]
    inside: dict[str, int] = {}
    most: dict[str, int] = {}
    lock = threading.Lock()

    def watch(host: str) -> Callable[[Command], None]:
        def note(_command: Command) -> None:
            with lock:
                inside[host] = inside.get(host, 0) + 1
                most[host] = max(most.get(host, 0), inside[host])
            time.sleep(0.001)
            with lock:
                inside[host] -= 1

        return note

    for name, robot in w.robots.items():
        robot.before_command = watch(name)
    assert apply(w, experiment(*services)).exit_code == 0
    assert most == {"r1": 1, "r2": 1, "r3": 1}


def test_an_image_is_copied_between_robots() -> None:
    """A copy needs the robot that has it; if that one lost it meanwhile, the copy fails with its name."""
    from srprov.wire import CopyImage

    w = world()
    w.robots["r1"].engine.images["srprov/x:0123"] = {}
    copy = CopyImage(image="srprov/x:0123", source_host="r1")
    assert w.robots["r2"].execute(copy).ok
    w.robots["r1"].engine.images.clear()
    assert "r1: its engine cannot give" in w.robots["r2"].execute(copy).err


# -- the exit code -----------------------------------------------------------------------------------------------------

STEP = Step(number=1, host="r1", module="volume", name="v", change=Change(action=Action.CREATE, cause="not there"))


@pytest.mark.parametrize(
    ("outcomes_", "interrupted", "unreachable", "code"),
    [
        ([], False, {}, 0),
        ([Outcome.CHANGED, Outcome.UNCHANGED], False, {}, 0),
        ([Outcome.CHANGED], True, {}, 130),
        ([Outcome.FAILED], True, {"r": "x"}, 130),
        ([Outcome.FAILED, Outcome.UNREACHABLE], False, {"r": "x"}, 3),
        ([Outcome.CHANGED, Outcome.SKIPPED, Outcome.UNREACHABLE], False, {}, 4),
        ([Outcome.CHANGED], False, {"r": "gone"}, 4),
        ([Outcome.SKIPPED], False, {}, 3),
        ([Outcome.NOT_REACHED], False, {}, 3),
    ],
)
def test_exit_codes(outcomes_: list[Outcome], interrupted: bool, unreachable: dict[str, str], code: int) -> None:
    """The first that applies: interrupted 130, failed 3, unreachable 4, left out 3, else 0."""
    results = tuple(StepResult(step=STEP, outcome=one) for one in outcomes_)
    result = RunResult(results=results, unchanged=0, interrupted=interrupted, unreachable=unreachable)
    assert result.exit_code == code


def test_an_empty_plan_touches_no_robot() -> None:
    """Nothing to do means that nobody is even asked."""
    w = world()
    result = run(w, Plan(instance="hello", source="s", steps=(), unchanged=5))
    assert (w.log, result.exit_code, result.unchanged) == ([], 0, 5)


def test_no_round_trip_per_step() -> None:
    """A robot is asked as often for twelve steps as for seven: before and after a batch, never per step."""
    asked = {}
    for names in ("a", "abcdef"):
        w = world("r1")
        plan = plan_for(w, experiment(*(service(name) for name in names)))
        before = w.robots["r1"].traffic.round_trips
        run(w, plan)
        asked[len(plan.steps)] = w.robots["r1"].traffic.round_trips - before - len(w.done())
    assert list(asked) == [7, 12]
    assert asked[7] == asked[12] <= 4


def test_a_failure_says_what_was_said_in_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A build may print lines of any length, and a container's log too: messages stay as long as can be read."""
    world = World().add("a")
    line = "y" * 65_536
    monkeypatch.setattr(
        type(world.robots["a"]), "_execute", lambda *_: Reply(status=500, ok=False, err=f"{line}\n" * 90)
    )
    result = run(world, plan_for(world, experiment(service("one"))))
    failed = [one for one in result.results if one.outcome is Outcome.FAILED]
    assert failed and all(100 < len(one.message) < 20_000 for one in failed)


def test_what_parsing_raises_is_that_robot_s_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """The others go on, also where the robot is one that is left out."""
    world = World().add("a", "b")
    parse = first_look.parse_host

    def surprised(host: Host, *words: object, **more: object) -> object:
        if host.name == "b":
            raise KeyError("nobody thought of it")
        return parse(host, *words, **more)

    monkeypatch.setattr(first_look, "parse_host", surprised)
    plan = plan_for(world, experiment(service("one", robot="a")))
    assert plan.assignment == {"one": "a"} and "KeyError" in plan.unreachable["b"]
