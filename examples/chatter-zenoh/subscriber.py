"""Print every greeting that arrives, until SIGTERM or SIGINT."""

import zenoh
from stopping import stopping

with zenoh.open(zenoh.Config.from_env()) as session:  # the file that ZENOH_CONFIG names
    session.declare_subscriber("chatter", lambda sample: print(f"heard: {sample.payload.to_string()}", flush=True))
    stopping.wait()
