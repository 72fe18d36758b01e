"""Training configurations: TOML files, validated."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

from cjt_gym.baselines.gains import Choice, choose_listed
from cjt_gym.disk import read_toml
from cjt_gym.envs.arguments import complete
from cjt_gym.errors import (
    ConfigurationError,
    MissingFileError,
    check_name,
    check_range,
    did_you_mean,
    unknown_name,
)

ALGORITHMS = ("PPO", "SAC", "TQC", "RecurrentPPO")
ACTIVATIONS = ("tanh", "relu", "elu")
BASE_GAINS = "base_gains"
VALIDATION_SEEDS = 500_000
"""Where seeds of the evaluations during training begin; see also `EVALUATION_SEEDS`."""


@dataclass(frozen=True)
class PolicyConfig:
    """The network, section [policy].

    Attributes:
        net_arch: Units of each hidden layer, for actor and critic each.
        activation: One of `ACTIVATIONS`.
        log_std_init: Logarithm of the first standard deviation of actions (PPO, RecurrentPPO).
        lstm_hidden_size: Units of the recurrent layer (RecurrentPPO).
        noise_weight: Weight of the penalty on what the noise of the sensors does to the action,
            see `cjt_gym.training.learning.quiet` (PPO); it takes the place of the entropy's,
            `ent_coef`.
    """

    net_arch: tuple[int, ...] = (64, 64)
    activation: str = "tanh"
    log_std_init: float = 0.0
    lstm_hidden_size: int = 64
    noise_weight: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "net_arch", tuple(self.net_arch))
        if not self.net_arch or any(type(n) is not int or n < 1 for n in self.net_arch):
            raise ConfigurationError(
                f"net_arch of [policy] must list whole numbers >= 1, got {list(self.net_arch)}."
            )
        check_name("activation", self.activation, ACTIVATIONS)
        check_range("lstm_hidden_size of [policy]", self.lstm_hidden_size, low=1, whole=True)
        check_range("noise_weight of [policy]", self.noise_weight, low=0.0)


@dataclass(frozen=True)
class EvaluationConfig:
    """Evaluations during training, section [evaluation]; the best model is the one kept.

    Attributes:
        every: Steps between two of them.
        episodes: Episodes of each, on seeds that training does not see.
        patience: After how many evaluations in a row without a better model the training stops
            early; 0 for never.
    """

    every: int = 100_000
    episodes: int = 32
    patience: int = 0

    def __post_init__(self) -> None:
        check_range("every of [evaluation]", self.every, low=1, whole=True)
        check_range("episodes of [evaluation]", self.episodes, low=1, whole=True)
        check_range("patience of [evaluation]", self.patience, low=0, whole=True)


@dataclass(frozen=True)
class DatasheetsConfig:
    """Joints of other datasheets, section [datasheets]; see `joint_families`.

    Attributes:
        count: How many; 0 trains on the joint of [env] alone.
        frequency: Of motor and gear on the spring, lowest and highest [Hz].
        friction: Coulomb friction over a tenth of the peak torque, least and most [-].
        noise: Of the torque sensor, over the torque amplitude, least and most [-].
    """

    count: int = 0
    frequency: tuple[float, float] = (9.0, 150.0)
    friction: tuple[float, float] = (0.0, 0.4)
    noise: tuple[float, float] = (0.003, 0.03)

    def __post_init__(self) -> None:
        check_range("count of [datasheets]", self.count, low=0, whole=True)
        for name, least in (("frequency", 1.0), ("friction", 0.0), ("noise", 1e-6)):
            pair: Any = getattr(self, name)
            good = isinstance(pair, (list, tuple)) and len(pair) == 2
            good = good and all(isinstance(x, (int, float)) and math.isfinite(x) for x in pair)
            if not good or not least <= pair[0] <= pair[1]:
                raise ConfigurationError(
                    f"{name} of [datasheets] must be two numbers, lowest and highest, >= {least}, "
                    f"got {pair!r}."
                )
            object.__setattr__(self, name, (float(pair[0]), float(pair[1])))


@dataclass(frozen=True)
class TrainConfig:
    """One training.

    Attributes:
        algorithm: One of `ALGORITHMS`.
        total_steps: Control steps of all environments together.
        seed: Seed of networks and environments, below 500000.
        num_envs: Environments in the batch.
        device: Where torch computes, "cpu" or "cuda".
        threads: Threads of torch. The demonstration on 2 cores made 9400 and 9900 steps/s with
            one thread, 9800 with two, and 900 with two while another program ran beside it; so
            one is the default.
        checkpoint_every: Steps between two checkpoints.
        normalize_observations: Whether observations are scaled by their running statistics.
        normalize_rewards: Whether rewards are scaled by the running spread of returns.
        start_from: Run folder whose best model the training starts from, with its own steps and
            learning rate; None starts from scratch.
        env: Arguments of `TorqueTrackingEnv`; `base_controller` is a name of `CONTROLLERS` or a
            gain file, and `base_gains` are gains that replace some of its own, by name.
        policy: The network.
        algorithm_options: Arguments of the Stable-Baselines3 class; `learning_rate` and
            `clip_range` may be {start = ..., end = ...} for a linear schedule.
        evaluation: Evaluations during training.
        datasheets: Joints beside that of [env].
    """

    algorithm: str = "PPO"
    total_steps: int = 1_000_000
    seed: int = 0
    num_envs: int = 32
    device: str = "cpu"
    threads: int = 1
    checkpoint_every: int = 200_000
    normalize_observations: bool = False
    normalize_rewards: bool = True
    start_from: str | None = None
    env: Mapping[str, Any] = field(default_factory=dict)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    algorithm_options: Mapping[str, Any] = field(default_factory=dict)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    datasheets: DatasheetsConfig = field(default_factory=DatasheetsConfig)

    def __post_init__(self) -> None:
        check_name("algorithm", self.algorithm, ALGORITHMS)
        for name in ("total_steps", "num_envs", "threads", "checkpoint_every"):
            check_range(name, getattr(self, name), low=1, whole=True)
        check_range("seed", self.seed, low=0, whole=True)
        if self.seed + self.num_envs > VALIDATION_SEEDS:
            raise ConfigurationError(
                f"seed must be below {VALIDATION_SEEDS} - num_envs, so that evaluations see other "
                f"episodes, got {self.seed}."
            )
        for name in ("normalize_observations", "normalize_rewards"):
            if not isinstance(getattr(self, name), bool):
                raise ConfigurationError(
                    f"{name} must be true or false, got {getattr(self, name)}."
                )
        if self.start_from is not None and not isinstance(self.start_from, str):
            raise ConfigurationError(
                f"start_from must be the path of a run folder, got {self.start_from!r}."
            )
        if self.policy.noise_weight > 0.0:
            _check_quiet(self.algorithm, self.algorithm_options)
        _check_datasheets(self)
        environment_arguments(self.env)

    def to_dict(self) -> dict[str, Any]:
        """Return the configuration as plain data, as `from_dict` takes it."""
        return asdict(self)

    def with_changes(self, **changes: Any) -> TrainConfig:
        """Return a copy with some fields replaced; None leaves one as it is."""
        return replace(self, **{k: v for k, v in changes.items() if v is not None})


SECTIONS = {
    "policy": PolicyConfig,
    "evaluation": EvaluationConfig,
    "datasheets": DatasheetsConfig,
}


def from_dict(data: Mapping[str, Any], origin: str) -> TrainConfig:
    """Return the configuration that plain data describe."""
    values = dict(data)
    _check_keys(values, TrainConfig, origin)
    for name, section in SECTIONS.items():
        if name in values:
            _check_table(values[name], name, origin)
            _check_keys(values[name], section, f"[{name}] of {origin}")
            values[name] = section(**values[name])
    for name in ("env", "algorithm_options"):
        if name in values:
            _check_table(values[name], name, origin)
    return TrainConfig(**values)


def load_config(path: str | Path) -> TrainConfig:
    """Read a configuration.

    A joint or a controller that is named by a path is looked for beside the file.

    Args:
        path: A TOML file, or the name of one that ships with the package, such as "demo".

    Raises:
        MissingFileError: There is no such file.
        ConfigurationError: It is not valid.
    """
    file = _find(path)
    data = read_toml(file, ConfigurationError)
    env = data["env"] if isinstance(data.get("env"), dict) else {}
    for key in ("joint", "base_controller"):
        name = env.get(key)
        if isinstance(name, str) and name.endswith(".toml"):
            beside = file.parent / name
            env[key] = str(beside if os.path.isfile(beside) else name)
    before = data.get("start_from")
    if isinstance(before, str) and os.path.isdir(file.parent / before):
        data["start_from"] = str((file.parent / before).resolve())
    return from_dict(data, str(path))


def config_names() -> tuple[str, ...]:
    """Return the names of the configurations that ship with the package."""
    return tuple(sorted(p.stem for p in _shipped().glob("*.toml")))


def environment_arguments(env: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of `TorqueTrackingEnv` for a section [env]."""
    arguments = complete({key: value for key, value in env.items() if key != BASE_GAINS})
    base = base_of(env)
    if base is not None:
        arguments["base_controller"] = base.make
    return arguments


def base_of(env: Mapping[str, Any]) -> Choice | None:
    """Return the base controller of a section [env] with its gains, None where it has none."""
    name, gains = env.get("base_controller"), env.get(BASE_GAINS)
    if gains is not None and (name is None or not isinstance(gains, Mapping)):
        raise ConfigurationError(
            f"{BASE_GAINS} of [env] must be a table of gains of the base_controller {name}, got "
            f"{gains!r}."
        )
    return None if name is None else choose_listed(str(name)).with_gains(gains or {})


def _shipped() -> Path:
    return Path(str(resources.files("cjt_gym.training"))) / "configs"


def _find(path: str | Path) -> Path:
    file = Path(path)
    if os.path.isfile(file):
        return file
    shipped = _shipped() / f"{path}.toml"
    if os.path.isfile(shipped):
        return shipped
    known = config_names()
    raise MissingFileError(
        f"The configuration {path} does not exist.{did_you_mean(str(path), known)} Give the path "
        f"of a TOML file or one of: {', '.join(known)}."
    )


def _check_quiet(algorithm: str, options: Mapping[str, Any]) -> None:
    if algorithm != "PPO":
        raise ConfigurationError(
            f"noise_weight of [policy] must be 0 for {algorithm}: only PPO has the penalty."
        )
    if options.get("ent_coef", 0.0) != 0.0:
        raise ConfigurationError(
            "ent_coef of [algorithm_options] must be 0 beside noise_weight of [policy], which "
            f"takes its place, got {options['ent_coef']}."
        )


def _check_datasheets(config: TrainConfig) -> None:
    count = config.datasheets.count
    if count > 0 and config.num_envs % count != 0:
        raise ConfigurationError(
            f"num_envs must be a multiple of count of [datasheets], {count}, got {config.num_envs}."
        )
    if count > 0 and config.env.get("observe_joint") is not True:
        raise ConfigurationError(
            "observe_joint of [env] must be true with [datasheets], so that a policy can tell the "
            f"joints apart, got {config.env.get('observe_joint')!r}."
        )


def _check_keys(values: Mapping[str, Any], section: type, origin: str) -> None:
    known = [f.name for f in fields(section)]
    for key in values:
        if key not in known:
            raise ConfigurationError(f"{unknown_name('key', key, known)} (in {origin})")


def _check_table(value: Any, name: str, origin: str) -> None:
    if not isinstance(value, Mapping):
        raise ConfigurationError(f"{name} of {origin} must be a table [{name}], got {value!r}.")
