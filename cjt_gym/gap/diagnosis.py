"""Results of a diagnosis, as frozen dataclasses and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cjt_gym.gap.check.examination import Examination
from cjt_gym.gap.evidence import Evidence, Regime
from cjt_gym.joint import JointFile
from cjt_gym.records import Record, write_record

SCHEMA = 1
EVEN_CHANCE = 0.5
"""Confidence below which no effect counts as confirmed."""
MUCH_LEFT = "much stays unexplained beside it"
LEVELLESS = "nothing shows the level to which it falls"
"""Doubts about an effect that the stages and the search have in common."""
ENOUGH = "No further record is needed."
TOO_FAR_OFF = "datasheet values that are further off than their tolerances"
NOTHING_LEFT = "In every stage the rest is small, or what noise and tolerances explain."


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval.

    Attributes:
        value: The number.
        low: Low end.
        high: High end.
        unit: Unit of all three.
    """

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class NamedEffect:
    """An effect that explains part of the gap.

    Attributes:
        name: Name in the effect table.
        stage: Stage in which it appears.
        body: motor, gear or load, or None.
        channel: Channel, or None.
        parameters: Its numbers.
        status: "confirmed" or "tentative".
        confidence: Probability that the name is right.
        gap_removed: Share of its stage's gap that it removes.
        confusable_with: Effects that explain nearly as much.
        lead: Evidence by which the explanation leads the best one without this effect.
        worth: Reduction of held-out residuals relative to the change that the effect makes: 1 for
            a true effect; None for a sensor, or if no held-out record excites it.
        doubt: Why it is only tentative; empty if it is confirmed.
    """

    name: str
    stage: str
    body: str | None
    channel: str | None
    parameters: Mapping[str, Interval]
    status: str
    confidence: float
    gap_removed: float
    confusable_with: tuple[str, ...] = ()
    lead: float = 0.0
    worth: float | None = None
    doubt: str = ""

    def doubted(self, why: str) -> NamedEffect:
        """Return the effect as a tentative one, for this reason or one that it has already."""
        chance = min(self.confidence, EVEN_CHANCE)
        return replace(self, status="tentative", confidence=chance, doubt=self.doubt or why)

    def or_else(self, others: Iterable[str]) -> NamedEffect:
        """Return the effect with others that may take its place."""
        rivals = dict.fromkeys((*self.confusable_with, *others))
        return replace(self, confusable_with=tuple(rivals))


def told_symbols(effects: Iterable[NamedEffect]) -> set[str]:
    """Return the symbols of the numbers that effects tell."""
    return {symbol for effect in effects for symbol in effect.parameters}


@dataclass(frozen=True)
class StageGap:
    """A stage's normalised residual: 1 is the level of the specified noise.

    Attributes:
        before: Its rms with the nominal joint.
        after: Its rms with the named effects.
        significant: Whether there is a gap beyond the tolerances.
    """

    before: float
    after: float
    significant: bool


@dataclass(frozen=True)
class Unexplained:
    """The unexplained remainder of the gap.

    Attributes:
        share: Largest unexplained share of a stage's gap.
        stage: That stage, or None.
        text: Description.
        predictable: Share of the motion that a regression predicts and no named effect explains.
        missing: Sentences on what missing channels leave open.
    """

    share: float
    stage: str | None
    text: str
    predictable: float = 0.0
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Horizon:
    """Prediction error of a channel at one horizon, on held-out data.

    Errors are relative to the channel's departure within the window from motion at its initial
    speed (angles), or to its deviation from the mean (torque).

    Attributes:
        seconds: Horizon [s].
        channel: Predicted channel.
        datasheet: Error of the nominal joint.
        least_squares: Error of a regression on inertia, damping, Coulomb friction and offset; None
            if the record does not allow it.
        found: Error of the joint of this diagnosis.
        floor: Error that no model could avoid; None if it cannot be determined.
    """

    seconds: float
    channel: str
    datasheet: float
    least_squares: float | None
    found: float
    floor: float | None


@dataclass(frozen=True)
class Suggestion:
    """What to record next.

    Attributes:
        text: Description.
        record: Excitation file, or None.
        excitation: Contents of that file: commands over time, or None.
    """

    text: str
    record: str | None = None
    excitation: Record | None = field(default=None, repr=False)

    def written(self, path: str | Path) -> Suggestion:
        """Write the excitation, if there is one, and return the suggestion with its file name.

        Args:
            path: File to write, such as ``next.npz``; its metadata go to ``next.toml`` beside it.
        """
        if self.excitation is None:
            return self
        return replace(self, record=str(write_record(self.excitation, path)))


@dataclass(frozen=True)
class GapSize:
    """The replay error on held-out data, relative to the rms of the signal.

    Attributes:
        before: With the nominal joint.
        after: With the effects added.
        floor: Error that sensor noise alone would cause.
        removed: Share of the error that was removed.
        low: Low end of its 95 % interval.
        high: High end of its 95 % interval.
        held_out: Whether the data were withheld from the fit.
        by_channel: Errors before and after, by channel.
    """

    before: float
    after: float
    floor: float
    removed: float
    low: float
    high: float
    held_out: bool
    by_channel: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where the gap is, why, and how far it shrinks.

    Attributes:
        verdict: "no_gap", "explained", "partly_explained" or "unexplained".
        stages: Residuals of drive, motor, transmission, sensing and load.
        regimes: Where the gap lies in the operating range.
        effects: Effects that explain it, ordered by the share of the gap removed.
        gap: How far it shrinks on held-out data.
        unexplained: The unexplained remainder.
        suggestion: What to record next.
        seconds: Duration of the diagnosis [s].
        evidence: Arrays for a report.
        joint: The nominal joint with the effects added; `cjt_gym.joint.to_toml` writes it.
        horizons: Prediction errors of the joint at several horizons.
        examination: What the record can and cannot tell.
        moved: Symbols of datasheet values that the joint has otherwise and no effect tells.
    """

    verdict: str
    stages: Mapping[str, StageGap]
    regimes: tuple[Regime, ...]
    effects: tuple[NamedEffect, ...]
    gap: GapSize
    unexplained: Unexplained
    suggestion: Suggestion
    seconds: float
    evidence: Evidence
    joint: JointFile
    horizons: tuple[Horizon, ...] = ()
    examination: Examination | None = None
    moved: tuple[str, ...] = ()

    def without_gap(self) -> Diagnosis:
        """Return this diagnosis with the verdict that there is no gap, in no stage."""
        stages = {name: replace(one, significant=False) for name, one in self.stages.items()}
        enough = Suggestion(ENOUGH)
        return replace(self, verdict="no_gap", effects=(), stages=stages, suggestion=enough)

    def to_dict(self) -> dict[str, object]:
        """Return the content of diagnosis.json: plain types, finite numbers."""
        plain = {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "where": {
                "stages": {name: vars(stage) for name, stage in self.stages.items()},
                "regimes": [vars(regime) for regime in self.regimes],
            },
            "effects": [_effect(effect) for effect in self.effects],
            "gap": vars(self.gap),
            "unexplained": vars(self.unexplained),
            "suggestion": {"text": self.suggestion.text, "record": self.suggestion.record},
            "seconds": self.seconds,
            "horizons": [vars(horizon) for horizon in self.horizons],
            "record": None if self.examination is None else self.examination.to_dict(),
            "joint": self.evidence.source.joint,
            "structure": self.evidence.source.structure,
            "fitted": list(self.evidence.source.fitted),
            "held_out": list(self.evidence.source.held_out),
        }
        cleaned = _plain(plain)
        assert isinstance(cleaned, dict)
        return cleaned

    def __str__(self) -> str:
        """Return the verdict, a table of the effects and what to do next, as plain text."""
        from cjt_gym.gap.report.summary import summary

        return summary(self)

    def __repr__(self) -> str:
        """Return the verdict and the names of the effects."""
        names = ", ".join(effect.name for effect in self.effects) or "no effect"
        return f"<Diagnosis: {self.verdict}, {names}>"

    def _repr_html_(self) -> str:
        """Return the verdict and a table of the effects, for a notebook."""
        from cjt_gym.gap.report.summary import face

        return face(self)


def _effect(effect: NamedEffect) -> dict[str, object]:
    row = dict(vars(effect))
    row["parameters"] = {name: vars(p) for name, p in effect.parameters.items()}
    row["confusable_with"] = list(effect.confusable_with)
    return row


def _plain(value: object) -> object:
    """Convert NumPy scalars in a value to Python's, and replace non-finite numbers by 0."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.bool_ | bool):
        return bool(value)
    if isinstance(value, np.integer | int):
        return int(value)
    if isinstance(value, np.floating | float):
        return float(value) if math.isfinite(value) else 0.0
    return value
