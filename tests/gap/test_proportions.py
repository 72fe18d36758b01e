"""Numbers over the torque constant, where the scale of all torques is open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cjt_gym.gap.proportions import proportions
from cjt_gym.joint import JointFile, load_joint_file
from cjt_gym.joint.files.quantity import Quantity, freeze

VALUES = {"torque_constant.k_t": 0.5, "stiffness.k_b": 50.0, "load_inertia.I_l": 0.5, "I_m": 0.1}
OWN = {"torque_constant.k_t": 0.0, "stiffness.k_b": 0.02, "load_inertia.I_l": 0.02, "I_m": 0.6}


def found(scale: float) -> JointFile:
    """Return a joint whose torques are open by one relative deviation, and by one of their own."""
    values = np.array(list(VALUES.values()))
    relative = scale**2 + np.diag(np.square(list(OWN.values())))
    table = {
        "names": tuple(VALUES),
        "values": tuple(values.tolist()),
        "matrix": tuple(map(tuple, (relative * np.outer(values, values)).tolist())),
    }
    file = load_joint_file("orange_80_6000")
    units = {"k_t": "N m/V", "k_b": "N m/rad", "I_l": "kg m^2"}
    rows: dict[str, dict[str, Quantity]] = {}
    for name, value in VALUES.items():
        effect, _, symbol = name.rpartition(".")
        if effect:
            rows[effect] = {symbol: Quantity(value, units[symbol])}
    own = {
        **file.parameters.quantities,
        "n": Quantity(10.0, "-"),
        "k_t": Quantity(0.7, "N m/V"),
        "i_p": Quantity(10.0, "V"),
        "I_m": Quantity(0.1, "kg m^2"),
    }
    parameters = replace(file.parameters, quantities=own)
    return replace(file, parameters=parameters, effects=rows, found=freeze({"covariance": table}))


def test_what_a_scale_leaves_open_is_told_in_proportion() -> None:
    said = proportions(found(0.5))
    assert "k_b 10 V/rad (± 3.9 %)" in said
    assert "I_l 0.1 V s^2/rad (± 3.9 %)" in said
    assert "I_m" not in said, "it is open by itself"
    hertz = np.sqrt(50.0 / 0.5) / (2.0 * np.pi)
    assert f"swings at {hertz:.3g} Hz (± 2.8 %)" in said


def test_nothing_is_told_where_the_scale_is_known() -> None:
    assert proportions(found(0.01)) == ""
    assert proportions(load_joint_file("orange_80_6000")) == ""
    drive = found(0.5)
    assert proportions(replace(drive, found=freeze({}))) == ""


def test_without_a_torque_constant_there_is_no_proportion() -> None:
    file, lost = found(0.5), "torque_constant.k_t"
    table = dict(file.found["covariance"])
    kept = [k for k, name in enumerate(table["names"]) if name != lost]
    matrix = np.array(table["matrix"])[np.ix_(kept, kept)]
    table = {
        "names": tuple(table["names"][k] for k in kept),
        "values": tuple(table["values"][k] for k in kept),
        "matrix": tuple(map(tuple, matrix.tolist())),
    }
    assert proportions(replace(file, found=freeze({"covariance": table}))) == ""
