"""Facts: robots -> HostFacts, and everything of ours that exists there.

Takes Hosts and Readers; gives values. Touches robots through Reader only, which cannot change them. What they say is
untrusted.
"""
