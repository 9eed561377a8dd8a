"""Desired resources and what was found -> a Plan. Pure.

Steps in order, each with its cause, what it needs and its exact commands. The door imports nothing: what only knows
plans, as the CLI does before it connects, needs no module that makes them.
"""
