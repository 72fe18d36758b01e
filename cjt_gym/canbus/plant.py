"""A real or emulated joint with the interface of a simulated plant."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Self, final

import numpy as np

from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.link import Link
from cjt_gym.canbus.safety import State
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant import Limits
from cjt_gym.plant.measurement import Measurement


@final
class CanPlant:
    """One joint on a CAN bus as a plant: a `CanArm` with a single joint.

    Attributes:
        config: Configuration of the joint.
        whole: The `CanArm` that runs the loop.
        joint: Its joint, with latest values, safety and timing.
    """

    def __init__(
        self,
        config: HardwareConfig,
        link: Link | None = None,
        record: str | Path | None = None,
    ) -> None:
        """Prepare without touching the bus.

        Args:
            config: Configuration of the joint.
            link: Connection to the bus; python-can's bus as configured by default.
            record: File for the record of the run, or None.
        """
        self.config = config
        self.whole = CanArm([config], link, record)
        (self.joint,) = self.whole.joints

    @property
    def dt(self) -> float:
        """Control step [s]."""
        return self.whole.dt

    @property
    def limits(self) -> Limits:
        """Limits of commands and measurements."""
        return self.joint.limits

    @property
    def link(self) -> Link:
        """Connection to the bus."""
        return self.whole.link

    @property
    def state(self) -> State:
        """State of the joint."""
        return self.joint.state

    def connect(self) -> None:
        """Open the bus, configure the nodes, and wait for a value of every channel."""
        self.whole.connect()

    def arm(self) -> None:
        """Arm the joint without moving it."""
        self.whole.arm()

    def reset(self, seed: int | None = None) -> Measurement:
        """End the current run softly, and return the measurement for the start of the next."""
        return self.whole.reset(seed)[0]

    def step(self, command: Floats, tau_ref: float = math.nan) -> Measurement:
        """Command a motor torque for one control period and return the next measurement."""
        return self.whole.step(command, np.array([tau_ref]))[0]

    def stop(self) -> None:
        """End a run: fade the torque out and switch the drive off. The joint stays armed."""
        self.whole.stop()

    def fail(self, kind: str, text: str) -> None:
        """End the run with a fault that the caller found."""
        self.whole.fail(kind, text)

    def close(self) -> None:
        """End a run, complete the record and release the bus; see `CanArm.close`."""
        self.whole.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()
