"""The robots that ship: their MuJoCo models and the joints that actuators move."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from cjt_gym.errors import ConfigurationError, check_name


@dataclass(frozen=True)
class Robot:
    """A robot and the task of its environment.

    Attributes:
        name: Name of its model, data/NAME.xml.
        posture: Angles between which each actuated joint is asked to go, by name [rad].
        start: Angles of other joints at the start, by name [rad or m].
        lowest: Height of the body "trunk" below which it has fallen [m]; None if it cannot fall.
    """

    name: str
    posture: Mapping[str, tuple[float, float]]
    start: Mapping[str, float]
    lowest: float | None = None


ROBOTS = {
    robot.name: robot
    for robot in (
        Robot("arm", {"elbow": (-1.2, 1.2)}, {}),
        Robot("leg", {"hip": (0.3, 0.9), "knee": (-1.8, -0.6)}, {"rail": 0.0}, lowest=0.25),
    )
}


def get_robot(name: str) -> Robot:
    """Return the robot of that name.

    Raises:
        UnknownNameError: There is none.
    """
    check_name("robot", name, ROBOTS)
    return ROBOTS[name]


def mujoco() -> Any:
    """Return MuJoCo's module.

    Raises:
        ConfigurationError: It is not installed.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise ConfigurationError(
            'Robots need MuJoCo, which is not installed: pip install "cjt-gym[robots]".'
        ) from error


def load_model(name: str) -> Any:
    """Return a new `mujoco.MjModel` of a robot that ships, a row of `ROBOTS`; its step is 1 ms.

    Raises:
        UnknownNameError: The name is unknown.
    """
    text = (files(__package__) / "data" / f"{get_robot(name).name}.xml").read_text("utf-8")
    return mujoco().MjModel.from_xml_string(text)
