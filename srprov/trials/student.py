"""Student's distribution: how large a difference chance alone gives. Pure.

Source: Press et al., *Numerical Recipes*, 3rd ed., section 6.4 (the incomplete beta function as a continued fraction).
"""

from __future__ import annotations

import math

_STEPS = 300
_CLOSE = 1e-13
_TINY = 1e-300


def cdf(t: float, df: float) -> float:
    """Return how probable a value of at most `t` is, with `df` degrees of freedom (more than 0, also infinite)."""
    if math.isinf(df):
        return math.erfc(-t / math.sqrt(2)) / 2
    tail = _beta(df / 2, 0.5, df / (df + t * t)) / 2
    return 1 - tail if t > 0 else tail


def quantile(p: float, df: float) -> float:
    """Return the value that is exceeded with probability 1 - `p`; `p` is at least 0.5 and below 1."""
    low, high = 0.0, 1.0
    while cdf(high, df) < p:
        low, high = high, 2 * high
    while high - low > 1e-10 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if cdf(middle, df) < p else (low, middle)
    return high


def _beta(a: float, b: float, x: float) -> float:
    """Return the regularised incomplete beta function."""
    if x <= 0 or x >= 1:
        return float(x >= 1)
    log = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    if x < (a + 1) / (a + b + 2):
        return math.exp(log) * _fraction(a, b, x) / a
    return 1 - math.exp(log) * _fraction(b, a, 1 - x) / b


def _fraction(a: float, b: float, x: float) -> float:
    c, d = 1.0, 1 / _not_zero(1 - (a + b) * x / (a + 1))
    found = d
    for m in range(1, _STEPS):
        for factor in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1 / _not_zero(1 + factor * d)
            c = _not_zero(1 + factor / c)
            found *= c * d
        if abs(c * d - 1) < _CLOSE:
            break
    return found


def _not_zero(value: float) -> float:
    return value if abs(value) > _TINY else _TINY
