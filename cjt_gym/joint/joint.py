"""A joint: parameters, structure, drive and effects, as one object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cjt_gym.errors import ConfigurationError, ParameterError, SimulationError, check_type
from cjt_gym.joint import linear
from cjt_gym.joint.batch import JointBatch, substeps_of
from cjt_gym.joint.between_rows import until_next
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.configure import (
    EffectSpec,
    EffectValues,
    pack,
    plain_effects,
    resolve_effects,
)
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.files.diagnosed import ranges_of, shares_of
from cjt_gym.joint.files.joint_file import JointFile, load_joint_file
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.kernel.arrays import (
    BODY,
    BRISTLE,
    CHANNELS,
    LAGGED,
    LAW,
    REFERENCE,
    SIGMA,
    WORK_ROWS,
    WORK_WIDTH,
    Floats,
)
from cjt_gym.joint.kernel.control_steps import simulate
from cjt_gym.joint.kernel.drives import DRIVES, get_drive
from cjt_gym.joint.kernel.friction import (
    BRISTLES,
    LOAD,
    bristles,
    level,
    note_friction,
    sliding_friction,
)
from cjt_gym.joint.kernel.load_forces import contact_torque
from cjt_gym.joint.kernel.ripple import ripple_torque
from cjt_gym.joint.outside import PERIODS, frequency_of, is_told, tell_outside
from cjt_gym.joint.structures import Structure, get_structure
from cjt_gym.records import JOINT_FILE, Record, default_units

if TYPE_CHECKING:
    import control

DT_PHYSICS = 1e-5
"""Substep of simulations [s]: a tenth of that of environments, for accuracy."""
CURRENT_FREE = "current"
BEFORE = 0.1
"""Time for which a joint that starts in motion has had its speed [s]."""
DRIVE_SIGNALS = ("i_d", "v", "v_d", "tau_m")
"""What a record holds of a voltage drive beside the current: noise-free, columns `true_...`."""
USUAL_STRUCTURE = "full_dynamics"
version_of = cache(version)
"""Version of a package, read once: reading takes milliseconds."""


@dataclass(frozen=True)
class Joint:
    """One joint as it is simulated, analysed and diagnosed.

    Build it with `load_joint`.

    Attributes:
        file: The joint file: parameters, listed effects, sensors.
        structure: Name of the structure.
        drive: Name of the drive.
        effects: Active effects with all their values.
    """

    file: JointFile
    structure: str
    drive: str
    effects: Mapping[str, EffectValues]

    def __repr__(self) -> str:
        effects = ", ".join(self.effects) or "none"
        return f"<Joint {self.file.name}: {self.structure}, {self.drive}, effects: {effects}>"

    @property
    def parameters(self) -> JointParameters:
        """The validated parameters."""
        return self.file.parameters

    @property
    def actual(self) -> JointParameters:
        """The parameters with the values that effects give instead.

        These are inertias, dampings, stiffnesses and limits that differ from the joint file's, as
        a diagnosis finds them. Controllers know only the file's.
        """
        own = {
            number.symbol: value
            for name, values in self.effects.items()
            for number in EFFECTS[name].parameters
            if number.relative_to == number.symbol
            and isinstance(value := values.get(number.symbol), float)
        }
        return self.parameters.replace(**own) if own else self.parameters

    @property
    def structure_row(self) -> Structure:
        """The structure's row in the table."""
        return get_structure(self.structure)

    @property
    def torque_limit(self) -> float:
        """Largest motor torque k_t n i_p [N m]; infinite where no peak current is given."""
        p = self.parameters
        return p.k_t * p.n * p.get("i_p", np.inf)

    def setting(self, effect: str, symbol: str) -> float:
        """Return one number of an effect, 0 where it is off."""
        value = self.effects.get(effect, {}).get(symbol, 0.0)
        assert isinstance(value, float)
        return value

    def packed(self) -> tuple[NDArray[np.void], Floats]:
        """Return the kernel's parameter record, shape (1,), and ripple rows, shape (rows, 4)."""
        return pack(self.parameters, self.structure_row, self.drive, self.effects)

    def state_space(self, dt: float | None = None) -> control.StateSpace:
        """Return the linear joint, continuous, or exact for inputs held over dt [s].

        Inputs are (tau_m, tau_l) or, where the output is fixed, (tau_m, dq_l); outputs are
        (q_m, q_g, q_l, dq_m, dq_g, dq_l, tau). Its parameters are the `actual` ones; no other
        effect is in it. A `rigid` joint has no torsion bar: its tau is zero here, while `simulate`
        gives the torque it passes on.
        """
        return linear.state_space(self.actual, self.structure_row, dt)

    def transfer_function(
        self, output: str = "tau", input: str = "tau_m", dt: float | None = None
    ) -> control.TransferFunction:
        """Return the transfer function between two named signals of `state_space`, minimal.

        Poles that a zero cancels, such as the free motion of the whole joint in its torque, are
        not in it.

        Raises:
            UnknownNameError: `state_space` has no such signal.
        """
        return linear.minimal_transfer(self.state_space(dt), output, input)

    def nonlinear_torque(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike = 0.0) -> Floats:
        """Return the torque that the effects add on motor, gear and load.

        Friction is negative at positive speed; bristles are taken as sliding. With sharp friction
        (dq_0 = 0) a body at rest gets none here, as its torque follows from the others. The
        motor is without current. What springs add to their linear models is part of tau.

        Args:
            q: Angles of motor, gear and load [rad], shape (..., 3).
            dq: Their velocities [rad/s], shape (..., 3).
            tau: Transmitted torque [N m], shape (...), which scales gear ripple and friction.

        Returns:
            Torques [N m], shape (..., 3).
        """
        q_, dq_ = np.broadcast_arrays(np.asarray(q, float), np.asarray(dq, float))
        if q_.shape[-1:] != (3,):
            raise ConfigurationError(
                f"q and dq must have shape (..., 3) for motor, gear and load, got {q_.shape}."
            )
        tau_ = np.broadcast_to(np.asarray(tau, float), q_.shape[:-1])
        record, ripple = self.packed()
        p = record.view(np.recarray)[0]
        out, work = np.zeros(q_.shape), np.zeros((WORK_ROWS, WORK_WIDTH))
        note_friction(p, work)
        for index in np.ndindex(q_.shape[:-1]):
            transmitted = float(tau_[index])
            for body in range(3):
                speed = float(dq_[index][body])
                if speed != 0.0 or p.dq_0 > 0.0:
                    side = 1.0 if speed >= 0.0 else -1.0
                    drag, _ = sliding_friction(p, work, body, speed, side, transmitted)
                    out[(*index, body)] = -drag
            q_m, q_l = float(q_[index][0]), float(q_[index][LOAD])
            out[(*index, 0)] += p.torque_offset + ripple_torque(
                p, ripple, q_m, transmitted, p.k_t * p.n, 0.0
            )
            out[(*index, LOAD)] -= p.weight * np.sin(q_l - p.weight_angle)
            out[(*index, LOAD)] -= contact_torque(p, q_l, float(dq_[index][LOAD]))
        return out

    def simulate(
        self,
        tau_m: ArrayLike | None = None,
        load: ArrayLike | None = None,
        dt: float = 1e-3,
        x0: ArrayLike | None = None,
        *,
        voltage: ArrayLike | None = None,
        dt_physics: float = DT_PHYSICS,
        seed: int = 0,
        held: bool | None = None,
    ) -> Record:
        """Simulate the joint under given inputs.

        Row k holds what is true and measured at t = k dt, before input k acts. Where the load's
        motion is prescribed, its true velocity, and what the torque owes to it, are already those
        of input k, while the sensors still report those before.

        Args:
            tau_m: Commanded motor torque [N m], shape (samples,).
            load: Load torque [N m] or, where the output is fixed, load velocity [rad/s];
                shape (samples,), zero if absent.
            dt: Sample time [s].
            x0: Initial [q_m q_g q_l dq_m dq_g dq_l], zero if absent; merged bodies follow the
                first of them. A joint that starts in motion has had speed and first command
                before: delay and lag of the command begin with it instead of zero, and bristles
                are bent as by `BEFORE` of that speed.
            voltage: Instead of tau_m, the voltage of a voltage drive [V], shape (samples,), or
                (samples, 2) for v_q and v_d of `dq`.
            dt_physics: Substep [s]; dt is a whole multiple of it.
            seed: Seed of the sensors' noise.
            held: Whether an input holds from one sample to the next, as a command does. If False,
                the mean of two samples acts between them, as with a measured current. If None,
                what [found.input] of the joint file says of logs with about this sample time;
                held where it says nothing.

        Returns:
            A Record with the command, the measured channels, and the noise-free states in
            columns `true_*`.

        Raises:
            ConfigurationError: Inputs of the wrong shape or kind.
            SimulationError: A state ceased to be finite.
        """
        commands = self._commands(tau_m, voltage)
        samples = commands.shape[0]
        loads = np.zeros(samples) if load is None else checked_array("load", load, (samples,))
        between = [0.0, 0.0] if held else [0.5, 0.5]
        share, load_share = shares_of(self.file, dt) if held is None else between
        acting = np.column_stack([until_next(x, share) for x in commands.T])
        pulling = loads if self.structure_row.output_fixed else until_next(loads, load_share)
        substeps_of(dt, dt_physics, "dt")
        batch = JointBatch(self, 1, dt, dt_physics, voltage=voltage is not None)
        batch.seed(0, seed)
        start = np.zeros(6) if x0 is None else checked_array("x0", x0, (6,))
        batch.arrays.state[0] = start
        batch.restart(np.ones(1, dtype=np.bool_), pulling[:1])
        if start[3:].any():
            batch.arrays.commands[0] = acting[0]
            if voltage is None:
                batch.arrays.memory[0, [REFERENCE, LAGGED]] = acting[0, 0]
            self._bend(batch)
        measured, true = np.zeros((samples, 8)), np.zeros((samples, 12))
        done = simulate(batch.arrays, batch.setup, acting, pulling, measured, true)
        if done < samples:
            raise SimulationError(
                f"The state of {self.file.parameters.name} ceased to be finite after {done} "
                f"samples; the last good state is {true[done - 1, :6]}. Check the input.",
                last_good_states=true[:done, :6].copy(),
            )
        return self._record(commands, loads, measured, true, dt, seed, voltage is not None)

    def _bend(self, batch: JointBatch) -> None:
        """Bend the bristles of a joint in motion."""
        p, work = self.packed()[0].view(np.recarray)[0], np.zeros((WORK_ROWS, WORK_WIDTH))
        note_friction(p, work)
        for body, dq in enumerate(batch.arrays.state[0, 3:6]):
            if work[BODY + body, LAW] == BRISTLES:
                side = float(np.sign(dq)) or 1.0
                sigma = float(work[BODY + body, SIGMA]), float(p.sigma_1)
                dry = level(p, work, body, dq, side, 0.0)
                bent = bristles(sigma, dry, 0.0, dq, side, BEFORE)
                batch.arrays.memory[0, BRISTLE + body] = bent[2]

    def _commands(self, tau_m: ArrayLike | None, voltage: ArrayLike | None) -> Floats:
        if (tau_m is None) == (voltage is None):
            raise ConfigurationError("Give exactly one of tau_m [N m] and voltage [V].")
        if voltage is not None and self.drive == CURRENT_FREE:
            raise ConfigurationError(
                "voltage needs a voltage drive, got drive 'current'. Load the joint with "
                "drive='static', 'rl' or 'dq', or give tau_m."
            )
        given = np.asarray(tau_m if voltage is None else voltage)
        wide = voltage is not None and self.drive == "dq" and given.ndim == 2
        name = "tau_m" if voltage is None else "voltage"
        values = checked_array(name, given, (None, 2) if wide else (None,))
        commands = np.zeros((len(values), 2))
        if wide:
            commands[:] = values
        else:
            p = self.parameters
            commands[:, 0] = values if voltage is not None else values / (p.k_t * p.n)
        return commands

    def _record(
        self,
        commands: Floats,
        loads: Floats,
        measured: Floats,
        true: Floats,
        dt: float,
        seed: int,
        is_voltage: bool,
    ) -> Record:
        p = self.parameters
        columns: dict[str, Floats] = {"t": np.arange(len(commands), dtype=np.float64) * dt}
        if is_voltage:
            columns["v"] = commands[:, 0].copy()
            if self.drive == "dq":
                columns["v_d"] = commands[:, 1].copy()
        else:
            columns["i_cmd"] = commands[:, 0].copy()
            columns["tau_cmd"] = commands[:, 0] * p.k_t * p.n
        columns |= {name: measured[:, j].copy() for j, name in enumerate(CHANNELS)}
        names: tuple[str, ...] = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau", "i")
        if self.drive != CURRENT_FREE:
            names += DRIVE_SIGNALS
        columns |= {f"true_{name}": true[:, j].copy() for j, name in enumerate(names)}
        if not self.structure_row.output_fixed:
            columns["tau_l"] = loads.copy()
        return self.record(columns, dt, seed)

    def record(self, columns: Mapping[str, Floats], dt: float, seed: int, **known: Any) -> Record:
        """Return a record of this joint's simulation.

        Args:
            columns: Channels, each of shape (samples,). Those that the joint cannot have are left
                out: no current where the command is the voltage of an amplifier.
            dt: Sample time [s].
            seed: Seed of the sensors' noise.
            **known: What else belongs to its provenance.

        Warns:
            OutsideFoundWarning: The simulation leaves the ranges that the joint file states under
                [found]; once per joint.
        """
        p = self.parameters
        if not is_told(self.file):
            tell_outside(self.file, self._met(columns, dt))
        kept = {n: v for n, v in columns.items() if not (p.takes_volts and n in ("i", "true_i"))}
        units = default_units(tuple(kept), prismatic=p.axis == "prismatic")
        if p.takes_volts and "i_cmd" in units:
            units["i_cmd"] = "V"
        if self.file.path is not None:
            known = {JOINT_FILE: str(self.file.path), **known}
        effects = plain_effects(self.effects)
        return Record(
            kept,
            units,
            dt=dt,
            seed=seed,
            joint=p.name,
            structure=self.structure,
            parameter_hash=self.file.hash_hex(),
            versions={name: version_of(name) for name in ("cjt-gym", "numpy", "numba")},
            sensors={n: v for n, v in self.file.sensors.items() if n in kept},
            provenance={"kind": "simulation", "drive": self.drive, "effects": effects, **known},
        )

    def _met(self, columns: Mapping[str, Floats], dt: float) -> dict[str, tuple[float, float]]:
        """Return the ranges that a simulation covered, by quantity."""
        p, met = self.parameters, {}
        if "v" in columns:
            torque = columns["v"] * p.k_t * p.n / p.r
        else:
            torque = columns["i_cmd"] * p.k_t * p.n
        for name, x in (("speed", columns.get("true_dq_m")), ("torque", torque)):
            if x is not None and len(x):
                met[name] = (float(x.min()), float(x.max()))
        known = ranges_of(self.file).get("frequency")
        if known is not None and len(torque) * dt * known.high >= PERIODS:
            met["frequency"] = (0.0, frequency_of(torque, dt))
        return met


def load_joint(
    name: str | Path,
    structure: str | None = None,
    drive: str | None = None,
    effects: EffectSpec = None,
    parameters: Mapping[str, float] | None = None,
) -> Joint:
    """Return a joint of the library, or one from a TOML file.

    What a file says a joint is holds unless an argument says otherwise: its `structure`, its
    `drive`, and the effects that have a table [effects.NAME] in it, as far as they can act in that
    structure and with that drive. Values that a file merely knows, such as d_cm under [parameters]
    or the noise of a sensor, turn no effect on.

    Args:
        name: Name of a shipped joint, or path of a joint file.
        structure: One of `STRUCTURES`; None for that of the file, or else "full_dynamics".
        drive: One of `DRIVES`; None for that of the file, or else "current".
        effects: None for those the file lists; names, or a mapping of names to values, for
            exactly these. Values that are not given come from the joint file; "typical" instead
            of values takes the table's typical ones where nothing is known. The name "all" adds
            all others that can act, likewise.
        parameters: Parameters that replace those of the file.

    Raises:
        UnknownNameError: No such joint, structure, drive or effect.
        ParameterError: The file is not valid, or lacks what structure, drive or effects need.

    Example:
        >>> joint = load_joint("orange_80_6000", structure="output_fixed", effects=["coulomb"])
        >>> joint.parameters.k_b
        6000.0
    """
    file = load_joint_file(name)
    check_type("parameters", parameters or {}, Mapping, "a mapping of names to values")
    if parameters:
        file = replace(file, parameters=file.parameters.replace(**parameters))
    if structure is None:
        structure = file.structure or USUAL_STRUCTURE
    if drive is None:
        drive = file.drive or CURRENT_FREE
    row = get_structure(structure)
    get_drive(drive)
    linear.reduced_matrices(file.parameters, row)
    joint = Joint(file, structure, drive, resolve_effects(effects, file, row, drive))
    joint.packed()
    _check_drive(joint)
    return joint


def _check_drive(joint: Joint) -> None:
    p = joint.parameters
    if joint.drive != CURRENT_FREE and p.takes_volts:
        raise ParameterError(
            f"k_t of {p.origin} is in {p.unit('k_t')}: voltage is this joint's command already, so "
            f"that it takes drive current, got {joint.drive}. Or give k_t per ampere, and r."
        )
    for name in ("r", "l_a", "p", "v_0"):
        value = p.get(name, 1.0)
        if joint.drive != CURRENT_FREE and value <= 0.0:
            raise ParameterError(
                f"{name} of {p.origin} must be > 0 for drive {joint.drive}, got {value:g}."
            )


__all__ = ["DRIVES", "DT_PHYSICS", "Joint", "load_joint"]
