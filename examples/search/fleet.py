"""What robots and base tell each other: the messages, their topics, and how a process ends."""

import os
import signal
import threading
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, sequence
from cyclonedds.topic import Topic
from cyclonedds.util import duration

MEMBERS = int(os.environ["MEMBERS"])
SEED = int(os.environ["SRPROV_SEED"])
SECOND = 1 / float(os.environ["SPEEDUP"])
"""Real seconds that a simulated one takes."""

RELIABLE = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll, Policy.Durability.TransientLocal
)
"""Nothing is lost, and who is found late is told all."""

stopping = threading.Event()
for number in (signal.SIGTERM, signal.SIGINT):
    signal.signal(number, lambda *_: stopping.set())


@dataclass
class Report(IdlStruct, typename="search.Report"):
    """What a robot says after each step."""

    robot: int32
    second: int32
    """Simulated, since the start; 0 before."""
    x: int32
    y: int32
    seen: sequence[int32]
    """Cells that it has seen first, as far as it knows: y * SIZE + x."""
    heard: sequence[int32]
    """Robots that it has heard so far."""
    found: bool


@dataclass
class Go(IdlStruct, typename="search.Go"):
    """What the base says when all have heard each other."""

    members: int32


def join() -> tuple[DomainParticipant, Topic[Report], Topic[Go]]:
    """Enter domain 0, where everybody is found by multicast, and return the topics."""
    participant = DomainParticipant()
    return participant, Topic(participant, "search/report", Report), Topic(participant, "search/go", Go)
