"""Registry of analyses.

Each file of `methods/` registers an analysis when it is imported, and so does each module named in the
entry-point group `imuscope.analyses` of another package. docs/add-an-analysis.md explains how to write one.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

from imuscope.protocols.family.plugins import Registry
from imuscope.protocols.schema.units import Unit
from imuscope.recordings.errors import near_miss
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.signals.signals import Signal

OWN = "unit_of_the_signal"  # a symbol while units are multiplied
Figure = Any
"""A number, a text, a list of figures, or an object of figures by name; NaN where there is no number."""
Result = Mapping[str, Figure]
"""Figures by name. `notes` are sentences for a user: omitted parts, and cautions."""
Settings = Mapping[str, float]
"""All options of one request by name; of a choice, its index."""


@dataclass(frozen=True, slots=True)
class AnalysisOption:
    """One option of an analysis: a number, or one of several words.

    Args:
        name: as in requests and on the command line.
        default: used if it is not given.
        low, high: allowed range, both included.
        unit: of the number.
        doc: one sentence.
        choices: words of which a request names one; the analysis gets its index. Empty: the option is a number.
    """

    name: str
    default: float
    low: float
    high: float
    unit: str = ""
    doc: str = ""
    choices: tuple[str, ...] = ()

    def checked(self, value: object) -> float:
        """The value as a number; of a choice, its index.

        Raises:
            DomainError: "bad-value": it is not a number, out of range, or none of the choices.
        """
        if self.choices:
            if value in self.choices:
                return float(self.choices.index(str(value)))
            raise DomainError(
                "bad-value", f"{self.name} {value!r:.40} is not allowed.", f"Give one of: {', '.join(self.choices)}."
            )
        try:
            number = float(value)  # type: ignore[arg-type]  # whatever a request holds
        except (TypeError, ValueError):
            number = math.nan
        if isinstance(value, bool) or not self.low <= number <= self.high:
            limits = f"{self.low:.12g} to {self.high:.12g} {self.unit}".strip()
            raise DomainError("bad-value", f"{self.name} {value!r:.40} is not allowed.", f"Give a number, {limits}.")
        return number


def choice(name: str, choices: tuple[str, ...], doc: str) -> AnalysisOption:
    """An option that is one of several words; the first is the default."""
    return AnalysisOption(name, 0.0, 0.0, len(choices) - 1.0, doc=doc, choices=choices)


class FiguresOfSignal(NamedTuple):
    """Figures of one signal, for a text that is made of them."""

    name: str
    unit: str
    figures: Mapping[str, Any]


TextFormat = Callable[[Sequence[FiguresOfSignal]], str]


@dataclass(frozen=True, slots=True)
class Analysis:
    """One analysis.

    Args:
        name: unique: in the HTTP API and on the command line ("statistics").
        title: display name.
        words: short description for a list.
        run: takes a signal, which has at least one sample, and all options; returns the figures. Runs in a thread.
        units: unit of each figure; "{unit}" stands for the unit of the signal. Figures without a unit are left out. A
            function where the units depend on the options.
        options: what a request may set.
        order: analyses are listed in ascending order.
        formats: texts made of the figures of all signals of a request, by name ("kalibr"); further ways to give the
            result beside json.
        companions: it judges a signal by the other sensors of its device too; see Signal.
    """

    name: str
    title: str
    words: str
    run: Callable[[Signal, Settings], Result]
    units: Mapping[str, str] | Callable[[Settings], Mapping[str, str]]
    options: tuple[AnalysisOption, ...] = ()
    order: int = 100
    formats: Mapping[str, TextFormat] = field(default_factory=dict)
    companions: bool = False

    def settings(self, values: Mapping[str, object]) -> dict[str, float]:
        """All options: those given, checked, and the defaults of the others.

        Raises:
            DomainError: "bad-value": an option is unknown or its value not allowed.
        """
        known = {option.name: option for option in self.options}
        for name in values:
            if name not in known:
                hint = f"Its options: {', '.join(known)}." if known else "It has no options."
                raise DomainError("bad-value", f"{self.title} has no option {name:.40}{near_miss(name, known)}.", hint)
        return {
            name: option.checked(values[name]) if name in values else option.default for name, option in known.items()
        }

    def text(self, name: str, signals: Sequence[FiguresOfSignal]) -> str:
        """The figures of all signals in the format of that name.

        Raises:
            DomainError: "bad-value": there is no such format, or it cannot be made of these signals.
        """
        if name not in self.formats:
            own = ", ".join(self.formats)
            hint = f"{self.title} also has: {own}." if own else f"{self.title} has no format of its own."
            raise DomainError("bad-value", f"Format {name:.40} not found.", hint)
        return self.formats[name](signals)

    def units_for(self, signal: Signal, settings: Settings) -> dict[str, str]:
        """Unit of each figure of this signal; figures without a unit are left out."""
        declared = self.units(settings) if callable(self.units) else self.units
        units = {name: _unit_of(unit, signal.unit) for name, unit in declared.items()}
        return {name: unit for name, unit in units.items() if unit}


def _unit_of(declared: str, own: str) -> str:
    """The unit of a figure: s/s is left out, and the square of a quotient keeps its parentheses."""
    if "{unit}²" in declared:
        squared = f"({own})²" if re.search("[/·²³]", own) else f"{own}²" if own else "1"
        return declared.replace("{unit}²", squared)
    if declared == "{unit}":
        return own
    unit = Unit.parse(declared.replace("{unit}", OWN))
    power = dict(unit.powers).get(OWN, Fraction(0))
    rest = Unit(tuple((name, one) for name, one in unit.powers if name != OWN))
    return str(Unit.parse(own) ** power * rest)


ANALYSES = Registry[Analysis]("analysis", "imuscope.server.extensions.analysis.methods", "imuscope.analyses")
register_analysis, load_analyses, problems = ANALYSES.register, ANALYSES.load, ANALYSES.problems


def analyses() -> list[Analysis]:
    """All analyses, sorted by `order`."""
    return list(ANALYSES.all().values())


def analysis_named(name: str) -> Analysis:
    """The analysis of that name.

    Raises:
        DomainError: "not-found".
    """
    known = ANALYSES.all()
    if name not in known:
        raise DomainError(
            "not-found", f"Analysis {name:.40} not found{near_miss(name, known)}.", f"Available: {', '.join(known)}."
        )
    return known[name]
