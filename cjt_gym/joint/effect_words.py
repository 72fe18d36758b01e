"""Effects as written on a command line, and the effects of a joint in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from cjt_gym.errors import ConfigurationError, ParameterError
from cjt_gym.joint.configure import TYPICAL, is_known
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.joint import Joint


def parse_effects(words: Iterable[str] | None) -> dict[str, Any] | None:
    """Turn ["coulomb", "cogging=typical", "command_delay.delay=0.001"] into {effect: values}.

    A series is written with commas: cogging.f=480,960.

    Raises:
        ConfigurationError: A value is not a number.

    Example:
        >>> parse_effects(["coulomb", "cogging=typical", "command_delay.delay=0.001"])
        {'coulomb': {}, 'cogging': 'typical', 'command_delay': {'delay': 0.001}}
    """
    if words is None:
        return None
    effects: dict[str, Any] = {}
    for word in words:
        if word.endswith(f"={TYPICAL}"):
            effects[word.removesuffix(f"={TYPICAL}")] = TYPICAL
            continue
        name, _, rest = word.partition(".")
        values = effects.setdefault(name, {})
        if rest and isinstance(values, dict):
            symbol, _, text = rest.partition("=")
            values[symbol] = _value(word, symbol, text)
        elif rest or "=" in name:
            raise _no_effect(word)
    return effects


def _value(word: str, symbol: str, text: str) -> Any:
    if symbol in ("body", "channel"):
        return text
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        raise _no_effect(word) from None
    return numbers[0] if len(numbers) == 1 else tuple(numbers)


def _no_effect(word: str) -> ConfigurationError:
    return ConfigurationError(
        f"--effect {word} must be name, name={TYPICAL}, name.parameter=number or "
        "name.parameter=number,number."
    )


def known_but_off(joint: Joint) -> tuple[str, ...]:
    """Return the effects that are off although the joint file gives their values.

    Example:
        >>> from cjt_gym import load_joint
        >>> known_but_off(load_joint("orange_80_6000", "rigid", effects=["noise"]))
        ('coulomb', 'quantization')
    """
    taken, off = set(joint.effects), []
    listed = [name for name in joint.file.effects if name in EFFECTS]
    for name in dict.fromkeys((*listed, *EFFECTS)):
        effect = EFFECTS[name]
        rivals = any(other in taken for other in effect.excludes)
        if name in taken or rivals or not effect.acts_in(joint.structure_row, joint.drive):
            continue
        try:
            known = is_known(effect, joint.file)
        except ParameterError:  # it needs more than the file has
            continue
        if known:
            taken.add(name)
            off.append(name)
    return tuple(off)


def effects_in_words(joint: Joint) -> str:
    """Describe which effects are active on a joint, and which known ones are off."""
    names = ", ".join(joint.effects) or "none"
    off = known_but_off(joint)
    left = f"; its file knows, but they are off: {', '.join(off)}" if off else ""
    return f"{joint.file.name} ({joint.structure}, {joint.drive}), effects in force: {names}{left}"
