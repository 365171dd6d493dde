"""Numbers in the text of NMEA and EZO, without floating point."""

from __future__ import annotations

import re

NANO = 1_000_000_000

_MOST_WHOLE = 999_999_999
_DECIMAL = re.compile(rb"(?=\.?[0-9])([0-9]*)(?:\.([0-9]*))?")


def parse_decimal(text: bytes) -> int | None:
    """`12`, `12.`, `.5` or `12.345` in billionths, None for anything else.

    Digits beyond the ninth decimal are ignored; the whole part saturates.
    """
    match = _DECIMAL.fullmatch(text)
    if match is None:
        return None
    whole, fraction = match.groups()
    billionths = ((fraction or b"")[:9]).ljust(9, b"0")
    return min(int(whole or b"0"), _MOST_WHOLE) * NANO + int(billionths)


def parse_signed_decimal(text: bytes) -> int | None:
    """The same with an optional minus sign."""
    if not text.startswith(b"-"):
        return parse_decimal(text)
    nano = parse_decimal(text[1:])
    return None if nano is None else -nano
