"""The candidates: one row per effect that may explain a gap.

A row states the effect's numbers, where a fit may start, and how it changes the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cjt_gym.gap.candidates.candidate import Candidate, Values, scales
from cjt_gym.gap.candidates.drive import drive_rows
from cjt_gym.gap.candidates.friction import friction_rows
from cjt_gym.gap.candidates.load import load_rows
from cjt_gym.gap.candidates.motor import motor_rows
from cjt_gym.gap.candidates.sensing import sensing_rows
from cjt_gym.gap.candidates.transmission import transmission_rows
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.listed import in_place_of
from cjt_gym.gap.recorded.setting import Setting

HELD_BY = {
    "d_c": "c_p",
    "d_c_n": "c_n",
    "d_s": "s_p",
    "v_s": "v_s",
    "z_s": "z_s",
    "mu": "mu",
    "h": "hyst",
    "z_h": "hyst_z",
    "c": "hard",
}
"""Fields of numbers of a law, from which a fit may start where the joint file lists them."""

WAVES = {
    "cogging": {"f": "cog_f", "a": "cog_a", "b": "cog_b"},
    "gear_ripple": {"f": "rip_f", "a": "rip_a", "b": "rip_b"},
    "gravity": {"a": "grav_a", "b": "grav_b"},
}
"""The same of what repeats with an angle."""


def all_candidates(setting: Setting, stages: tuple[str, ...]) -> tuple[Candidate, ...]:
    """Return all candidates of the effect table that a record with these stages can reveal."""
    size = scales(setting)
    rows: list[Candidate] = []
    if "i_cmd" in setting.series:
        rows += drive_rows(setting)
    rows += motor_rows(setting, size)
    rows += friction_rows(setting, size)
    if setting.has_spring:
        rows += transmission_rows(setting, size)
    if setting.cut is Cut.BY_TORQUE:
        rows += sensing_rows(setting)
    if not setting.structure.output_fixed:
        rows += load_rows(setting, size)
    return shown([_anew(row, setting) for row in rows], stages)


def _anew(row: Candidate, setting: Setting) -> Candidate:
    """Return a candidate that takes the place of what the joint file lists of its effect.

    Its fits start from what is listed, too. Candidates other than friction set their fields anyway,
    or are told as the totals of their fields.
    """
    rows = (setting.listed.get(name, {}) for name in in_place_of(row.name))
    listed = {field: x for own in rows for field, x in own.items()}
    letter = (row.body or "motor")[0]
    symbols = [u.symbol.replace(f"_c{letter}", "_c") for u in row.unknowns]
    held = HELD_BY | WAVES.get(row.name, {})
    fields = [held.get(symbol.removesuffix(letter), "") for symbol in symbols]
    known = tuple(listed.get(f"{x}_{letter}", listed.get(x, 0.0)) for x in fields)
    if known and all(known):
        row = replace(row, starts=(known, *row.starts), listed=known)
    old = {k: x for k, x in listed.items() if k.endswith(f"_{letter}")}
    if row.family != "friction" or not old:
        return row

    first = row.apply

    def apply(f: Fields, v: Values) -> None:
        f.update((field, f[field] - x) for field, x in old.items())
        first(f, v)

    return replace(row, apply=apply)


def shown(rows: Sequence[Candidate], stages: tuple[str, ...]) -> tuple[Candidate, ...]:
    """Return the candidates that touch any of the stages, each reduced to those it touches."""
    kept = []
    for row in rows:
        touches = tuple(s for s in row.touches if s in stages)
        if touches:
            kept.append(replace(row, touches=touches))
    return tuple(kept)
