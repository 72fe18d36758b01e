"""Files of a case that a diagnosis is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cjt_gym.blind.case import Case, Log
from cjt_gym.blind.joints import Datasheet
from cjt_gym.blind.plant import CHANNELS
from cjt_gym.records import default_units

UNITS = {"I": "kg m^2", "k": "N m/rad", "d": "N m s/rad"}
ORDER = ("I_m", "I_g", "I_l", "k_g", "k_b", "d_mg", "d_gl", "d_m", "d_g", "d_l", "n", "k_t")
SENSORS = ("q_m", "q_g", "q_l", "tau", "i")
"""Order of the sensors in a joint file."""
OUTPUTS = {
    True: "locked: q_l is measured and nearly constant",
    False: "free: no external load torque, inertia I_l",
}


def write_case(case: Case, folder: str | Path) -> Path:
    """Write nominal.toml, diagnose.npz, validate.npz and their .toml; return the folder.

    They do not reveal what is hidden; the joint is named after the folder.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "nominal.toml").write_text(datasheet_text(case.sheet, folder.name), encoding="utf-8")
    for name, log in (("diagnose", case.diagnose), ("validate", case.validate)):
        np.savez_compressed(folder / f"{name}.npz", **log.columns)  # type: ignore[arg-type]
        (folder / f"{name}.toml").write_text(log_text(case, log), encoding="utf-8")
    return folder


def datasheet_text(sheet: Datasheet, name: str) -> str:
    """Return the joint file of a datasheet."""
    lines = [
        f'name = "{name}"',
        'source = "datasheet of the joint; tolerance is one sigma, relative"',
        "",
        "[parameters]",
    ]
    for symbol in ORDER:
        known = _known(sheet, symbol)
        unit = {"n": "-", "k_t": "N m/A"}.get(symbol) or UNITS[symbol[0]]
        lines.append(_entry(symbol, sheet.values[symbol], unit, known))
    lines.append(_entry("i_p", sheet.i_p, "A"))
    lines += ["", "[effects.current_lag]", _entry("bandwidth", sheet.bandwidth, "Hz"), ""]
    units = default_units(SENSORS)
    for channel in SENSORS:
        if channel in sheet.channels:
            j = CHANNELS.index(channel)
            resolution, noise = sheet.resolution[j], sheet.noise[j]
            lines += [f"[sensors.{channel}]"]
            lines += [_entry("resolution", resolution, units[channel])] if resolution else []
            lines += [_entry("noise", noise, units[channel])]
    lines += ["", "[sampling]", _entry("dt", sheet.dt, "s"), _entry("jitter", sheet.jitter, "s")]
    return "\n".join(lines) + "\n"


def _known(sheet: Datasheet, symbol: str) -> str:
    """Return the guess or tolerance of a value, as written in its entry."""
    if symbol in sheet.guesses:
        return ", guess = true"
    tolerance = sheet.tolerances.get(symbol)
    return "" if tolerance is None else f", tolerance = {tolerance}"


def _entry(key: str, value: float, unit: str, known: str = "") -> str:
    number = float(f"{value:.6g}")
    return f'{key} = {{ value = {number!r}, unit = "{unit}"{known} }}'


def log_text(case: Case, log: Log) -> str:
    """Return the metadata file of a record."""
    units = default_units(tuple(log.columns))
    locked = case.structure.startswith("output_fixed")
    lines = [
        f"dt = {case.sheet.dt}",
        'joint = "nominal.toml"',
        f'structure = "{case.structure}"',
        f'mode = "{log.mode}"',
        f'excitation = "{log.excitation}"',
        f'output = "{OUTPUTS[locked]}"',
        "",
        "[units]",
        *(f'{name} = "{unit}"' for name, unit in units.items()),
    ]
    return "\n".join(lines) + "\n"
