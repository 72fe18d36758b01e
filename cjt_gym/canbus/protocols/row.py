"""Rows of the table of protocols, and settings from the table `[drive]` of a configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, Final, Literal

from cjt_gym.canbus.protocols.contract import Limits, Master, Scaling, Settings
from cjt_gym.canbus.protocols.firmware import Firmware
from cjt_gym.canbus.protocols.layout import Field
from cjt_gym.canbus.tables import Section
from cjt_gym.errors import ConfigurationError, check_range, unknown_name


@dataclass(frozen=True)
class Option:
    """An option of a protocol.

    Attributes:
        default: Default value, which also gives the type.
        text: Description.
        choices: Allowed values, as a tuple or range; empty for any value of the type.
    """

    default: Any
    text: str
    choices: Sequence[Any] = ()


@dataclass(frozen=True)
class Register:
    """A frame, register or object of a protocol, for its documentation.

    Attributes:
        address: Its address as the manufacturer writes it.
        direction: "to drive", "from drive" or "both".
        name: Its name in the manufacturer's document.
        fields: Its fields.
        text: Remarks.
    """

    address: str
    direction: str
    name: str
    fields: Sequence[Field] = ()
    text: str = ""


@dataclass(frozen=True)
class DriveProtocol:
    """A drive protocol, as the rest of the package sees it.

    Attributes:
        name: Its name in a configuration.
        title: Its full name.
        side: Shaft of its angles and torques: that of the motor or of the gear's output.
        before: What must be set in the drive first, with the manufacturer's tools.
        fd: Whether it needs CAN FD.
        nodes: Range of addresses.
        options: Its own options.
        check: Raises ConfigurationError if options contradict each other.
        command_enables: Whether any command switches the power stage on.
        master: Makes the master.
        firmware: Makes the firmware.
        registers: Entries of its documentation.
    """

    name: str
    title: str
    side: Literal["motor", "output"]
    before: str
    nodes: tuple[int, int]
    master: Callable[[Settings], Master]
    firmware: Callable[[Settings], Firmware]
    registers: Callable[[], Sequence[Register]] = tuple
    options: Mapping[str, Option] = field(default_factory=dict)
    check: Callable[[Mapping[str, Any]], None] | None = None
    fd: bool = False
    command_enables: bool = False


COMMON: Final = ("protocol", "node", "gear_ratio", "sign", "offset", "torque_constant", "unwatched")


def settings_of(
    protocol: DriveProtocol,
    drive: Mapping[str, Any],
    *,
    n: float = 1.0,
    period: float = 2e-3,
    watchdog: float = 0.05,
    limits: Limits | None = None,
    owner: str = "[drive]",
) -> Settings:
    """Return the settings for the table `[drive]` of a configuration.

    Args:
        protocol: The protocol.
        drive: The table: `node`, `gear_ratio`, `sign`, `offset` [rad, drive's shaft],
            `torque_constant` [N m/A, drive's shaft], `unwatched` and the options of the protocol.
        n: Gear ratio of the joint, used for a protocol that counts at the motor.
        period: Time between two commands [s].
        watchdog: Time without a command after which the drive must stop by itself [s].
        limits: Limits of the emulated drive.
        owner: Name of the table in error messages.

    Raises:
        ConfigurationError: A value is not valid.
        UnknownNameError: A key is unknown.
    """
    known = (*COMMON, *protocol.options)
    if wrong := [key for key in drive if key not in known]:
        raise unknown_name(f"key of {owner}", wrong[0], known)
    given = Section(drive, owner)
    options = {
        name: _option(f"{name} of {owner}", option, drive.get(name, option.default))
        for name, option in protocol.options.items()
    }
    if protocol.check is not None:
        protocol.check(options)
    if (sign := drive.get("sign", 1)) not in (1, -1):
        raise ConfigurationError(f"sign of {owner} must be 1 or -1, got {sign!r}.")
    scaling = Scaling(
        gear_ratio=given.number("gear_ratio", "", default=n if protocol.side == "motor" else 1.0),
        sign=sign,
        offset=given.number("offset", "rad", above=-inf, default=0.0),
        torque_constant=given.number("torque_constant", "N m/A", default=None),
    )
    node, unwatched = given.whole("node", *protocol.nodes, 1), given.flag("unwatched", False)
    return Settings(node, scaling, period, watchdog, options, limits or Limits(), unwatched)


def _option(what: str, option: Option, value: Any) -> Any:
    kind = type(option.default)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind is tuple and isinstance(value, list):
        value = tuple(value)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ConfigurationError(f"{what} must be a {kind.__name__}, got {value!r}.")
    if option.choices and value not in option.choices:
        if isinstance(option.choices, range):
            check_range(what, value, low=option.choices[0], high=option.choices[-1])
        known = ", ".join(map(str, option.choices))
        raise ConfigurationError(f"{what} must be one of {known}, got {value!r}.")
    return value
