"""The table of controllers: one row each, from which commands, benchmark and tests read them."""

from __future__ import annotations

from importlib import import_module

from cjt_gym.baselines.compose import composed, is_composed
from cjt_gym.baselines.controller import Controller
from cjt_gym.baselines.entry import ControllerEntry, Gains
from cjt_gym.baselines.own import entry_of, is_own, own_entry
from cjt_gym.baselines.parts import PARTS
from cjt_gym.baselines.shipped import gains_of
from cjt_gym.errors import unknown_name
from cjt_gym.joint import Joint
from cjt_gym.plugins import installed_rows

CONTROLLERS: dict[str, ControllerEntry] = {
    name: import_module(f"cjt_gym.baselines.{name}").ROW
    for name in (
        "open_loop",
        "pd",
        "pd_feedforward",
        "integral_feedforward",
        "pid_feedforward",
        "pid_compensation",
        "pid_inner_dob",
        "pid_outer_dob",
        "mass_dob",
        "momentum_dob",
        "passivity",
        "passivity_momentum",
        "cascade",
        "lqi",
        "lqg",
        "observer_feedback",
        "disturbance_rejection",
        "h_infinity",
        "mpc",
        "friction_feedforward",
        "adaptive_friction",
        "ripple_learning",
        "iterative_learning",
        "impedance",
    )
}
for _name, _found in installed_rows("controllers", CONTROLLERS):
    _row = _found if isinstance(_found, ControllerEntry) else entry_of(_name, _name, _found)
    CONTROLLERS[_name] = _row
CONTROLLER_HELP = (
    f"{', '.join(CONTROLLERS)}; parts joined by +, as pid+reference+momentum_dob, of "
    f"{', '.join(PARTS)}; or PATH.py:NAME, code of your own, which is imported"
)
"""How a controller is named on every command line."""


def get_entry(name: str) -> ControllerEntry:
    """Return the row of that name.

    Args:
        name: A row of `CONTROLLERS`, parts that make one (`cjt_gym.baselines.compose`), or
            PATH.py:NAME, code that is imported for it (`cjt_gym.baselines.own`).

    Raises:
        UnknownNameError: There is none; the message suggests the nearest.
        MissingFileError: There is no such file.
        ConfigurationError: The parts do not go together, or the code is not a controller.
    """
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    if is_own(name):
        return own_entry(name)
    if is_composed(name):
        return composed(name)
    raise unknown_name("controller", name, {*CONTROLLERS, *PARTS})


def default_gains(name: str, joint: Joint, dt: float) -> dict[str, float]:
    """Return the gains that a controller takes unless it is given others.

    For some joints they ship with the package (`cjt_gym.baselines.shipped`); for all others they
    are designed on the linear model.

    Args:
        name: See `get_entry`.
        joint: The joint that it is for; delays among its effects are taken into account.
        dt: Sample time [s].

    Raises:
        UnknownNameError: There is none of that name.
        ConfigurationError: The law does not fit the joint or the sample time.
    """
    return gains_of(get_entry(name), joint, dt)


def make_controller(name: str, joint: Joint, dt: float, gains: Gains | None = None) -> Controller:
    """Return the controller of that name.

    Args:
        name: See `get_entry`; or a gain file, FILE.toml or PATH.py:NAME@FILE.toml.
        joint: The joint that it is for.
        dt: Sample time [s].
        gains: Gains that replace its own, by name; see `ControllerEntry.tunable`.

    Raises:
        UnknownNameError: There is no controller, or no gain, of that name.
        MissingFileError: There is no such file.
        ConfigurationError: The law does not fit the joint or the sample time, or a gain is out
            of its range.
    """
    if name.endswith(".toml"):
        from cjt_gym.baselines.gains import choose  # which stands on this table

        return choose(name).with_gains(gains or {}).make(joint, dt)
    entry = get_entry(name)
    entry.check_structure(joint)
    entry.check_gains(gains or {})
    given = entry.complete(gains or {})
    if len(given) < len(entry.tunable):
        given = gains_of(entry, joint, dt) | dict(gains or {})
    return entry.build(joint, dt, given)
