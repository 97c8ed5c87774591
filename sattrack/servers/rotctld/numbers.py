"""Numbers as C's `sscanf` reads them, since that is how clients' numbers have always been read.

ISO/IEC 9899:2011, 7.21.6.2, as glibc has it: the beginning that is a number is taken, with an exponent that
lacks its digits as one of 0; what follows is not looked at.
"""

from __future__ import annotations

import re
import struct

_SPACES = " \t\n\v\f\r"
_INTEGER = re.compile(r"[+-]?[0-9]+")
_HEX = re.compile(r"([+-]?)0[xX]([0-9a-fA-F]*)(?:\.([0-9a-fA-F]*))?(?:[pP]([+-]?[0-9]*))?")
_DECIMAL = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[eE]([+-]?[0-9]*))?")
_NAMED = re.compile(r"([+-]?)(inf(?:i[a-z]*)?|nan)", re.IGNORECASE)
MOST_DIGITS = 300


def scan_integer(text: str) -> int | None:
    """Return the whole number that a text begins with, as `%d` reads it; None where there is none."""
    found = _INTEGER.match(text.lstrip(_SPACES))
    return None if found is None or len(found.group()) > MOST_DIGITS else int(found.group())


def scan_double(text: str) -> float | None:
    """Return the number that a text begins with, as `%lf` reads it; None where there is none.

    Hexadecimal numbers, infinities and not-a-numbers are numbers too.
    """
    text = text.lstrip(_SPACES)
    named = _NAMED.match(text)
    if named is not None:
        sign, word = named.groups()
        if word.lower() not in {"inf", "infinity", "nan"} and not word.lower().startswith("infinity"):
            return None
        return float(sign + word[:3])
    if re.match(r"[+-]?0[xX]", text):
        return _hexadecimal(text)
    found = _DECIMAL.match(text)
    if found is None:
        return None
    mantissa, exponent = found.groups()
    return float(mantissa if _lacks_digits(exponent) else f"{mantissa}e{exponent}")


def _hexadecimal(text: str) -> float | None:
    found = _HEX.match(text)
    if found is None:
        return None
    sign, whole, fraction, exponent = found.groups()
    if not (whole or fraction):
        return None
    power = "0" if _lacks_digits(exponent) else exponent
    try:
        return float.fromhex(f"{sign}0x{whole or '0'}.{fraction or '0'}p{power}")
    except OverflowError:
        return float(f"{sign}inf")


def _lacks_digits(exponent: str | None) -> bool:
    return not (exponent or "").strip("+-")


def scan_single(text: str) -> float | None:
    """Return the number that a text begins with, as `%f` reads it: rounded to single precision."""
    value = scan_double(text)
    if value is None:
        return None
    try:
        (single,) = struct.unpack("f", struct.pack("f", value))
    except OverflowError:
        single = float("inf") if value > 0 else float("-inf")
    return float(single)
