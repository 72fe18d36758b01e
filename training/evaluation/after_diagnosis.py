"""What a diagnosis is worth in a closed loop: for a replay, and for controllers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cjt_gym.errors import CjtGymError, ConfigurationError
from cjt_gym.gap import Diagnosis
from cjt_gym.gap.by_stages import TAIL
from cjt_gym.gap.diagnosis import GapSize
from cjt_gym.gap.report.table import Table
from cjt_gym.gap.report.words import number, percent
from cjt_gym.joint import Joint, JointFile, get_structure
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.records import Record

if TYPE_CHECKING:  # environments and controllers load only where a closed loop is asked for
    from cjt_gym.plant import Law
    from cjt_gym.training.evaluation.performance import Performance, PerformanceGap
    from cjt_gym.training.evaluation.rollout import Agent

DRIVE = "current"
REPEATED = 0.2
"""Share of samples that a sensor may have repeated, which logs mark as missing."""
OURS = ("simulation", "hardware")
"""Kinds of records that the package makes."""
WORLDS = ("nominal", "identified", "recorded")


@dataclass(frozen=True)
class ClosedLoop:
    """A closed-loop replay."""

    controller: str  # what closed the loop
    record: str  # which record was replayed
    gap: GapSize  # how far its gap shrinks


@dataclass(frozen=True)
class InTheLoop:
    """What the nominal and the identified joint do under control."""

    replay: ClosedLoop | None  # the closed-loop replay, where the controller of a record is known
    performance: tuple[PerformanceGap, ...]  # what every agent that was asked for earns
    notes: tuple[str, ...]  # what could not be compared, and why

    def to_dict(self) -> dict[str, Any]:
        """Return what diagnosis.json has of it, as plain data."""
        return {
            "closed_loop": None if self.replay is None else _plain(self.replay),
            "performance": [asdict(gap) for gap in self.performance],
        }

    def tables(self) -> tuple[Table, ...]:
        """Return what a report shows of it."""
        found = []
        if self.replay is not None:
            found.append(_replay_table(self.replay))
        if self.performance:
            found.append(_performance_table(self.performance))
        return tuple(found)


def agents_for(
    controllers: Sequence[str], policies: Sequence[str], records: Sequence[Record]
) -> tuple[Agent, ...]:
    """Return the controllers and policies to compare; none where none is asked for."""
    if not (controllers or policies):
        return ()
    from cjt_gym.training.benchmark import make_agents
    from cjt_gym.training.evaluation.conditions import Conditions

    agents = make_agents(controllers, policies)
    record = _tracking(records)
    if record is None:
        raise ConfigurationError(
            f"--controller and --policy compare what tracks a torque: {records[0].owner} must have "
            "the columns tau_ref and tau [N m] without missing samples. Record the reference too, "
            "or leave the options out."
        )
    for agent in agents:  # so that a policy of another control step is refused before the work
        joint, structure = agent.trained_on or (record.joint or "orange_80_6000", "output_fixed")
        home = Conditions(joint, structure, "current", torque_amplitude=1.0, dt_control=record.dt)
        agent.arguments(home)
    return tuple(agents)


def in_the_loop(
    found: Diagnosis,
    nominal: JointFile,
    structure: str,
    fitted: Sequence[Record],
    held: Sequence[Record],
    agents: Sequence[Agent],
) -> InTheLoop:
    """Replay a record under its controller, and run the agents in both joints.

    The nominal joint is that before the diagnosis. Records that were held back from it are
    preferred to those that were fitted; for the agents see `agents_for`.
    """
    record = _tracking([*held, *fitted])
    if record is None:
        return InTheLoop(None, (), _untracked([*held, *fitted]))
    one, two = (_joint(file, structure) for file in (nominal, found.joint))
    notes: list[str] = []
    replay, gaps = None, []
    try:
        was_fitted = any(record is other for other in fitted)
        record = _held(record)
        replay = _replay(record, one, two, was_fitted, agents)
    except CjtGymError as error:
        notes.append(f"Not replayed in a closed loop: {error}")
    for agent in agents:
        from cjt_gym.training.evaluation.performance import performance_gap

        try:
            gaps.append(performance_gap(record, one, two, agent))
        except CjtGymError as error:
            notes.append(f"{agent.name} not compared: {error}")
    return InTheLoop(replay, tuple(gaps), tuple(notes))


def _tracking(records: Sequence[Record]) -> Record | None:
    """Return the first record that tracks a torque and has all of it, but for repeated samples."""
    for record in records:
        if "tau_ref" not in record or "tau" not in record:
            continue
        tracks = np.any(record["tau_ref"]) and np.isfinite(record["tau_ref"]).all()
        if tracks and np.isnan(record["tau"]).mean() <= REPEATED:
            return record
    return None


def _untracked(records: Sequence[Record]) -> tuple[str, ...]:
    """Return why no record is replayed, where one has a reference all the same."""
    if not any("tau_ref" in record and np.any(record["tau_ref"]) for record in records):
        return ()
    return ("Not replayed in a closed loop: no record has tau_ref and tau without gaps.",)


def _held(record: Record) -> Record:
    """Return a record whose missing samples of the torque are the ones before, as they were."""
    tau, rows = record["tau"], np.arange(len(record))
    known = np.maximum.accumulate(np.where(np.isnan(tau), 0, rows))
    return record.with_columns({"tau": np.nan_to_num(tau[known])})


def _joint(file: JointFile, structure: str) -> Joint:
    effects = resolve_effects(None, file, get_structure(structure), DRIVE)
    return Joint(file, structure, DRIVE, effects)


def _replay(
    record: Record, nominal: Joint, identified: Joint, was_fitted: bool, agents: Sequence[Agent]
) -> ClosedLoop:
    """Return the replay under the record's controller.

    Of a record that was fitted, only the end counts that was kept from the fit.

    Raises:
        ConfigurationError: Nothing counts, or the law of the record is not known.
    """
    from cjt_gym.gap.judged.closed_loop import closed_loop_gap

    begin = int((1.0 - TAIL) * len(record)) if was_fitted else 0
    fading = round(float(record.provenance.get("soft_s", 0.0)) / record.dt)
    if begin >= len(record) - fading:
        unseen, faded = (rows * record.dt for rows in (len(record) - begin, fading))
        raise ConfigurationError(
            f"{record.owner} has {unseen:.3g} s that were not fitted, all of them within the "
            f"fade-out of {faded:.3g} s at its end. Record for longer."
        )
    name, law = recorded_law(record, nominal, agents)
    record = record.slice(stop=len(record) - fading)  # no law commands the fade-out of a run
    sensor = nominal.file.sensors.get("tau", {})
    noise, step = (np.max(sensor[k].value) if k in sensor else 0.0 for k in ("noise", "resolution"))
    scatter = float(np.hypot(noise, step / np.sqrt(12.0)))
    gap = closed_loop_gap(record, nominal, identified, law, scatter, begin)
    return ClosedLoop(name, record.owner, gap)


def recorded_law(record: Record, nominal: Joint, agents: Sequence[Agent]) -> tuple[str, Law]:
    """Return the controller that a record names, else the first one that was given.

    Raises:
        ConfigurationError: The law that made the record is not known.
    """
    from cjt_gym.baselines import get_entry, make_controller
    from cjt_gym.baselines.gains import DESIGNED_ON, law_of_record
    from cjt_gym.baselines.own import is_own
    from cjt_gym.training.evaluation.rollout import ControllerAgent

    made, owner = record.provenance, record.owner
    given = [agent.choice for agent in agents if isinstance(agent, ControllerAgent)]
    if "policy" in made:
        raise ConfigurationError(
            f"{owner} was made with the policy {made['policy']}; only controllers are replayed."
        )
    name = made.get("controller")
    if name is None and given:
        return given[0].name, given[0].make(nominal, record.dt)
    if not isinstance(name, str):
        raise ConfigurationError(
            f"{owner} does not name the controller that made it. Name it: --controller C."
        )
    if is_own(name) and name not in [choice.controller for choice in given]:
        raise ConfigurationError(
            f"{owner} was made with code of your own, which is imported only where you name it: "
            f"--controller {name}."
        )
    if DESIGNED_ON in made:
        return name, law_of_record(record)
    if name == "pd_feedforward" and {"kp", "kd"} <= set(made):
        return name, _pd(record, nominal)
    if made.get("kind") in OURS and get_entry(name).tunable:
        raise ConfigurationError(
            f"{owner} does not say for which joint, and with which gains, {name} was made, as "
            "records now do. Record it again."
        )
    return name, make_controller(name, nominal, record.dt, made.get("gains"))


def _pd(record: Record, nominal: Joint) -> Law:
    """Return PD control with the gains that stand in a record by themselves."""
    from cjt_gym.baselines import PdFeedForward
    from cjt_gym.plant import limits_of

    made = record.provenance
    gain = float(made.get("command_gain", 1.0))
    side, limit = made.get("derivative", "error"), limits_of(nominal).tau / gain
    law = PdFeedForward(made["kp"], made["kd"], record.dt, side, torque_limit=limit)
    law.command_gain = gain
    return law


def _plain(replay: ClosedLoop) -> dict[str, Any]:
    return {"controller": replay.controller, "record": replay.record} | vars(replay.gap)


def _replay_table(replay: ClosedLoop) -> Table:
    gap = replay.gap
    rows = [("channel", "nominal joint", "identified joint")]
    rows += [(n, percent(e["before"]), percent(e["after"])) for n, e in gap.by_channel.items()]
    interval = f"{percent(gap.low)} … {percent(gap.high)}"
    return Table(
        f"Closed-loop replay under {replay.controller}",
        "Error relative to the recorded signal where the controller takes part, on data not "
        "used for the fit.",
        rows,
        (f"{percent(gap.removed)} of the error of tau is removed ({interval}).",),
    )


def _performance_table(gaps: Sequence[PerformanceGap]) -> Table:
    rows: list[tuple[str, ...]] = [
        ("agent", "world", "rmse [N m]", "95 % interval", "reward per step", "terminated")
    ]
    notes = []
    for gap in gaps:
        worlds = [(name, getattr(gap, name)) for name in WORLDS]
        rows += [_world(gap.agent, name, world) for name, world in worlds if world is not None]
        if gap.removed is not None:
            share = f"{percent(max(gap.removed, 0.0))} of the difference of rmse is explained."
            notes.append(f"{gap.agent}: {share}")
        if gap.note:
            notes.append(f"{gap.agent}: {gap.note}")
    return Table(
        "Performance gap",
        "What each controller or policy earns in the nominal and in the identified joint against "
        "the recorded reference, beside what the record shows.",
        rows,
        notes,
    )


def _world(agent: str, name: str, world: Performance) -> tuple[str, ...]:
    spread = f"{number(world.low)} … {number(world.high)}"
    ended = percent(world.terminated)
    return (agent, name, number(world.rmse), spread, number(world.reward), ended)
