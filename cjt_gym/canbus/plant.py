"""A real joint, or an emulated one, behind the contract of simulated plants."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.link import Link
from cjt_gym.canbus.safety import State
from cjt_gym.plant import Limits, Measurement

Floats = NDArray[np.float64]


@final
class CanPlant:
    """One joint on a CAN bus, as a plant: the only joint of a `CanArm`, which see.

    Attributes:
        config: The joint on its bus.
        whole: The bus with its one joint, and the loop that runs it.
        joint: That joint: latest values, safety, regularity.
    """

    def __init__(
        self,
        config: HardwareConfig,
        link: Link | None = None,
        record: str | Path | None = None,
        **facts: Any,
    ) -> None:
        """Prepare, without touching the bus.

        Args:
            config: The joint on its bus.
            link: The way to it; by default python-can's bus as configured.
            record: Where the record of the run is written; None for none.
            **facts: What else belongs to the record's provenance.
        """
        self.config = config
        self.whole = CanArm([config], link, record)
        (self.joint,) = self.whole.joints
        self.joint.record.know(**facts)

    @property
    def dt(self) -> float:
        """Control step [s]."""
        return self.whole.dt

    @property
    def limits(self) -> Limits:
        """What may be commanded and borne."""
        return self.joint.limits

    @property
    def link(self) -> Link:
        """The way to the nodes.

        Raises:
            HardwareError: It is not connected.
        """
        return self.whole.link

    @property
    def state(self) -> State:
        """State of the joint."""
        return self.joint.state

    def connect(self) -> None:
        """Open the bus, set the nodes up, and wait until every channel was heard."""
        self.whole.connect()

    def arm(self) -> None:
        """Allow the joint to be moved; it still is not."""
        self.whole.arm()

    def reset(self, seed: int | None = None) -> Measurement:
        """End a run that is on, softly, and return the measurement with which another begins."""
        return self.whole.reset(seed)[0]

    def step(self, command: Floats, tau_ref: float = math.nan) -> Measurement:
        """Command a motor torque for one control step and return the next measurement.

        Args:
            command: Motor torque [N m], shape (1,); it is limited, and so is its rate.
            tau_ref: Joint torque that was wanted [N m], for the record.

        Raises:
            HardwareFault: Something went wrong; the torque is off.
            HardwareError: The joint is not armed.
        """
        return self.whole.step(command, np.array([tau_ref]))[0]

    def stop(self) -> None:
        """End a run softly: fade the torque out and switch the drive off; the joint stays armed."""
        self.whole.stop()

    def fail(self, kind: str, text: str) -> None:
        """End the run with a fault that was found elsewhere.

        Raises:
            HardwareFault: Always, where a run was on.
        """
        self.whole.fail(kind, text)

    def close(self) -> None:
        """End a run, complete the record and release the bus; see `CanArm.close`."""
        self.whole.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()
