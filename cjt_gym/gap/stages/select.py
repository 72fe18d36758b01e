"""Which effects: forward selection with a beam."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.parallel import side_by_side
from cjt_gym.gap.stages.fit import (
    DEFLATION,
    MOVES,
    Fit,
    Model,
    Problem,
    retuned,
    without,
)
from cjt_gym.gap.stages.merit import LOG_SHARE, MARGIN, RELEASE, STRAIN, evidence, price
from cjt_gym.gap.stages.periodic import command_steps, line_starts, periodic_starts
from cjt_gym.gap.stages.quick import Look
from cjt_gym.joint.kernel.arrays import Floats

BEAM = 2
TRIAL_MOVES = 6
"""Steps of a full fit of a candidate; the winner is fitted to convergence."""
FAMILY_SHARE = 0.4
"""Share of the leader's gain that a law of the same family must show in a rough fit."""
CLOSE = 0.8
"""Share of the best gain in evidence above which a second branch is followed."""
MOST = 6
"""Most effects of a group of stages. A first datasheet may lack dry friction, damping, weight and
play at once: with room for three of them, the fourth was called something outside the table."""
BESIDE = frozenset({"load_friction", "viscous_asym"})
"""Laws of friction that a body may have beside another one."""
LEAST = 0.1
"""Share of the remainder that one more effect must explain."""
LINES = {"i": "drive", "push_m": "motor", "push_l": "load"}
"""Stage in whose residual a wave in time on a channel appears."""
SHORT_LIST = 4
BEYOND, COARSE_BEYOND = 1.2, 1.8
"""Normalised residual of a stage above which causes outside the table are considered, and the same
if a channel is coarse, as rounding errors are not white noise."""
HOPEFUL = 0.3
"""Share of the leader's gain after one step above which a candidate gets further steps."""
EVEN = 20.0
"""Difference in evidence within which models are compared under their own predictors."""
HOLLOW = 0.5
"""Share of its gain that a leader must keep under its own predictor, or others are tried."""
USUAL, STRETCHED = 2.0, 10.0
"""Usual deviations of a datasheet value, and those above which a fit counts as strained."""
NEAR, NEAR_SHARE = 60.0, 0.25
"""Evidence, or share of the best rough fit's gain, by which another may trail it and still be
fitted in full."""


Progress = Callable[[str], None]


def silent(step: str) -> None:
    """Report no progress."""


@dataclass(eq=False)
class Selection:
    """The search over the effects of one record, for those that it can reveal."""

    problem: Problem
    candidates: tuple[Candidate, ...]
    base: Fit  # without any effect
    outside: tuple[Candidate, ...] = ()
    seen: list[Fit] = field(default_factory=list)  # all fits made in full
    until: float = np.inf  # processor time after which no further effect is sought [s]
    beyond: float = BEYOND
    progress: Progress = silent
    untried: list[Fit] = field(default_factory=list)
    """Rough fits of the last round that were not fitted in full, best first."""

    def run(self) -> Fit:
        """Return the best model after forward selection."""
        best = self.base
        for stages in self._groups():
            found = self._search(best, stages, self.candidates)
            other = self._with_other_laws(found, stages)
            if other is not found:
                found = self._search(other, stages, self.candidates)
            best = self._beyond(best, found, stages)
        return retuned(self.problem, best)

    def _groups(self) -> list[tuple[str, ...]]:
        """Return groups of stages to search separately: a measured current separates the drive."""
        names = self.problem.stages.names
        rest = tuple(n for n in names if n != "drive")
        return [("drive",), rest] if "drive" in names else [rest]

    def _with_other_laws(self, best: Fit, stages: tuple[str, ...]) -> Fit:
        """Return a model with other laws of friction where the table leaves a remainder.

        A law is chosen before what acts beside it is known. Only then do the others differ from it;
        the same law is tried again, too, from all its starts.
        """
        if all(best.mean_square[name] < self.beyond**2 for name in stages):
            return best
        for index, effect in enumerate(best.model.effects):
            if effect.family != "friction" or effect.name in BESIDE:
                continue
            laws = [
                h
                for h in self.candidates
                if h.family == "friction" and h.body == effect.body and set(h.touches) & set(stages)
            ]
            rough = self.rough(without(self.problem, best, index), laws)
            tried = [self._tried(fit) for fit in rough[:SHORT_LIST]]
            self.seen += tried
            if not tried:
                continue
            first = max(tried, key=lambda fit: evidence(self.problem, fit))
            one, two = (retuned(self.problem, fit) for fit in (best, first))
            if evidence(self.problem, two) - evidence(self.problem, one) > MARGIN:
                best = two
        return best

    def _beyond(self, start: Fit, best: Fit, stages: tuple[str, ...]) -> Fit:
        """Return the best model with causes outside the table if the table leaves a remainder.

        Such a cause may be added to the effects found or replace any of them.
        """
        if all(best.mean_square[name] < self.beyond**2 for name in stages):
            return best
        pool = [h for h in self.outside if set(h.touches) & set(stages)]
        added = range(len(start.model.effects), len(best.model.effects))
        fits = [best, *(without(self.problem, best, k) for k in added)]
        if len(added) > 1:
            fits.append(start)
        rough = [f for fit in fits for f in self.rough(fit, pool)]
        rough.sort(key=lambda f: -evidence(self.problem, f))
        grown = [
            self.problem.fit(f.model, f.z, TRIAL_MOVES, f.jacobian) for f in rough[:SHORT_LIST]
        ]
        self.seen += grown
        first = max([best, *grown], key=lambda f: evidence(self.problem, f))
        if first is best:
            return best
        more = self._search(first, stages, (*self.candidates, *self.outside))
        one, two = (retuned(self.problem, fit) for fit in (best, more))
        gain = evidence(self.problem, two) - evidence(self.problem, one)
        return two if gain > MARGIN else one

    def _search(self, start: Fit, stages: tuple[str, ...], candidates: Sequence[Candidate]) -> Fit:
        pool = [h for h in candidates if set(h.touches) & set(stages)]
        beam, best = [start], start
        own = [e for e in start.model.effects if set(e.touches) & set(stages)]
        for _ in range(MOST - len(own)):
            if time.process_time() > self.until:
                break
            if self.potential(best, stages) < RELEASE + MARGIN or not self._material(best, stages):
                break
            there = [effect.outside or effect.name for effect in best.model.effects]
            beside = f" beside {' and '.join(there)}" if there else ""
            self.progress(f"trying {len(pool)} effects{beside}")
            grown: list[Fit] = []
            gain = 0.0
            self.untried = []
            for fit in beam:
                more = self.expand(fit, pool)
                grown += more
                behind = evidence(self.problem, fit) - evidence(self.problem, best)
                gain = max([gain, *(g + behind for g in self._gains(fit, more))])
            grown.sort(key=lambda f: -evidence(self.problem, f))
            self.seen += grown
            lead = grown[0].model.effects[-1].touches if grown else stages
            if gain < max(MARGIN, LEAST * self.potential(best, lead)):
                break
            beam = self._promising(self._kept(self._settled(_distinct(grown)), best, gain), best)
            best = beam[0]
        return best

    def potential(self, fit: Fit, stages: Sequence[str]) -> float:
        """Return how much evidence one more effect could add at most."""
        gap = sum(
            self.problem.counts[n]
            / DEFLATION
            * np.log(max(fit.mean_square[n] / self.problem.floor(n), 1.0))
            for n in stages
        )
        strain = self._strain(fit, stages)
        return float(gap + 0.5 * np.sum(strain[strain > 4.0]))

    def _strain(self, fit: Fit, stages: Sequence[str]) -> Floats:
        """Return the squared deviations of the values on which given stages depend."""
        shared = self.problem.shared
        own = [n.unknown.prior and bool(set(n.stages) & set(stages)) for n in shared]
        return np.asarray(np.square(fit.z[: len(shared)][np.array(own, dtype=bool)]))

    def _material(self, fit: Fit, stages: Sequence[str]) -> bool:
        """Return whether enough is left in given stages for a material effect."""
        residual = max((0.5 * np.log(fit.mean_square[n]) for n in stages), default=0.0)
        strain = self._strain(fit, stages)
        return bool(residual > LOG_SHARE or 0.5 * strain[strain > 4.0].sum() > STRAIN)

    def _gains(self, before: Fit, fits: Sequence[Fit]) -> list[float]:
        """Return the gains of fits over a reference fit under the present predictors.

        If the predictors were tuned elsewhere, the reference is also refitted under them.
        """
        moves = TRIAL_MOVES if len(self._places(before)) > 1 else 0
        here = evidence(self.problem, self.problem.fit(before.model, before.z, moves))
        return [evidence(self.problem, f) - here for f in fits]

    def _settled(self, fits: list[Fit]) -> list[Fit]:
        """Return fits, best first, those of similar evidence each under its own predictor.

        The predictor of a model that lacks an effect may be too insensitive to separate its laws.
        """
        if not fits:
            return fits
        top = evidence(self.problem, fits[0])
        even = [f for f in fits[:SHORT_LIST] if evidence(self.problem, f) > top - EVEN]
        if len(even) < 2:
            return fits
        tuned = [(retuned(self.problem, fit), self._sharpness()) for fit in even]
        worth = {id(f): evidence(self.problem, f) + sharp for f, sharp in tuned}
        even = sorted((f for f, _ in tuned), key=lambda f: -worth[id(f)])
        self.problem.stages.tune(self.problem.fields(even[0].model, even[0].z))
        return [*even, *fits[len(even) :]]

    def _kept(self, fits: list[Fit], before: Fit, gain: float) -> list[Fit]:
        """Return fits, best first, with others before a leader whose gain does not last.

        A predictor tuned to a model without the effect can favour one that only desensitises it.
        """
        own = retuned(self.problem, fits[0])
        if evidence(self.problem, own) - evidence(self.problem, before) > HOLLOW * gain:
            return [own, *fits[1:]]
        self.untried.sort(key=lambda f: -evidence(self.problem, f))
        others = [*fits[1:SHORT_LIST], *self.untried[:SHORT_LIST]]
        tuned = [own, *(retuned(self.problem, fit) for fit in others)]
        self.seen += tuned
        return sorted(tuned, key=lambda f: -evidence(self.problem, f))

    def _sharpness(self) -> float:
        """Return the log evidence that the present predictors gain by expecting small errors."""
        gains = self.problem.stages.gains
        return sum(
            -2.0 * self.problem.counts[name] / DEFLATION * float(np.log(gain.std))
            for name, gain in gains.items()
        )

    def _promising(self, fits: list[Fit], before: Fit) -> list[Fit]:
        """Return the fits to continue from: the best, and the next if it is nearly as good."""
        if len(fits) < 2:
            return fits
        worth = [evidence(self.problem, f) - evidence(self.problem, before) for f in fits[:BEAM]]
        near = [f for f, w in zip(fits, worth, strict=False) if w > CLOSE * worth[0]]
        return [fits[0], *(f for f in near if f is not fits[0])]

    # ---- one more effect
    def expand(self, fit: Fit, pool: Sequence[Candidate]) -> list[Fit]:
        """Return the best fits with one more effect than a given fit."""
        quick = self.rough(fit, pool)
        chosen = self._short_list(quick, fit)
        self.untried += [f for f in quick if f not in chosen][:SHORT_LIST]
        return side_by_side(self._tried, chosen)

    def _tried(self, rough: Fit) -> Fit:
        """Return a rough fit after some full steps.

        A drive's laws are fitted to convergence: the free instant at which the drive latches its
        command has absorbed them and must first give way.
        """
        moves = MOVES if rough.model.effects[-1].family == "drive" else TRIAL_MOVES
        return self.problem.fit(rough.model, rough.z, moves, rough.jacobian)

    def rough(self, fit: Fit, pool: Sequence[Candidate]) -> list[Fit]:
        """Return rough fits with one more effect, best first."""
        used = {h.key for h in fit.model.effects}
        free = [
            h
            for h in pool
            if h.key not in used and compatible(fit.model, h) and self._may_help(fit, h)
        ]
        places = self._places(fit)
        self.problem.stages.tune(self.problem.fields(fit.model, places[-1]))
        looks = [self._look(fit, z) for z in places]

        def first(effect: Candidate) -> tuple[float, Look, Fit] | None:
            if time.process_time() > self.until and effect is not free[0]:
                return None
            found = [
                (evidence(self.problem, one), look, one)
                for look in looks
                if (one := look.first(effect, self._starts(look.fit, effect))) is not None
            ]
            return max(found, key=lambda row: row[0], default=None)

        firsts = [row for row in side_by_side(first, free) if row is not None]
        if not firsts:
            return []
        before = evidence(self.problem, looks[0].fit)
        top = max(value for value, _, _ in firsts)
        limit = min(top - 2.0 * NEAR, before + HOPEFUL * (top - before))

        def refined(row: tuple[float, Look, Fit]) -> Fit:
            value, look, fit = row
            rough = look.refine(fit) if value > limit else fit
            rough.jacobian = look.fit.jacobian
            return rough

        quick = side_by_side(refined, firsts)
        return sorted(quick, key=lambda f: -evidence(self.problem, f))

    def _places(self, fit: Fit) -> list[Floats]:
        """Return the coordinates from which candidates are tried, the most usual ones last.

        A model that lacks a large effect may strain the datasheet so far that the effect would not
        help; candidates are then also tried from near the datasheet.
        """
        known = len(self.problem.shared)
        z = fit.z.copy()
        z[:known] = np.clip(z[:known], -USUAL, USUAL)
        strained = np.abs(fit.z - z).max(initial=0.0) > STRETCHED - USUAL
        return [fit.z, z] if strained else [fit.z]

    def _short_list(self, quick: list[Fit], before: Fit) -> list[Fit]:
        """Return the leading fits, plus the whole friction or drive family if one of it leads."""
        if not quick:
            return []
        top = evidence(self.problem, quick[0])
        base = top - self._gains(before, quick[:1])[0]
        near = max(NEAR, NEAR_SHARE * (top - base))
        chosen = [f for f in quick[:SHORT_LIST] if evidence(self.problem, f) > top - near]
        first = quick[0].model.effects[-1]
        series = self.problem.stages.setting.series
        felt = "tau" in series and "tau" not in series.derived
        if felt and first.name == "damping":  # steps from no friction at all are long
            dry = [f for f in quick if f.model.effects[-1].name == "coulomb"]
            chosen += [f for f in dry if f not in chosen]
        if first.family == "friction":
            chosen += [
                f
                for f in quick
                if f not in chosen
                and f.model.effects[-1].family == "friction"
                and f.model.effects[-1].body == first.body
                and evidence(self.problem, f) > base + FAMILY_SHARE * (top - base)
            ]
        if first.family == "drive":
            chosen += [
                f for f in quick if f not in chosen and f.model.effects[-1].family == "drive"
            ]
        return chosen

    def _may_help(self, fit: Fit, effect: Candidate) -> bool:
        """Return whether the remainder in the stages that an effect touches can justify it."""
        enough = self.potential(fit, effect.touches) > price(Model((effect,))) + MARGIN
        return enough and self._material(fit, effect.touches)

    def _look(self, fit: Fit, z: Floats) -> Look:
        again = self.problem.fit(fit.model, z, moves=0 if z is not fit.z else MOVES)
        again.jacobian = self.problem.jacobian(fit.model, again.z, again.residuals)
        return Look(self.problem, again)

    def _starts(self, fit: Fit, effect: Candidate) -> tuple[tuple[float, ...], ...]:
        fields = self.problem.fields(fit.model, fit.z)
        stages = self.problem.stages
        residuals = stages.first(fit.residuals)
        if effect.search == "step":
            return command_steps(stages, fields)
        if effect.search in LINES:
            stage = LINES[effect.search]
            return line_starts(residuals[stage], stages.setting.series.dt)
        if effect.search is not None:
            found = periodic_starts(stages, fields, residuals["motor"], effect.search)
            return (*found, effect.listed) if effect.listed else found
        return effect.starts


def compatible(model: Model, effect: Candidate) -> bool:
    """Return whether an effect is compatible with those of a model: one friction law per body."""
    for other in model.effects:
        both = {other.name, effect.name}
        friction = other.family == effect.family == "friction" and other.body == effect.body
        if friction and not both & BESIDE:
            return False
        if other.releases is not None and other.releases == effect.releases:
            return False
    return True


def _distinct(fits: Sequence[Fit]) -> list[Fit]:
    seen: set[frozenset[object]] = set()
    out = []
    for fit in fits:
        key = frozenset(h.key for h in fit.model.effects)
        if key not in seen:
            seen.add(key)
            out.append(fit)
    return out
