"""How numbers, units and formulas are written on a sheet.

Text of a sheet is plain; what stands between dollar signs is a formula, in which an underscore
begins an index: ``the current $i_c$``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

DOLLAR = "\ue024"
"""A dollar sign that begins no formula, within the text of a sheet."""
UNITS = {"degC": "°C", "Ohm": "Ω", "W^0.5": "√W", "m^2": "m²", "s^2": "s²"}
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
TOKEN = re.compile(r"([^\W\d_²]+)_((?:[^\W²]|[½∞])+(?:,[\w½]+)*)|([^\W\d_²]+)")


def unit(name: str) -> str:
    """Return a unit as it is printed: ``N m/√W``, ``°C``; nothing for a pure number."""
    for plain, printed in UNITS.items():
        name = name.replace(plain, printed)
    return "" if name == "-" else name


def number(value: float | None, digits: int = 4) -> str:
    """Return a number with so many significant digits, without letters for powers of ten.

    Example:
        >>> number(0.00062893), number(941.887), number(float("inf")), number(None)
        ('6.289·10⁻⁴', '941.9', '∞', '–')
    """
    if value is None or math.isnan(value):
        return "\N{EN DASH}"
    if math.isinf(value):
        return "∞"
    if value != 0.0 and not 1e-3 <= abs(value) < 1e6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".")
        return f"{mantissa}·10{str(int(power)).translate(SUPERSCRIPT)}"
    places = digits if value == 0.0 else digits - 1 - math.floor(math.log10(abs(value)))
    text = f"{value:.{max(places, 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def with_tolerance(value: float | None, sigma: float | None) -> str:
    """Return a value with one sigma, both to the second digit of sigma.

    Example:
        >>> with_tolerance(187.2, 9.36), with_tolerance(187.2, None)
        ('187.2 ± 9.4', '187.2')
    """
    if value is None or sigma is None or not math.isfinite(value):
        return number(value)
    places = max(0, 1 - math.floor(math.log10(sigma)))
    if places > 6:
        return f"{number(value)} ± {number(sigma, 2)}"
    return f"{value:.{places}f} ± {sigma:.{places}f}"


def plain(text: str) -> str:
    """Return a user's text as text of a sheet, in which no character begins a formula."""
    return "".join(c if c.isprintable() else "?" for c in text).replace("$", DOLLAR)


def named(name: str) -> str:
    """Return the name of a joint as text of a sheet."""
    return plain(name.replace("_", " "))


def drawn(name: str) -> str:
    """Return a name as Matplotlib shows it in a legend: no sign in it begins a formula."""
    text = "".join(c if c.isprintable() else "?" for c in name).replace("$", "\\$")
    return " " + text[1:] if text.startswith("_") else text  # one that begins so is left out


def without_formulas(text: str) -> str:
    """Return a text of a sheet where formulas cannot be set, such as the title of a window."""
    return text.replace("$", "").replace(DOLLAR, "$")


def render(
    text: str,
    plain: Callable[[str], str],
    italic: Callable[[str], str],
    index: Callable[[str], str],
) -> str:
    """Return a text in some markup; formulas stand between dollar signs.

    What `plain` has hidden is there again before it is escaped.
    """

    def escaped(text: str) -> str:
        return plain(text.replace(DOLLAR, "$"))

    def formula(text: str) -> str:
        text = text.replace(" - ", " \N{MINUS SIGN} ")
        out, done = [], 0
        for match in TOKEN.finditer(text):
            out.append(escaped(text[done : match.start()]))
            base, low, word = match.groups()
            if word is None:
                out.append(italic(escaped(base)) + index(escaped(low)))
            else:
                out.append(italic(escaped(word)) if len(word) == 1 else escaped(word))
            done = match.end()
        return "".join([*out, escaped(text[done:])])

    parts = text.split("$")
    return "".join(escaped(part) if k % 2 == 0 else formula(part) for k, part in enumerate(parts))
