"""The overlay: who is where on it, and what every robot must know to reach everybody. Pure.

layout     computes an `Overlay` (model)          identity   VNI, subnet and names, by hash, with collision check
addresses  IP and MAC of services                 foreign    what others on the robots use
hosts      the hosts file                         record     the placement record, written and read
"""
