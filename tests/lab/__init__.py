"""Behaviour on real robots: the embedded lab, looked at by means that are not srprov's."""
