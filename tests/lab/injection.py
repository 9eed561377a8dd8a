"""Frames that somebody tries to bring into an overlay, and who sees them. Sent and seen by Python on the robots.

A frame is of a type that nobody uses and holds one word, which says who sent it. What is here runs in a network
namespace of a robot: `python3 -c` gets `TOOL`, then `listen` or `send` and its arguments.
"""

from __future__ import annotations

TOOL = '''
import socket, struct, sys

TYPE = 0x88B5  # for experiments, IEEE 802

def frame(word, source, to="ff:ff:ff:ff:ff:ff"):
    return bytes.fromhex((to + source).replace(":", "")) + struct.pack("!H", TYPE) + word.encode().ljust(46)

def vxlan(vni, inner):
    return struct.pack("!II", 0x08000000, vni << 8) + inner

def listen():
    """Print each word that comes by eth0, up to the word `end`."""
    seen = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(TYPE))
    seen.bind(("eth0", TYPE))
    seen.settimeout(60)
    print("ready", flush=True)
    word = ""
    while word != "end":
        packet, where = seen.recvfrom(2000)
        if where[2] != socket.PACKET_OUTGOING:
            word = packet[14:].decode().strip()
            print(word, flush=True)

def plain(word, source, *targets):
    """Send a frame as a member's container does: to all, or a copy to each of some MAC addresses, which it names."""
    link = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    link.bind(("eth0", TYPE))
    if not targets:
        link.send(frame(word, source))
    for to in targets:
        link.send(frame(f"{word} {to}", source, to))

def udp(who, source, vni, port, targets, ways, first="1"):
    """Send it in VXLAN to each target: from any port or a low one, alone or as a second segment of one packet.

    The first segment is of the VNI `first`.
    """
    for to in targets.split(","):
        for way in ways.split(","):
            out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            if "low" in way:
                out.bind(("", 800))
            packet = vxlan(int(vni), frame(f"{who} {way}", source))
            if "segment" in way:
                out.setsockopt(socket.IPPROTO_UDP, 103, len(packet))
                packet = vxlan(int(first), frame(who, source)) + packet
            out.sendto(packet, (to, int(port)))
            out.close()

def forged(word, source, vni, port, to, sender):
    """Send it in VXLAN with somebody else's address as the sender's."""
    packet = vxlan(int(vni), frame(word, source))
    packet = struct.pack("!HHHH", 800, int(port), 8 + len(packet), 0) + packet
    raw = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW)
    head = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(packet), 1, 0, 64, 17, 0)
    raw.sendto(head + socket.inet_aton(sender) + socket.inet_aton(to) + packet, (to, 0))

def claim(port, to):
    """Send from the overlay's port to all that a member sends from: to a tracker, what that one sends is the answer."""
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.bind(("", int(port)))
    for one in range(768, 1024):
        out.sendto(b"", (to, one))

globals()[sys.argv[1]](*sys.argv[2:])
'''
