"""Route between Zenoh sessions, until SIGTERM or SIGINT; `zenohd` of the Zenoh project would do as well."""

import zenoh
from stopping import stopping

config = zenoh.Config()
config.insert_json5("mode", '"router"')
config.insert_json5("listen/endpoints", '["tcp/0.0.0.0:7447"]')
with zenoh.open(config):
    print("routing", flush=True)
    stopping.wait()
