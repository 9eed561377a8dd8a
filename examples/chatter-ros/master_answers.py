"""Health check of the ROS master: exits with 0 when it answers on this container's own address."""

import socket
import sys
from xmlrpc.client import ServerProxy

socket.setdefaulttimeout(3)
try:
    code, text, _pid = ServerProxy("http://127.0.0.1:11311").getPid("/healthcheck")
except OSError as problem:
    sys.exit(f"the master does not answer: {problem}")
if code != 1:
    sys.exit(f"the master answers with {code}: {text}")
