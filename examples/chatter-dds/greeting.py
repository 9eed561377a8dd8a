"""What publisher and subscriber share: the type of a message, its topic, and how they end."""

import signal
import threading
from dataclasses import dataclass

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.topic import Topic

stopping = threading.Event()
for number in (signal.SIGTERM, signal.SIGINT):
    signal.signal(number, lambda *_: stopping.set())


@dataclass
class Greeting(IdlStruct, typename="chatter.Greeting"):
    sender: str
    number: int


def join() -> tuple[DomainParticipant, Topic[Greeting]]:
    """Enter domain 0 and give the topic."""
    participant = DomainParticipant()
    return participant, Topic(participant, "chatter", Greeting)
