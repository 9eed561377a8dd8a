"""Errors that files alone do not bring about; the pages of their codes name these tests."""

from __future__ import annotations

import io
import socket
import sys
from types import SimpleNamespace
from typing import Any

import click
import pytest

from srprov.cli.execute import confirm, refuse_without_terminal
from srprov.codes import Code
from srprov.controller.compose_plan import edf_of
from srprov.controller.located import Located, Whereabouts
from srprov.errors import SrprovError
from srprov.lab import faults, machine
from srprov.pace import Pace
from srprov.transport.deadline import Deadline
from srprov.transport.image_shell import send
from srprov.transport.openssh.sockets import dial


def code_of(call: Any, *arguments: Any, **named: Any) -> Code:
    with pytest.raises(SrprovError) as caught:
        call(*arguments, **named)
    return caught.value.code


def test_a_program_of_the_lab_that_fails() -> None:
    assert code_of(machine.run, ["false"]) is Code.LAB_STUCK


def test_a_clock_of_the_lab_that_is_too_far_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "require_root", lambda: None)
    assert code_of(faults.set_clock, None, "robot1", 1e18) is Code.LAB_ORDER


def test_a_name_that_nobody_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_arguments: object, **_named: object) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    assert code_of(dial, "r1", "robot2.lan", 22, Deadline(5)) is Code.LOOKUP


def test_a_question_that_is_answered_with_no(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(click, "confirm", lambda *_question, **_named: False)
    plan: Any = SimpleNamespace(empty=False, steps=(), services=())
    monkeypatch.setattr("srprov.execution.options.hurried", lambda *_plan: ())
    assert code_of(confirm, plan, False, 10.0) is Code.NOT_CONFIRMED


def test_a_question_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n"))
    assert code_of(refuse_without_terminal, yes=False) is Code.NO_TERMINAL


def test_a_plan_of_nothing_that_is_exported() -> None:
    plan: Any = SimpleNamespace(inputs={}, plan=SimpleNamespace(source="anna@desk:/home/anna/e.edf"))
    assert code_of(edf_of, plan, "hello.plan") is Code.PLAN_MISFIT


def test_a_service_that_is_not_there_and_one_that_is_somewhere() -> None:
    stray = Located(service="talker", host="r1", container="hello-talker", stray=True)
    there = Whereabouts(instance="hello", services=(stray,), by_name={}, families={}, unreachable={})
    assert code_of(there.named, ["talkr"]) is Code.NOTHING_RUNS
    assert code_of(there.named, ["talker"]) is Code.DISPUTED


def test_an_image_that_gets_no_further() -> None:
    streams: Any = SimpleNamespace(write=lambda _data: 0, ended=True, reason=lambda: "its disk is full")
    assert code_of(send, "r1", streams, b"layer", Pace()) is Code.IMAGE_COPY
