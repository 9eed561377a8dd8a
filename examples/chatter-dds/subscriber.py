"""Print every greeting that arrives, until SIGTERM or SIGINT."""

from cyclonedds.sub import DataReader
from greeting import Greeting, join, stopping

participant, topic = join()
reader = DataReader(participant, topic)
while not stopping.wait(0.05):
    for greeting in reader.take(N=100):
        if isinstance(greeting, Greeting):  # a publisher that leaves is reported as a sample without data
            print(f"heard: hello from {greeting.sender} #{greeting.number}", flush=True)
