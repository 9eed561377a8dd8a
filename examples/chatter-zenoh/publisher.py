"""Publish a greeting twice a second, until SIGTERM or SIGINT."""

import socket

import zenoh
from stopping import stopping

with zenoh.open(zenoh.Config.from_env()) as session:  # the file that ZENOH_CONFIG names
    publisher = session.declare_publisher("chatter")
    number = 0
    while not stopping.wait(0.5):
        number += 1
        publisher.put(f"hello from {socket.gethostname()} #{number}")
        print(f"said: hello from {socket.gethostname()} #{number}", flush=True)
