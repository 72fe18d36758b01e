"""Logs with gaps, stamped jitter, noise stated too large, and masses that nobody measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.forward import Forecast
from cjt_gym.gap.horizons.prediction.log import to_log, to_logs
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.gap.horizons.prediction.windows import relative
from cjt_gym.gap.recorded.missing import twins, undecided
from cjt_gym.gap.recorded.noise import channel_noise
from cjt_gym.gap.recorded.series import stretches, to_series
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.recorded.signals import motor_torque
from cjt_gym.joint import JointFile, get_structure, load_joint
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record, default_units
from tests.gap.horizons.rotor import datasheet, record
from tests.gap.simulator import TRUE, nominal, only, simulate

RIGID = get_structure("rigid")
DT = 1e-3


def spring_record(
    columns: tuple[str, ...], *, free: bool = True, load: float | None = None
) -> tuple[Record, Joint]:
    """Return a clean record of a joint with a spring, and the joint."""
    structure = "rigid_gearbox" if free else "output_fixed_rigid_gearbox"
    changed = {} if load is None else {"I_l": load}
    joint = load_joint("orange_80_6000", structure, parameters=changed)
    t = DT * np.arange(6000)
    torque = 20.0 * np.sin(2.0 * np.pi * 1.3 * t) + 10.0 * np.sin(2.0 * np.pi * 7.0 * t)
    made = quiet(joint).simulate(torque, dt=DT)
    current = torque / (joint.parameters.k_t * joint.parameters.n)
    known = {"t": t, "i_cmd": current, "i": current, "q_m": made["true_q_m"]}
    known |= {"q_l": made["true_q_l"], "tau": made["true_tau"]}
    whole = Record(known, default_units(tuple(known)), structure=joint.structure)
    return only(whole, "t", *columns), joint


def holed(whole: Record, lost: np.ndarray) -> Record:
    """Return a record without some samples of its angle."""
    columns = {n: whole[n] for n in ("t", "i")} | {"q_m": np.where(lost, np.nan, whole["q_m"])}
    return Record(columns, whole.units, structure=whole.structure, allow_nan=True)


def test_the_stages_take_every_long_stretch_without_a_gap() -> None:
    whole = record(gap=(3.0, 3.2))
    parts = [part.record for part in stretches([whole])]
    assert [len(part) for part in parts] == sorted((len(part) for part in parts), reverse=True)
    assert sorted(round(float(part.t[0]), 1) for part in parts) == [0.0, 3.2]
    assert all(np.diff(part.t).max() < 2.5e-3 for part in parts)
    lost = holed(whole, whole.t < 6.0)
    (left,) = stretches([lost])
    assert left.record.t[0] >= 6.0
    even = record()
    assert [len(part) for part in stretches([even])] == [len(even)]


def test_single_lost_samples_break_no_record() -> None:
    whole = record()
    holes = holed(whole, np.arange(len(whole)) % 50 == 7)
    assert [len(part) for part in stretches([holes])] == [len(whole)]


@pytest.mark.slow
def test_a_motor_stays_warm_over_a_gap() -> None:
    """Derating counts from the beginning of a log, and a cut stretch knows the current before."""
    time, loss, k_t = 3.0, 0.02, TRUE["k_t"] * TRUE["n"]
    heat = {
        "derating": 0.004,
        "r": 1.0,
        "r_th1": loss / 0.004,
        "T_thw": time,
        "T_thm": 1e5,
        "r_th2": 1.0,
    }
    file, shape = nominal(), get_structure("output_fixed_rigid_gearbox")
    effects = resolve_effects({"thermal_derating": {**heat, "a_CU": 0.0}}, file, shape, "current")
    joint = Joint(file, shape.name, "current", effects)
    t, rng = DT * np.arange(9000), np.random.default_rng(1)
    amps = 3.0 + 2.0 * np.sin(2.0 * np.pi * 1.3 * t) + np.sin(2.0 * np.pi * 7.0 * t)
    made = quiet(joint).simulate(amps * k_t, dt=DT)
    columns = {"t": t, "i": amps + rng.normal(0.0, 0.015, 9000)}
    columns["q_m"] = made["true_q_m"] + rng.normal(0.0, 2e-6, 9000)
    columns["tau"] = made["true_tau"] + rng.normal(0.0, 0.04, 9000)
    kept = (t < 2.5) | (t > 2.9)
    columns = {name: x[kept] for name, x in columns.items()}
    record = Record(columns, default_units(tuple(columns)), structure=joint.structure)
    later = stretches([record])[0]
    setting = make_setting(later.record, nominal(), joint.structure_row, log=later.log)
    assert len(setting.series.past) == pytest.approx(2900, abs=2)
    warm = {**setting.nominal, "derate": loss, "heat": time}
    cold = setting.nominal | {"derate": 0.0}
    share = motor_torque(warm, setting.series) / motor_torque(cold, setting.series)
    fade, level = np.exp(-DT / time), 0.0
    expected = np.empty(9000)
    for k, a in enumerate(amps):
        expected[k], level = 1.0 - loss * level, fade * level + (1.0 - fade) * a * a
    assert share == pytest.approx(expected[t > 2.9], rel=0.01)

    found = diagnose(record, nominal())
    assert [effect.name for effect in found.effects] == ["thermal_derating"]
    assert found.effects[0].parameters["T_thw"].value == pytest.approx(time, rel=0.1)
    assert found.gap.after < 0.1 * found.gap.before


def test_a_channel_with_too_few_samples_is_told_as_such() -> None:
    whole = record()
    current = np.where(np.arange(len(whole)) < 43, whole["i"], np.nan)
    columns = {"t": whole.t, "q_m": whole["q_m"], "i": current}
    few = Record(columns, whole.units, structure="rigid", allow_nan=True)
    with pytest.raises(
        RecordError, match=r"Columns with values: t, q_m, i \(43 samples, too few\)"
    ):
        diagnose(few, datasheet())


@pytest.mark.parametrize("told", [True, False])
def test_stamps_are_believed_where_they_make_the_channels_smoother(told: bool) -> None:
    rng = np.random.default_rng(1)
    even = DT * np.arange(4000)
    late = even + 0.08 * DT * rng.standard_normal(len(even))
    taken = late if told else even

    def angle(t: np.ndarray) -> np.ndarray:
        return np.sin(2.0 * np.pi * 2.0 * t)

    columns = {"t": late, "q_m": angle(taken), "i_cmd": np.cos(even)}
    made = to_series(Record(columns, {"t": "s", "q_m": "rad", "i_cmd": "A"}), datasheet(), RIGID)
    step = (late[-1] - late[0]) / (len(late) - 1)
    at = late[0] + step * np.arange(len(late)) if told else even
    expected = angle(at) - made.zero["q_m"]
    assert made.dt == pytest.approx(step, rel=0.05)
    # a late sample at full speed would be off by 0.08 ms * 4 pi rad/s = 1 mrad
    assert np.abs(made["q_m"] - expected).max() < (2e-4 if told else 1e-12)
    assert made["i_cmd"] == pytest.approx(np.cos(even))


@pytest.mark.parametrize(("stated", "counts"), [(1.0, 1.0), (3.0, 1.0), (0.5, 0.5)])
def test_noise_that_is_stated_too_large_hides_nothing(stated: float, counts: float) -> None:
    true = 1e-3
    rng = np.random.default_rng(0)
    t = DT * np.arange(6000)
    q = np.sin(2.0 * np.pi * t) + true * rng.standard_normal(len(t))
    sheet = datasheet()
    sensors = {"q_m": {"noise": Quantity(stated * true, "rad", "test")}}
    known = JointFile(sheet.parameters, sensors=sensors)
    columns = {"t": t, "q_m": q, "i_cmd": np.cos(t)}
    units = {"t": "s", "q_m": "rad", "i_cmd": "A"}
    series = to_series(Record(columns, units), known, RIGID)
    assert channel_noise(series, known, "q_m", 0.0).std == pytest.approx(counts * true, rel=0.1)


@pytest.mark.slow
def test_a_gap_in_the_angle_of_a_held_joint_hides_nothing() -> None:
    made = simulate(seconds=6.0, extra=lambda t, q, v: 4.0 * min(v, 0.0) * -1.0)
    few = only(made, "i_cmd", "q_m")
    q = few["q_m"].copy()
    q[3000:3100] = np.nan
    columns = {"i_cmd": few["i_cmd"], "q_m": q}
    broken = Record(columns, few.units, dt=DT, structure=made.structure, allow_nan=True)
    found = diagnose(broken, nominal())
    assert found.effects[0].name == "viscous_asym"


def test_a_coarse_channel_is_seen_although_its_stamps_move_it_to_even_times() -> None:
    rng, step = np.random.default_rng(0), 0.01
    even = DT * np.arange(4000)
    late = even + 0.08 * DT * rng.standard_normal(len(even))
    q = step * np.round(np.sin(2.0 * np.pi * late) / step)
    columns = {"t": late, "q_m": q, "i_cmd": np.cos(even)}
    made = Record(columns, {"t": "s", "q_m": "rad", "i_cmd": "A"})
    setting = make_setting(made, datasheet(), RIGID)
    assert setting.noise["q_m"].lattice == pytest.approx(step)


def test_what_the_clock_scatters_is_no_noise_of_a_channel() -> None:
    own, late = 1e-5, 1e-4  # noise [rad], deviation of the sampling times [s]
    rng = np.random.default_rng(0)
    t = DT * np.arange(6000)
    taken = t + late * rng.standard_normal(len(t))
    # Never slow for long, so that no window is free of what the clock scatters.
    q = np.sin(2.0 * np.pi * 8.0 * taken) + own * rng.standard_normal(len(t))
    sheet = datasheet()
    sensors = {"q_m": {"noise": Quantity(own, "rad", "test")}}
    known = JointFile(sheet.parameters, sensors=sensors)
    columns = {"t": t, "q_m": q, "i_cmd": np.cos(t)}
    series = to_series(Record(columns, {"t": "s", "q_m": "rad", "i_cmd": "A"}), known, RIGID)
    found = channel_noise(series, known, "q_m", 1e-6)
    assert found.jitter == pytest.approx(late, rel=0.2)
    scattered = late * 2.0 * np.pi * 8.0 / np.sqrt(2.0)
    assert found.observed < 0.5 * scattered


def test_a_load_that_was_not_measured_follows_the_motor() -> None:
    seen, joint = spring_record(("i_cmd", "q_m"), load=2.0)
    full, _ = spring_record(("i_cmd", "q_m", "q_l", "tau"), load=2.0)
    log = to_log(seen, joint.file, joint.structure_row)
    true = to_log(full, joint.file, joint.structure_row)
    assert log.known.tolist() == [True, True, False] * 2
    assert true.known.all()
    assert Forecast(quiet(joint), true).states is true.states
    found = Forecast(quiet(joint), log).states
    off, plain = (np.std(s[:, 2] - true.states[:, 2]) for s in (found, log.states))
    assert off < 0.25 * plain

    case = make_case([seen], [], joint.file, joint.structure_row)
    as_if = tuple(replace(one, known=np.ones(6, dtype=bool)) for one in case.test.logs)
    errors = [
        relative(case.test, windows.errors(case.joint))
        for windows in (case.test, replace(case.test, logs=as_if))
    ]
    for horizon in (0.02, 0.1, 0.5):
        assert errors[0]["q_m", horizon] < 0.5 * errors[1]["q_m", horizon]


def test_the_zero_of_a_held_spring_follows_from_the_command() -> None:
    seen, joint = spring_record(("i_cmd", "q_m"), free=False)
    shifted = seen.with_columns({"q_m": seen["q_m"] + 0.3})
    one, two = (to_log(r, joint.file, joint.structure_row) for r in (seen, shifted))
    assert two.states[:, 2] - one.states[:, 2] == pytest.approx(0.3, abs=1e-9)
    errors = [
        make_case([r], [], joint.file, joint.structure_row).test.errors(quiet(joint))
        for r in (seen, shifted)
    ]
    for before, after in zip(*errors, strict=True):
        assert after == pytest.approx(before, abs=1e-6)


def test_all_records_of_a_joint_are_driven_by_the_same_channel() -> None:
    follows, joint = spring_record(("i_cmd", "i", "q_m", "tau"), free=False)
    wrong = follows["i_cmd"] * np.where(np.arange(len(follows)) % 500 < 250, 1.0, -1.0)
    other = follows.with_columns({"i_cmd": wrong})
    alone = [to_log(r, joint.file, joint.structure_row).drive for r in (follows, other)]
    assert alone == ["i_cmd", "i"]
    both = to_logs([follows, other], joint.file, joint.structure_row)
    assert [log.drive for log in both] == ["i", "i"]


@pytest.mark.slow
def test_a_record_driven_by_a_voltage_is_diagnosed() -> None:
    whole = record(seconds=8.0)
    sheet = datasheet(1.0)
    values = sheet.parameters.replace(r=Quantity(2.0, "ohm", "datasheet"))
    # without inductance a voltage u drives (u - k_t dq) / r: damping k_t^2 / r more
    columns = {"t": whole.t, "q_m": whole["q_m"], "v": 2.0 * whole["i"]}
    driven = Record(columns, {"t": "s", "q_m": "rad", "v": "V"}, structure="rigid")
    found = diagnose(driven, replace(sheet, parameters=values))
    assert found.horizons
    assert found.verdict != "no_gap"


@pytest.mark.slow
def test_a_guess_of_a_held_joint_is_corrected_and_not_named() -> None:
    made, joint = spring_record(("i", "q_m", "tau"), free=False)
    file = joint.file
    guess = Quantity(2.0 * file.parameters.I_m, "kg m^2", "guess", guess=True)
    sheet = replace(file, parameters=file.parameters.replace(I_m=guess))
    found = diagnose(made, sheet, structure=joint.structure)
    assert "inertia" not in {effect.name for effect in found.effects}
    assert found.verdict == "no_gap"
    assert found.gap.after < 0.2 * found.gap.before


@pytest.mark.slow
def test_a_guessed_inertia_costs_nothing_to_correct_beside_a_measured_torque() -> None:
    stated = nominal(I_m=3.0)
    guess = Quantity(stated.parameters.I_m, "kg m^2", "test", guess=True)
    file = replace(stated, parameters=stated.parameters.replace(I_m=guess))
    found = diagnose(simulate(friction=(2.0, 2.0)), file)
    (effect,) = found.effects
    assert (effect.name, effect.status) == ("coulomb", "confirmed")
    assert effect.parameters["d_cm"].value == pytest.approx(2.0, rel=0.05)
    assert found.joint.parameters.I_m == pytest.approx(TRUE["I_m"], rel=0.05)


@pytest.mark.parametrize("factor", [3.0, 12.0])
def test_guesses_of_one_mass_are_corrected_together(factor: float) -> None:
    stated = nominal()
    guess = Quantity(0.5 * factor * TRUE["I_m"], "kg m^2", "test", guess=True)
    file = replace(stated, parameters=stated.parameters.replace(I_m=guess, I_g=guess))
    found = diagnose(simulate(), file)
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert found.unexplained.text.startswith("The guess of I_m")
    p = found.joint.parameters
    assert p.I_m + p.I_g == pytest.approx(TRUE["I_m"], rel=0.05)


def test_friction_may_be_the_loads_where_only_the_motor_is_seen() -> None:
    pair = ("coulomb", "load_coulomb")
    for columns, alike in ((("i", "q_m"), True), (("i", "q_m", "q_l"), False)):
        made, joint = spring_record(columns)
        setting = make_setting(made, joint.file, joint.structure_row)
        assert (pair in twins(setting)) == alike
        assert undecided(setting, "coulomb") == alike


@pytest.mark.slow
def test_the_damping_of_a_spring_is_fitted_and_not_named() -> None:
    """Left at the datasheet's, dampings of motor and load were confirmed in its place."""
    true = {"I_l": 2.0, "d_l": 0.5, "d_gl": 6.0}
    joint = load_joint("orange_80_6000", "rigid_gearbox", parameters=true)
    p, rng, t = joint.parameters, np.random.default_rng(4), DT * np.arange(6000)
    torque = 20.0 * np.sin(2.0 * np.pi * 1.3 * t) + 10.0 * np.sin(2.0 * np.pi * 7.0 * t)
    torque += 8.0 * rng.uniform(-1.0, 1.0, 60)[(t / 0.1).astype(int)]
    made = quiet(joint).simulate(torque, dt=DT, held=False)
    angle = made["true_q_m"] + rng.normal(0.0, 1e-6, 6000)
    columns = {"t": t, "i": torque / (p.k_t * p.n), "q_m": angle}
    made = Record(columns, default_units(tuple(columns)), structure=joint.structure)
    stated = joint.file.parameters.replace(
        d_gl=Quantity(0.3 * p.d_gl, "N m s/rad", "test", tolerance=0.2),
        d_l=Quantity(p.d_l, "N m s/rad", "test", tolerance=0.2),
    )
    found = diagnose(made, replace(joint.file, parameters=stated))
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert found.joint.parameters.d_gl == pytest.approx(p.d_gl, rel=0.25)
    known = [(row.found, row.datasheet, row.floor) for row in found.horizons if row.floor]
    assert len(known) == 3
    assert all(one < 1.05 * floor < 0.95 * sheet for one, sheet, floor in known)


@pytest.mark.slow
def test_noise_read_off_a_channel_is_told_beside_a_searched_joint() -> None:
    """What is predicted over horizons does not depend on noise, so that a search names none."""
    made = simulate(friction=(1.0, 1.0))
    few = only(made, "i_cmd", "q_m")
    noisy = few["q_m"] + np.random.default_rng(5).normal(0.0, 4e-5, len(few))
    found = diagnose(few.with_columns({"q_m": noisy}), nominal())
    named = {effect.name: effect for effect in found.effects}
    assert named["noise"].channel == "q_m"
    assert named["noise"].parameters["noise"].value == pytest.approx(4e-5, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("friction", "status"), [((3.0, 1.2), "tentative"), ((2.0, 2.0), "confirmed")]
)
def test_friction_that_may_be_asymmetric_is_not_confirmed_as_symmetric(
    friction: tuple[float, float], status: str
) -> None:
    """With a command alone an offset of the amplifier beside symmetric friction looks alike."""
    few = only(simulate(friction=friction), "i_cmd", "q_m", "q_l", "tau")
    (effect,) = diagnose(few, nominal()).effects
    assert (effect.name, effect.status) == ("coulomb", status)
    assert effect.parameters["d_cm"].value == pytest.approx(sum(friction) / 2.0, rel=0.05)
    assert ("coulomb_asym" in effect.confusable_with) == (status == "tentative")


def load_record(effects: dict[str, dict[str, float]], seconds: float = 8.0) -> tuple[Record, Joint]:
    """Return current and motor angle of a compliant joint whose load rubs, and the joint."""
    true = {"I_l": 2.0, "d_l": 0.5, "d_gl": 6.0}
    joint = load_joint("orange_80_6000", "rigid_gearbox", parameters=true, effects=effects)
    size = round(seconds / DT)
    p, rng, t = joint.parameters, np.random.default_rng(4), DT * np.arange(size)
    torque = 20.0 * np.sin(2.0 * np.pi * 1.3 * t) + 10.0 * np.sin(2.0 * np.pi * 7.0 * t)
    torque += 8.0 * rng.uniform(-1.0, 1.0, size // 100)[(t / 0.1).astype(int)]
    made = quiet(joint).simulate(torque, dt=DT)
    columns = {"t": t, "i": torque / (p.k_t * p.n)}
    columns["q_m"] = made["true_q_m"] + rng.normal(0.0, 1e-6, size)
    columns["q_l"] = made["true_q_l"] + rng.normal(0.0, 1e-6, size)
    return Record(columns, default_units(tuple(columns)), structure=joint.structure), joint


@pytest.mark.slow
def test_friction_of_a_load_is_told_where_predictions_show_it() -> None:
    """Of a compliant joint, by the motor alone: tentatively, as the examination excludes it."""
    made, joint = load_record({"load_coulomb": {"d_cl": 3.0}})
    (effect,) = diagnose(only(made, "t", "i", "q_m"), joint.file).effects
    assert (effect.name, effect.status) == ("load_coulomb", "tentative")
    assert effect.parameters["d_cl"].value == pytest.approx(3.0, rel=0.1)


@pytest.mark.slow
def test_friction_of_a_load_that_falls_with_speed_is_not_called_plain() -> None:
    """Without a measured torque the stages judge spring and load as one, and a search decides."""
    dry = {"load_coulomb": {"d_cl": 2.0}, "stribeck": {"d_sl": 4.0, "v_s": 0.15}}
    made, joint = load_record(dry)
    (effect,) = diagnose(made, joint.file).effects
    assert (effect.name, effect.body) == ("stribeck", "load")
    assert effect.parameters["d_cl"].value == pytest.approx(2.0, rel=0.1)
    assert effect.parameters["d_sl"].value == pytest.approx(4.0, rel=0.2)


@pytest.mark.slow
def test_a_motor_that_weakens_is_recognised_by_command_and_angle_alone() -> None:
    """With a held output and no torque sensor; the motor loses a third of its torque."""
    time, loss = 3.0, 0.06

    def drive(wanted: np.ndarray) -> np.ndarray:
        level, out = 0.0, np.empty_like(wanted)
        for k, a in enumerate(wanted):
            out[k] = a * (1.0 - loss * level)
            level += DT / time * (a * a - level)
        return out

    few = only(simulate(seconds=10.0, drive=drive), "i_cmd", "q_m")
    (effect,) = diagnose(few, nominal()).effects
    assert effect.name == "thermal_derating"
    assert effect.parameters["T_thw"].value == pytest.approx(time, rel=0.2)
