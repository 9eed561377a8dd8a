"""Publish a greeting twice a second, until SIGTERM or SIGINT."""

import socket

from cyclonedds.pub import DataWriter
from greeting import Greeting, join, stopping

participant, topic = join()
writer = DataWriter(participant, topic)
number = 0
while not stopping.wait(0.5):
    number += 1
    writer.write(Greeting(sender=socket.gethostname(), number=number))
    print(f"said: hello from {socket.gethostname()} #{number}", flush=True)
