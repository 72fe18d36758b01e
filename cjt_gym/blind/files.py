"""Files of a case that a diagnosis is given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cjt_gym.blind.case import Case, Log
from cjt_gym.blind.joints import Datasheet
from cjt_gym.blind.plant import CHANNELS
from cjt_gym.disk import Inline, to_toml
from cjt_gym.records import Record, default_units, write_record

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
        write_record(record_of(case, log), folder / f"{name}.npz")
    return folder


def datasheet_text(sheet: Datasheet, name: str) -> str:
    """Return the joint file of a datasheet."""
    units, sensors = default_units(SENSORS), {}
    for channel in (channel for channel in SENSORS if channel in sheet.channels):
        j = CHANNELS.index(channel)
        step = sheet.resolution[j]
        sensors[channel] = {
            "resolution": _entry(step, units[channel]) if step else None,
            "noise": _entry(sheet.noise[j], units[channel]),
        }
    values = {}
    for symbol in ORDER:
        if sheet.bare and symbol == "d_gl":
            continue
        unit = {"n": "-", "k_t": "N m/A"}.get(symbol) or UNITS[symbol[0]]
        values[symbol] = _entry(sheet.values[symbol], unit, **_known(sheet, symbol))
    sampling = {"dt": _entry(sheet.dt, "s"), "jitter": _entry(sheet.jitter, "s")}
    return to_toml(
        {
            "name": name,
            "source": "datasheet of the joint; tolerance is one sigma, relative",
            "parameters": values | {"i_p": _entry(sheet.i_p, "A")},
            "effects": {"current_lag": {"bandwidth": _entry(sheet.bandwidth, "Hz")}},
            **({} if sheet.bare else {"sensors": sensors, "sampling": sampling}),
        }
    )


def _known(sheet: Datasheet, symbol: str) -> dict[str, Any]:
    """Return the guess or tolerance of a value, as in its entry."""
    if symbol in sheet.guesses:
        return {"guess": True}
    return {} if sheet.bare else {"tolerance": sheet.tolerances.get(symbol)}


def _entry(value: float, unit: str, **known: Any) -> Inline:
    return Inline(value=float(f"{value:.6g}"), unit=unit, **known)


def record_of(case: Case, log: Log) -> Record:
    """Return a record of a case."""
    output = OUTPUTS[case.structure.startswith("output_fixed")]
    return Record(
        log.columns,
        default_units(tuple(log.columns)),
        dt=case.sheet.dt,
        joint="nominal.toml",
        structure=case.structure,
        provenance={"mode": log.mode, "excitation": log.excitation, "output": output},
        allow_nan=True,
    )
