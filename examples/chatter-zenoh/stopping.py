"""How all three end: on SIGTERM and SIGINT."""

import signal
import threading

stopping = threading.Event()
for number in (signal.SIGTERM, signal.SIGINT):
    signal.signal(number, lambda *_: stopping.set())
