"""Trials: which there are, in which order and with which seeds; when one has ended, and what came of it.

Takes TrialDefinitions, and readings of a trial as values; gives a Design, verdicts and rows of tables. Pure.

    design       points, ids, seeds and order       judge      conditions of a trial, and its verdict
"""

from __future__ import annotations

from srprov.trials.design import Design, Point, Trial, design

__all__ = ["Design", "Point", "Trial", "design"]
