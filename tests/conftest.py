"""How many examples property tests take: few by default, many with HYPOTHESIS_PROFILE=long, as `make soak` has it."""

from __future__ import annotations

import os

from hypothesis import settings

PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "quick")
LEAST = 20


def examples(most: int) -> int:
    """Return how many examples a test takes that takes `most` in the long profile: a quarter, but not too few."""
    return most if PROFILE == "long" else max(min(most, LEAST), most // 4)


settings.register_profile("quick", deadline=None, max_examples=examples(100))
settings.register_profile("long", deadline=None, max_examples=100)
settings.load_profile(PROFILE)
