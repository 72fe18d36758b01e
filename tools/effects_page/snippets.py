"""Ready snippets of each effect, with the typical values of the joint of the figures."""

from __future__ import annotations

from cjt_gym.joint import Effect, load_joint_file
from cjt_gym.joint.configure import EffectValue, off_value, typical_value
from tools.effects_page.bench import JOINT

FILE = load_joint_file(JOINT)
LONGEST = 100  # characters of a line


def values(effect: Effect) -> dict[str, EffectValue]:
    """Return the typical values that say something, to three digits.

    What is neutral or comes from the joint file all the same is left out, and so is what only
    shapes the effect and has its default.
    """
    found: dict[str, EffectValue] = {}
    for p in effect.parameters:
        value = _rounded(typical_value(p, FILE.parameters))
        if p.symbol in effect.size:
            says = value != off_value(p, FILE.parameters)
        else:
            says = not (p.shared or value == p.default or p.joint_parameter in FILE.parameters)
        if says:
            found[p.symbol] = value
    return found


def python_snippet(effect: Effect) -> str:
    """Return the call that loads a joint with the effect."""
    words = [f'"{JOINT}"']
    if effect.needs == "voltage":
        words.append('drive="static"')
    if effect.needs == "fixed_load":
        words.append('structure="output_fixed"')
    inside = ", ".join(f'"{symbol}": {_number(x)}' for symbol, x in values(effect).items())
    chosen = f'"{effect.name}": {{{inside}}}'
    words.append(f"effects={{{chosen}}}")
    line = f"joint = load_joint({', '.join(words)})"
    if len(line) <= 80:
        return f"{line}\n"
    if len(words[-1]) + 5 > LONGEST:
        words[-1] = f"effects={{\n        {chosen}\n    }}"
    return "joint = load_joint(\n" + "".join(f"    {word},\n" for word in words) + ")\n"


def toml_snippet(effect: Effect) -> str:
    """Return the table of the effect in a joint file."""
    lines = [f"[effects.{effect.name}]"]
    for symbol, value in values(effect).items():
        p = effect.parameter(symbol)
        unit = p.unit if p is not None else "-"
        lines.append(f'{symbol} = {{ value = {_number(value)}, unit = "{unit}" }}')
    return "\n".join(lines) + "\n"


def _rounded(value: EffectValue) -> EffectValue:
    if isinstance(value, tuple):
        return tuple(float(f"{x:.3g}") for x in value)
    return float(f"{value:.3g}")


def _number(value: EffectValue) -> str:
    return repr(list(value) if isinstance(value, tuple) else value)
