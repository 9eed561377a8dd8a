"""Words of YAML -> what they mean, and numbers -> text, as Compose's YAML library has it. Pure.

That is neither YAML 1.1 nor 1.2: `010` is 8, `0o10` too, `yes` is a word, `1_000` is a number, `1:30` is a word.
"""

from __future__ import annotations

import math
import re
import struct

_WORDS: dict[str, bool | float | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), math.inf),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), -math.inf),
}
_DIGITS = 100
"""A number with more is not read as one; Python's reading of very long ones takes long."""
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", re.ASCII)
_BASES = (("0b", 2), ("0B", 2), ("0o", 8), ("0O", 8), ("0x", 16), ("0X", 16), ("0", 8))
_DIGITS_OF = {2: re.compile("[01]+"), 8: re.compile("[0-7]+"), 16: re.compile("[0-9a-fA-F]+")}
_DATE = re.compile(
    r"[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}([Tt ][0-9]{1,2}:[0-9]{1,2}:[0-9]{1,2}(\.[0-9]+)?\s*(Z|z|[-+][0-9:]+)?)?", re.ASCII
)


class Date(str):
    """A word that is a date to YAML; Compose takes dates nowhere."""

    __slots__ = ()


def meaning(text: str) -> str | int | float | bool | None:
    """Return what a word without quotes stands for."""
    if text in _WORDS:
        return _WORDS[text]
    if not text or not (text[0] in "+-." or text[0].isdigit()) or len(text) > _DIGITS:
        return text
    if _DATE.fullmatch(text) and _is_date(text):
        return Date(text)
    return _number(text.replace("_", ""), text)


def _number(digits: str, text: str) -> str | int | float:
    sign, bare = (-1, digits[1:]) if digits[:1] == "-" else (1, digits.removeprefix("+"))
    if bare.isascii() and bare.isdigit() and (bare == "0" or not bare.startswith("0")):
        return _within(sign * int(bare), digits)
    for prefix, base in _BASES:
        if bare.startswith(prefix) and _DIGITS_OF[base].fullmatch(bare[len(prefix) :]):
            return _within(sign * int(bare[len(prefix) :], base), digits)
    if _FLOAT.fullmatch(digits):
        number = float(digits)
        return text if math.isinf(number) else number
    return text


def _within(number: int, digits: str) -> int | float:
    """Return what does not fit into 64 bits as a float."""
    return number if -(2**63) <= number < 2**64 else float(int(number))


def _is_date(text: str) -> bool:
    month, day = (int(part) for part in re.split("[-Tt ]", text)[1:3])
    return 1 <= month <= 12 and 1 <= day <= 31


def shown(value: str | int | float | bool | None) -> str:
    """Return a scalar as Compose prints it where text is wanted."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return show_float(value) if isinstance(value, float) else str(value)


def show_float(number: float) -> str:
    """Return a number as Go's `%v` has it: as short as it can be, with an exponent below 1e-4 and from 1e6 on."""
    if math.isnan(number):
        return "NaN"
    if math.isinf(number):
        return "+Inf" if number > 0 else "-Inf"
    if number == 0:
        return "-0" if math.copysign(1, number) < 0 else "0"
    digits, exponent = _shortest(abs(number))
    sign = "-" if number < 0 else ""
    if exponent < -4 or exponent >= 6:
        point = f"{digits[0]}.{digits[1:]}" if len(digits) > 1 else digits
        return f"{sign}{point}e{'-' if exponent < 0 else '+'}{abs(exponent):02d}"
    if exponent < 0:
        return f"{sign}0.{'0' * (-exponent - 1)}{digits}"
    if len(digits) <= exponent + 1:
        return sign + digits.ljust(exponent + 1, "0")
    return f"{sign}{digits[: exponent + 1]}.{digits[exponent + 1 :]}"


def _shortest(number: float) -> tuple[str, int]:
    """Return the digits that are needed to read the same number again, and the power of ten of the first."""
    mantissa, _, exponent = f"{number!r}".partition("e")
    whole, _, part = mantissa.partition(".")
    part = "" if part == "0" else part
    digits = (whole + part).lstrip("0")
    power = int(exponent or 0) + (len(whole) - 1 if whole != "0" else -(len(part) - len(part.lstrip("0")) + 1))
    return digits.rstrip("0") or "0", power


def single(number: float) -> float:
    """Return a number as 32 bits hold it, in as few digits as name it there."""
    small = struct.unpack("f", struct.pack("f", number))[0]
    for digits in range(1, 10):
        short = float(f"{small:.{digits}g}")
        if struct.unpack("f", struct.pack("f", short))[0] == small:
            return short
    return float(small)
