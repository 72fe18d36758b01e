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
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting

ANEW = frozenset({"stribeck", "presliding", "load_friction", "load_coulomb", "viscous_asym"})
"""Laws of friction that are added to the fields; most other candidates set theirs."""
HELD_BY = {
    "d_c": "c_p",
    "d_s": "s_p",
    "v_s": "v_s",
    "z_s": "z_s",
    "mu": "mu",
    "h": "hyst",
    "z_h": "hyst_z",
    "c": "hard",
}
"""Fields of numbers of a law, from which a fit may start where the joint file lists them."""


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
    if setting.cut_at_spring:
        rows += sensing_rows(setting)
    if not setting.structure.output_fixed:
        rows += load_rows(setting, size)
    return shown([_anew(row, setting) for row in rows], stages)


def _anew(row: Candidate, setting: Setting) -> Candidate:
    """Return a candidate that takes the place of what the joint file lists of its effect.

    Coulomb friction is added to what is listed, as are rows of a single field.
    """
    added = setting.listed.get(row.name, {})
    letter = (row.body or "motor")[0]
    symbols = [u.symbol.removesuffix(letter) for u in row.unknowns]
    fields = [HELD_BY.get(symbol, "") for symbol in symbols]
    known = tuple(added.get(f"{x}_{letter}", added.get(x, 0.0)) for x in fields)
    starts = (known, *row.starts) if all(known) else row.starts
    old = {k: x for k, x in added.items() if k.endswith(f"_{letter}")}
    if row.name not in ANEW or not old:
        return replace(row, starts=starts)

    def apply(f: Fields, v: Values) -> None:
        f.update((field, f[field] - x) for field, x in old.items())
        row.apply(f, v)

    return replace(row, apply=apply, starts=starts)


def shown(rows: Sequence[Candidate], stages: tuple[str, ...]) -> tuple[Candidate, ...]:
    """Return the candidates that touch any of the stages, each reduced to those it touches."""
    kept = []
    for row in rows:
        touches = tuple(s for s in row.touches if s in stages)
        if touches:
            kept.append(replace(row, touches=touches))
    return tuple(kept)
