"""Trials on the lab: what srprov and shell loops add to a service's own time, step by step."""
