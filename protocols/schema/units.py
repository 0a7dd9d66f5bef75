"""Units of signals: parsed, multiplied, compared and converted.

A unit is a product of powers of symbols, as the page shows them: `m/s²`, `°/s`, `1/s`. Symbols of one dimension are
converted into each other (g and m/s², ° and rad); a symbol that is not in the table has a dimension of its own, so it
equals itself only. So does °C, which has no common zero with K.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

G = 9.80665  # m/s²
_DEGREE = math.pi / 180

SYMBOLS: Mapping[str, tuple[float, Mapping[str, int]]] = {
    "m": (1.0, {"m": 1}),
    "mm": (1e-3, {"m": 1}),
    "cm": (1e-2, {"m": 1}),
    "km": (1e3, {"m": 1}),
    "s": (1.0, {"s": 1}),
    "ms": (1e-3, {"s": 1}),
    "µs": (1e-6, {"s": 1}),
    "ns": (1e-9, {"s": 1}),
    "min": (60.0, {"s": 1}),
    "h": (3600.0, {"s": 1}),
    "Hz": (1.0, {"s": -1}),
    "kHz": (1e3, {"s": -1}),
    "rad": (1.0, {"rad": 1}),
    "mrad": (1e-3, {"rad": 1}),
    "°": (_DEGREE, {"rad": 1}),
    "g": (G, {"m": 1, "s": -2}),
    "mg": (1e-3 * G, {"m": 1, "s": -2}),
    "kn": (1852 / 3600, {"m": 1, "s": -1}),
    "T": (1.0, {"T": 1}),
    "mT": (1e-3, {"T": 1}),
    "µT": (1e-6, {"T": 1}),
    "nT": (1e-9, {"T": 1}),
    "G": (1e-4, {"T": 1}),
    "Pa": (1.0, {"Pa": 1}),
    "hPa": (1e2, {"Pa": 1}),
    "kPa": (1e3, {"Pa": 1}),
    "mbar": (1e2, {"Pa": 1}),
    "bar": (1e5, {"Pa": 1}),
    "°C": (1.0, {"°C": 1}),  # so that it can be typed; it fits nothing else
    "N": (1.0, {"N": 1}),
    "V": (1.0, {"V": 1}),
    "A": (1.0, {"A": 1}),
    "%": (1e-2, {}),
    "a.u.": (1.0, {}),
}
"""Factor to the units of the dimensions, and the powers of these."""

SPELLINGS: Mapping[str, str] = {"deg": "°", "us": "µs", "uT": "µT", "gauss": "G", "percent": "%"}
"""How symbols may be typed, too."""

_SUPERSCRIPT = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_TO_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PART = re.compile(r"([^\d\s,·*/^()⁻⁰¹²³⁴-⁹][^\s,·*/^()⁻⁰¹²³⁴-⁹]*)(?:\^(-?\d+)|([⁻⁰¹²³⁴-⁹]+))?")


@dataclass(frozen=True, slots=True)
class Unit:
    """A product of powers of symbols; without any: no unit."""

    powers: tuple[tuple[str, Fraction], ...] = ()

    @classmethod
    def parse(cls, text: str) -> Unit:
        """The unit of a text; one that cannot be divided into symbols is one symbol."""
        powers: dict[str, Fraction] = {}
        sign, at = 1, 0
        text = text.strip()
        while at < len(text):
            if text[at] in "·* ":
                at += 1
            elif text[at] == "/":
                sign, at = -1, at + 1
            elif text[at] == "1" and text[at : at + 2] in ("1", "1/"):
                at += 1
            elif match := _PART.match(text, at):
                symbol = SPELLINGS.get(match[1], match[1])
                power = int(match[2] or (match[3] or "1").translate(_SUPERSCRIPT))
                powers[symbol] = powers.get(symbol, Fraction(0)) + sign * power
                at = match.end()
            else:
                return cls(((text, Fraction(1)),))
        return cls(_tidy(powers))

    @property
    def factor(self) -> float:
        """One of this unit in units of its dimensions."""
        return float(math.prod(SYMBOLS.get(name, (1.0, {}))[0] ** float(power) for name, power in self.powers))

    @property
    def dimensions(self) -> dict[str, Fraction]:
        """Powers of the dimensions; none for a plain number."""
        exponents: dict[str, Fraction] = {}
        for name, power in self.powers:
            for dimension, times in SYMBOLS.get(name, (1.0, {name: 1}))[1].items():
                exponents[dimension] = exponents.get(dimension, Fraction(0)) + power * times
        return {name: power for name, power in exponents.items() if power}

    def fits(self, other: Unit) -> bool:
        """Whether numbers of both can be added."""
        return self.dimensions == other.dimensions

    def to(self, other: Unit) -> float:
        """Factor that converts numbers of this unit into those of another one that fits."""
        return 1.0 if self.powers == other.powers else self.factor / other.factor

    def __mul__(self, other: Unit) -> Unit:
        powers = dict(self.powers)
        for name, power in other.powers:
            powers[name] = powers.get(name, Fraction(0)) + power
        return Unit(_tidy(powers))

    def __pow__(self, power: Fraction | int) -> Unit:
        return Unit(_tidy({name: one * power for name, one in self.powers}))

    def __truediv__(self, other: Unit) -> Unit:
        return self * other**-1

    def __str__(self) -> str:
        above = [_shown(name, power) for name, power in self.powers if power > 0]
        below = [_shown(name, -power) for name, power in self.powers if power < 0]
        if not below:
            return "·".join(above)
        return "/".join(["·".join(above) or "1", *below])


NO_UNIT = Unit()


def rounded(value: float, digits: int = 3) -> str:
    """A number with so many digits, without a power of ten below a million: 1200, not 1.2e+03."""
    return f"{value:.0f}" if 10 ** (digits - 1) <= abs(value) < 1e6 else f"{value:.{digits}g}"


def _tidy(powers: Mapping[str, Fraction]) -> tuple[tuple[str, Fraction], ...]:
    return tuple((name, Fraction(power)) for name, power in powers.items() if power)


def _shown(name: str, power: Fraction) -> str:
    if power == 1:
        return name
    if power.denominator == 1:
        return name + str(power.numerator).translate(_TO_SUPERSCRIPT)
    return f"√{name}" if power == Fraction(1, 2) else f"{name}^({power})"
