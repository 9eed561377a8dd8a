"""What a plan asks for, on its way to who is asked: the experiment chooses its secrets, and none hides a line of it."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from srprov.cli.execute import confirm
from srprov.cli.main import show_error
from srprov.cli.output import clean
from srprov.cli.plan import show_plan
from srprov.definitions.secretmodel import SecretSource
from srprov.errors import RefusedError
from srprov.planning.markdown import plan_markdown
from srprov.planning.plan import DataMove, Plan, Step, plan_json
from srprov.planning.policy import Permission, require
from srprov.resource import Action, Change, Difference
from srprov.secret import Secret, forget
from srprov.wire import STOP_MARGIN_S, EngineCall

PASSWORD = "hunter2-is-a-password"
PATH = "/usr/local/bin (root may run or believe what is written there)"
MOVED = "data of nav (maps) is copied from robot1 to robot2"
PERMISSIONS = (
    Permission(kind="host-path", service="nav", what="/srv/data"),
    Permission(kind="host-path", service="nav", what=PATH),
)
STEP = Step(
    number=1, host="robot1", module="container", name="srprov.nav.nav",
    change=Change(action=Action.REPLACE, cause=f"it said {PASSWORD}"),
    differences=(Difference(field="environment.KEY", old="none", new=PASSWORD),),
)  # fmt: skip
PLAN = Plan(
    instance="nav", source="here", steps=(STEP,), permissions=PERMISSIONS,
    secrets=(SecretSource(name="key", file="/home/user/.ssh/id_lab"), SecretSource(name="token", file="/nav/token")),
    data=(DataMove(service="nav", volume="maps", source="robot1", target="robot2", how="move"),),
    assignment={"nav": "robot1"}, unreachable={"robot3": f"no login with {PASSWORD}"},
    notes=("the lock has a commit to which its branch does not lead",),
)  # fmt: skip


@pytest.fixture(autouse=True)
def _secrets() -> Iterator[None]:
    """A stranger's secrets are lines of the plan, with and without their ends; the last one is the user's own."""
    forget()
    for line in (
        f"  ! host-path      nav: {PATH}", "  key    from the file /home/user/.ssh/id_lab", f"  ! {MOVED}",
        "  nav -> robot1", "note: the lock has a commit to which its branch does not lead", "root may run or believe",
        f"- asks for **host\\-path**: nav: {PATH}", "; nav: host-path (/usr/local/bin", PATH, "srprov.nav.nav",
    ):  # fmt: skip
        Secret(f"\n{line}")
        Secret(line)
    Secret(PASSWORD)
    yield
    forget()


def test_no_secret_hides_what_a_plan_asks_for(capsys: pytest.CaptureFixture[str]) -> None:
    show_plan(PLAN, None, verbose=True)
    lines = capsys.readouterr().out.splitlines()
    for line in (
        "  ! host-path      nav: /srv/data", f"  ! host-path      nav: {PATH}", f"  ! {MOVED}",
        "  key    from the file /home/user/.ssh/id_lab", "  nav -> robot1",
        "note: the lock has a commit to which its branch does not lead",
        "  ± #1 container srprov.nav.nav: it said ***", "      environment.KEY: none -> ***",
        "unreachable: robot3: no login with ***",
    ):  # fmt: skip
        assert line in lines


def test_no_secret_hides_it_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    show_plan(PLAN, plan_json(PLAN), verbose=False)
    text = capsys.readouterr().out
    made = json.loads(text)
    assert PASSWORD not in text
    assert [one["what"] for one in made["permissions"]] == ["/srv/data", PATH]
    assert made["secrets"]["key"] == {"file": "/home/user/.ssh/id_lab"}
    assert made["notes"] == list(PLAN.notes)


def test_no_secret_hides_it_in_markdown() -> None:
    """Which reviewers of a pull request read."""
    text, whole = plan_markdown(PLAN, hide=clean), plan_markdown(PLAN)
    assert PASSWORD not in text
    for shown in (PASSWORD, PASSWORD.replace("-", "\\-")):
        whole = whole.replace(shown, "***")
    assert text == whole


def test_no_secret_hides_what_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RefusedError) as refused:
        require(PERMISSIONS, ())
    show_error(refused.value)
    assert f"nav: host-path (/srv/data); nav: host-path ({PATH})" in capsys.readouterr().err


def test_no_secret_hides_what_is_said_beside_a_plan(capsys: pytest.CaptureFixture[str]) -> None:
    for word in ("--allow", "Its hash", "1 to replace", "asks for 60 s", "to stop and is killed"):
        Secret(word)
    with pytest.raises(RefusedError) as refused:
        require(PERMISSIONS, ())
    show_error(refused.value)
    show_plan(PLAN, None, verbose=False, reviewed=True)
    show_plan(PLAN, plan_json(PLAN), verbose=False)
    stop = EngineCall(method="POST", path="/containers/srprov.nav.nav/stop", timeout_s=60.0 + STOP_MARGIN_S)
    confirm(replace(PLAN, steps=(replace(STEP, change=replace(STEP.change, commands=(stop,))),)), True, 10.0)
    shown = capsys.readouterr()
    assert "  if you trust it: --allow host-path\n" in shown.err
    assert "\nIts hash, for `apply --expect`: " in shown.out
    assert "Plan: 1 to replace; 0 unchanged." in shown.err.splitlines()
    assert "warning:  on robot1 asks for 60 s to stop and is killed after 10 s" in shown.err


def test_a_value_of_several_lines_is_hidden_where_values_are(capsys: pytest.CaptureFixture[str]) -> None:
    Secret("first-line-of-it\nsecond-line-of-it")
    diff = Difference(field="command", diff=("+first-line-of-it", "+second-line-of-it"))
    show_plan(replace(PLAN, steps=(replace(STEP, differences=(diff,)),)), None, verbose=True)
    shown = capsys.readouterr().out
    assert "line-of-it" not in shown
    assert "  nav -> robot1" in shown.splitlines()
