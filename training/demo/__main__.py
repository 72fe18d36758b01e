"""The demonstration: `python -m cjt_gym.training.demo --out demo`.

It replays a recording of a real drive, trains a residual torque policy for a joint with friction,
ripple, delay and noise, compares it with the controller it stands on and with the open loop on
held-out episodes, and writes `report.html`. The figures are whatever they come out as.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cjt_gym.datasheet.blocks import Block
from cjt_gym.datasheet.drawing import INK, canvas
from cjt_gym.disk import write_text
from cjt_gym.errors import CjtGymError
from cjt_gym.training import report
from cjt_gym.training.benchmark import align, cells_of, make_agents
from cjt_gym.training.demo.emps import UNITS, Replay, replay, summary
from cjt_gym.training.evaluation.evaluate import Evaluation, evaluate
from cjt_gym.training.evaluation.metrics import bootstrap_ratio
from cjt_gym.training.evaluation.rollout import ControllerAgent
from cjt_gym.training.learning.config import TrainConfig, load_config
from cjt_gym.training.learning.policy_arguments import conditions_of
from cjt_gym.training.learning.run_folder import RunFolder
from cjt_gym.training.learning.train import train
from cjt_gym.training.learning.validation import validation_error
from cjt_gym.training.report import figures

EPISODES = 64  # of each task, unless told otherwise
RUN = "residual_policy"
SHOWN = ("smooth", "step")
FULL_SPAN = 8.0  # of the record that is drawn [s]


@dataclass(frozen=True)
class Outcome:
    """What the demonstration found."""

    replay: Replay  # the real drive
    run: RunFolder
    evaluations: Sequence[Evaluation]  # of the open loop, the base and the policy
    levels: dict[str, float]  # error on the validation episodes of those that do not learn [N m]
    seconds: dict[str, float]  # what each part took [s]


def run_demo(config: TrainConfig, out: Path, episodes: int = EPISODES) -> Outcome:
    """Do everything but the report."""
    clock = {"begin": time.monotonic()}
    _say("1. the real EMPS drive, replayed in closed loop")
    replayed = replay()
    clock["replay"] = time.monotonic()
    _say("2. training a residual policy")
    run = train(config, out / RUN)
    clock["training"] = time.monotonic()
    _say("3. held-out episodes")
    base = str(config.env["base_controller"])
    agents, conditions = make_agents(["open_loop", base], [run.path]), conditions_of(config)
    evaluations = [evaluate(a, conditions, episodes=episodes, report=_say) for a in agents]
    shown = [ControllerAgent(name) for name in ("open_loop", base)]
    levels = {agent.name: validation_error(config, agent, agent.base()) for agent in shown}
    clock["comparison"] = time.monotonic()
    marks = list(clock.items())
    seconds = {name: end - marks[k][1] for k, (name, end) in enumerate(marks[1:])}
    return Outcome(replayed, run, evaluations, levels, seconds)


def comparison(evaluations: Sequence[Evaluation]) -> list[list[str]]:
    """Return how the last agent's error compares with each other one's, as cells of a table."""
    policy = evaluations[-1]
    cells = [["policy against", "task", "error ratio", "95 % interval"]]
    for other in evaluations[:-1]:
        for task in policy.traces:
            ratio = bootstrap_ratio(policy.traces[task], other.traces[task])
            cells.append([other.agent, task, *_ratio(ratio)])
        ratio = bootstrap_ratio(policy.pooled(), other.pooled())
        cells.append([other.agent, "all", *_ratio(ratio)])
    return cells


def _verdict(evaluations: Sequence[Evaluation]) -> str:
    """Say in words what the policy gains over its base, and what it costs."""
    policy, base = evaluations[-1], evaluations[-2]
    ratio, low, high = bootstrap_ratio(policy.pooled(), base.pooled())
    better, worse = "lowers", "raises"
    gain = f"{better if ratio < 1.0 else worse} the error by {100.0 * abs(1.0 - ratio):.0f} %"
    doubt = "" if high < 1.0 or low > 1.0 else ", which could be chance"
    noise = [e.rows[0].noise_amplification for e in (policy, base)]
    return (
        f"Over all tasks the policy {gain}{doubt}, compared with its base controller. At rest the "
        f"noise of its command is {noise[0]:.1f} times that of the torque sensor; for the base it "
        f"is {noise[1]:.1f} times."
    )


def _ratio(values: tuple[float, float, float]) -> list[str]:
    ratio, low, high = values
    return [f"{ratio:.3f}", f"{low:.3f} .. {high:.3f}"]


def write_report(outcome: Outcome, config: TrainConfig, out: Path) -> Path:
    """Write `report.html` and `metrics.json`; return the first."""
    rows = [row.to_json() for e in outcome.evaluations for row in e.rows]
    metrics = {
        "emps": {"errors": outcome.replay.errors(), "published": outcome.replay.published},
        "benchmark": rows,
        "comparison": comparison(outcome.evaluations),
        "validation": outcome.levels,
        "seconds": outcome.seconds,
    }
    write_text(out / "metrics.json", json.dumps(metrics, indent=2) + "\n")
    parts = [*_replay_part(outcome.replay), *_training_part(outcome, config)]
    parts += _comparison_part(outcome, cells_of(rows))
    return report.write_page(out / "report.html", "Compliant joints: a demonstration", parts)


def _replay_part(result: Replay) -> list[Block]:
    cells = [["relative error [%]", "simulated here", "published"]]
    cells += [
        [name, f"{error:.5f}", f"{result.published[name]:.5f}"]
        for name, error in result.errors().items()
    ]
    return [
        report.heading("1. A real drive, replayed"),
        report.paragraph(
            "EMPS is a motor with a ball screw and a slide. The recorded reference drives the "
            "recorded position controller around the simulated drive, which has the parameters "
            "that the authors of the data published; nothing is fitted here. Their closed-loop "
            "errors, for the same parameters, stand beside ours. They do not say how their "
            "controller was simulated; with a continuous one that starts at rest, instead of the "
            "sampled one and the motion in which the record begins, our force and velocity errors "
            "are 5.7 % and 0.22 %."
        ),
        report.html_table(cells),
        report.figure(
            _emps_figure(result),
            "The first 8 of 24.8 s. Data: A. Janot, M. Gautier, M. Brunot (2019), Data Set and "
            "Reference Models of EMPS, Workshop on Nonlinear System Identification Benchmarks.",
        ),
    ]


def _emps_figure(result: Replay) -> str:
    """Return measured and simulated force, velocity and position, and their differences."""
    with canvas(figures.WIDTH, 5.6) as (figure, written):
        axes = figure.subplots(3, 2, sharex=True, width_ratios=(1.5, 1.0))
        rows = result.t <= FULL_SPAN
        t = result.t[rows]
        for (left, right), (name, unit) in zip(axes, UNITS.items(), strict=True):
            measured, simulated = result.measured[name][rows], result.simulated[name][rows]
            left.plot(t, measured, color=INK, linewidth=1.4, label="measured")
            left.plot(t, simulated, color=figures.COLOURS[1], linewidth=0.8, label="simulated")
            left.set_ylabel(f"{name} [{unit}]")
            scale, prefix = (1e6, "µ") if name == "position" else (1.0, "")
            scale, prefix = (1e3, "m") if name == "velocity" else (scale, prefix)
            right.plot(t, scale * (measured - simulated), color=figures.COLOURS[1], linewidth=0.6)
            right.set_ylabel(f"[{prefix}{unit}]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
        axes[0, 0].set_title("signal", fontsize=9)
        axes[0, 1].set_title("measured minus simulated", fontsize=9)
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        return written()


def _training_part(outcome: Outcome, config: TrainConfig) -> list[Block]:
    env, facts = config.env, outcome.run.facts
    effects = ", ".join(str(name).replace("_", " ") for name in env["effects"])
    return [
        report.heading("2. A policy learns on top of a controller"),
        report.paragraph(
            f"{config.algorithm} trains a torque policy for {env['joint']} "
            f"({str(env['structure']).replace('_', ' ')}) that adds to the command of "
            f"{str(env['base_controller']).replace('_', ' ')}. The joint has these effects: "
            f"{effects}. Every episode draws new parameters. "
            f"{facts['steps']:,} steps took {facts['seconds']:.0f} s."
        ),
        report.figure(
            figures.learning_figure(outcome.run.progress(), outcome.levels),
            "Error on episodes that the training does not see. The model that is best there is "
            "kept, and compared below on other episodes.",
        ),
    ]


def _comparison_part(outcome: Outcome, cells: list[list[str]]) -> list[Block]:
    first = outcome.evaluations[0]
    shown = {
        task: {e.agent: e.traces[task] for e in outcome.evaluations}
        for task in SHOWN
        if task in first.traces
    }
    count = first.rows[0].episodes
    return [
        report.heading("3. Compared on held-out episodes"),
        report.paragraph(
            f"Each task has {count} episodes of 1 s. All see the same joints, references "
            "and noise, none of which occurred in training. Intervals are bootstrapped over "
            "episodes, in pairs where two are compared; they say nothing about how much another "
            "training seed would change."
        ),
        report.html_table(comparison(outcome.evaluations)),
        report.paragraph(_verdict(outcome.evaluations)),
        report.html_table(cells),
        report.paragraph(
            "rmse: error of the true joint torque. nrmse: the same over the rms of the reference. "
            "Bandwidth: where the response falls 3 dB below that at 1 to 2 Hz, in a sweep of full "
            "amplitude. Settling: median time to stay within 10 % of the step. Noise: standard "
            "deviation of the command over that of the torque sensor's noise, without reference. "
            "The last four belong to the controller and repeat over its tasks.",
            note=True,
        ),
        report.figure(figures.traces_figure(shown), "The same episode under each."),
        report.figure(
            figures.response_figure({e.agent: e.sweep for e in outcome.evaluations}),
            "From reference to joint torque, averaged over 8 randomised joints.",
        ),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration, write the report and print a short table."""
    parser = argparse.ArgumentParser(description="Replay, train, compare, report.")
    parser.add_argument("--out", type=Path, default=Path("demo"), help="folder (default: demo)")
    parser.add_argument("--config", default="demo", help="training configuration (default: demo)")
    parser.add_argument("--steps", type=int, help="total_steps instead of that of the file")
    parser.add_argument("--episodes", type=int, default=EPISODES, help="per task (default: 64)")
    options = parser.parse_args(arguments)
    begun = time.monotonic()
    try:
        config = load_config(options.config).with_changes(total_steps=options.steps)
        outcome = run_demo(config, options.out, options.episodes)
        page = write_report(outcome, config, options.out)
    except CjtGymError as error:
        sys.stderr.write(f"demo: {error}\n")
        return 2
    print(summary(outcome.replay))
    print()
    print(align(cells_of([row.to_json() for e in outcome.evaluations for row in e.rows])))
    print()
    print(align(comparison(outcome.evaluations)))
    print()
    print(_verdict(outcome.evaluations))
    print(f"\n{page} written after {time.monotonic() - begun:.0f} s")
    return 0


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
