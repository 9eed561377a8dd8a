"""A user's playbook may say anything of a robot, and use up nothing of the controller."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.definitions.playbook import read
from srprov.definitions.playbookmodel import ADDED, Playbook
from srprov.rendering import limited
from srprov.rendering.limited import Rendered, render_texts
from tests.bounded import bounded

CONTEXT = {"host": "r1", "services": ["a"], "instance": "hello"}


def playbook(folder: Path, text: str) -> Playbook:
    file = folder / "p.yml"
    file.write_text(text)
    return read(str(file), "p.yml", "p.yml", ADDED)


def of(folder: Path, expression: str) -> Rendered:
    (found,) = render_texts([(playbook(folder, f"- file: /a\n  content: {{{{ {expression} }}}}\n"), CONTEXT)])
    return found


def test_texts_come_in_the_order_of_the_jobs(tmp_path: Path) -> None:
    one = playbook(tmp_path, "- file: {{ '/' ~ host }}\n  content: a\n")
    found = render_texts([(one, {**CONTEXT, "host": name}) for name in ("r1", "r2")])
    assert ['"/r1"' in found[0].text.replace("\\", ""), '"/r2"' in found[1].text.replace("\\", "")] == [True, True]
    assert render_texts([]) == []


def test_a_fault_has_the_line_of_the_template(tmp_path: Path) -> None:
    assert of(tmp_path, "1 / 0") == Rendered(fault="division by zero", line=2)
    assert of(tmp_path, "services.nothing").fault.startswith("'list object' has no attribute")


@pytest.mark.parametrize(
    ("expression", "says"),
    [
        ("range(10**9) | list", "Range too big"),
        ("'x' * 10**9", "memory"),
        ("[0] * 10**10", "memory"),
        ("9**(9**9)", "too much to be rendered"),
        ("'%900000000d' | format(1)", "memory"),
        ("'{:900000000}'.format(1)", "memory"),
        ("'x' | center(10**9)", "memory"),
        ("('x' * 10**6 ~ 'y') * 3", "more than 1000000 characters"),
        ("'é' * 10**8", "memory"),
    ],
)
def test_one_expression_does_not_use_up_the_controller(tmp_path: Path, expression: str, says: str) -> None:
    found = bounded(lambda: of(tmp_path, expression))
    assert says in found.fault


def test_nested_loops_end_with_the_time_that_a_playbook_has(tmp_path: Path) -> None:
    """They neither print nor keep anything, so that nothing inside of the sandbox would notice."""
    loops = "".join(f"{{% for a{i} in [1,2,3,4,5,6,7,8,9,0] %}}\n" for i in range(15)) + "{% endfor %}\n" * 15
    first = playbook(tmp_path, "- file: /a\n  content: b\n")
    last = playbook(tmp_path, f"{loops}- file: /a\n  content: b\n")
    found = render_texts([(first, CONTEXT), (last, CONTEXT), (first, CONTEXT)])
    assert [bool(one.text) for one in found] == [True, False]
    assert "it computes for too long; the limits are 2 s of computing, 200 MiB of memory" in found[1].fault


def test_the_limits_hold_for_the_child_alone(tmp_path: Path) -> None:
    import resource

    before = [resource.getrlimit(which) for which in (resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_CORE)]
    assert of(tmp_path, "'x' * 10**9").fault
    assert before == [
        resource.getrlimit(which) for which in (resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_CORE)
    ]


def test_many_robots_have_more_time_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limited, "CPU_S", 0.5)
    one = playbook(tmp_path, "- file: /a\n  content: {{ host }}\n")
    assert len(render_texts([(one, CONTEXT)] * 1000)) == 1000
