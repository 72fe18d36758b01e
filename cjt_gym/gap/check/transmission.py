"""What a record shows of spring and gearbox, from torque and deflection."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.check.balance import RELIABLE, Balance, slope
from cjt_gym.gap.check.resonances import gear_resonance
from cjt_gym.gap.check.verdicts import Seen, Unseen, Verdict, only_from
from cjt_gym.gap.check.view import View
from cjt_gym.joint.kernel.arrays import Floats

RELATIVE = 0.3
"""Upper limit on the smallest identifiable relative size."""
CROSSINGS = 4
"""Fewest zero crossings of the torque for backlash."""
PLAY = 0.2
"""Upper limit on the smallest identifiable backlash, relative to the range of deflections."""
RIGID = ""
"""Advice for a joint defined as rigid, which needs no other record."""
BESIDE = "Record the joint torque tau and both angles of the spring, q_m and q_l."
NEAR = 0.4
"""Least frequency that the excitation must reach, relative to the gearbox's resonance."""
ABOVE = 5.0
"""Power of the excitation, relative to its noise, above which it counts."""


def no_spring(view: View) -> Unseen | None:
    """Return why the spring cannot be evaluated, or None if it can."""
    if not view.structure.has_spring:
        why = f"the structure {view.structure.name} has no spring"
        return Unseen(why, RIGID)
    if "tau" not in view.channels:
        return Unseen("the joint torque tau is not recorded", BESIDE)
    if "tau" not in view:
        return Unseen("the joint torque tau never changes", "Load the spring.")
    if not view.deflection_known:
        end = "q_m" if view.motor_angle in (None, "tau") else "q_l"
        return Unseen(f"the spring's deflection is not measured: {end} is absent", BESIDE)
    return None


def tied(view: View) -> Balance | None:
    """Return the balance of a motor with a spring to a held output and no measured torque."""
    held = view.structure.has_spring and view.structure.output_fixed and "tau" not in view.channels
    return view.motor if held and view.drive is not None else None


def deflection(view: View, piece: dict[str, Floats]) -> Floats:
    """Return the spring's deflection, gearbox included [rad], shape (N,)."""
    held = piece.get("q_l", np.zeros(len(piece["t"])))
    assert view.motor_angle is not None
    if view.motor_angle.startswith("dq_"):
        speed = piece[view.motor_angle] - piece.get("dq_l", 0.0)
        return np.asarray(np.cumsum(speed) * view.dt)
    return np.asarray(piece[view.motor_angle] - held)


def spring(view: View) -> Balance:
    """Return the balance of the spring: its torque and the terms that cause it."""
    wound = [deflection(view, piece) for piece in view.stretches]
    delta = np.concatenate([x - x.mean() for x in wound])
    rate = np.concatenate([np.gradient(x, view.dt) for x in wound])
    tau = np.concatenate([piece["tau"] for piece in view.stretches])
    noise = view.channels["tau"].noise
    if view.motor_angle and view.motor_angle.startswith("q_"):
        ends = [n for n in (view.motor_angle, "q_l") if n in view.channels]
        angles = sum(view.channels[name].noise ** 2 for name in ends)
        rise = slope(delta, tau)
        noise = float(np.hypot(noise, rise * np.sqrt(angles)))
    columns = {"delta": delta, "cubed": delta**3, "rate": rate, "one": np.ones(len(delta))}
    columns |= {"way": np.sign(rate), "rise": np.gradient(tau, view.dt), "tau": tau}
    return Balance(tau, columns, noise, 1, float(np.quantile(np.abs(tau), 0.95)))


def stiffness(view: View) -> Verdict:
    """Judge stiffness, which requires torque and deflection, or motion of a body on the spring."""
    if view.wound and view.load is not None:
        size = view.load.least(view.load.y, ("v", "s", "one"))
        if size <= RELATIVE:
            return Seen(size * view.value("k_b"), view.stiffness_unit)
    if (motor := tied(view)) is not None:
        size = motor.least(motor["q"] - motor["q"].mean(), ("a", "v", "s", "one"))
        if size <= RELATIVE * view.value("k_b"):
            return Seen(size, view.stiffness_unit)
    if (none := no_spring(view)) is not None:
        return none
    balance = spring(view)
    found = abs(slope(balance["delta"], balance.y))
    size = balance.least(balance["delta"], ("rate", "one"))
    if size <= RELATIVE * max(found, view.value("k_b")):
        return Seen(size, view.stiffness_unit)
    why = f"the deflection spans {np.ptp(balance['delta']):.2g} {view.angle_unit}, hardly its noise"
    return Unseen(why, "Load the spring further.")


def hardening(view: View) -> Verdict:
    """Judge hardening, which requires both large and small deflections."""
    if (motor := tied(view)) is not None:
        cubed = (motor["q"] - motor["q"].mean()) ** 3
        size = motor.least(cubed, ("a", "v", "s", "one", "q"))
        if size * float(np.abs(cubed).max()) <= RELATIVE * motor.level:
            return Seen(size * float(np.abs(cubed).max()) / motor.level, "-")
    if view.wound and view.load is not None:
        cubed = (view.load.y / view.value("k_b")) ** 3
        size = view.load.least(cubed, ("a", "v", "s", "one"))
        if size * float(np.abs(cubed).max()) <= RELATIVE * view.load.level:
            return Seen(size * float(np.abs(cubed).max()) / view.load.level, "-")
    if (none := no_spring(view)) is not None:
        return none
    balance = spring(view)
    size = balance.least(balance["cubed"], ("delta", "rate", "one"))
    torque = size * float(np.abs(balance["cubed"]).max()) / max(balance.level, 1e-300)
    if torque <= RELATIVE:
        return Seen(torque, "-")
    why = f"{only_from(torque, '-')} of the torque at the largest deflection"
    return Unseen(why, "Record large and small deflections.")


def spring_hysteresis(view: View) -> Verdict:
    """Judge hysteresis, which requires loading and unloading of the spring."""
    if view.wound and view.load is not None:
        way = np.sign(np.gradient(view.load.y))
        size = view.load.least(way, ("a", "v", "s", "one"))
        if size <= RELATIVE * view.load.level:
            return Seen(size, view.torque_unit)
    if (none := no_spring(view)) is not None:
        return none
    balance = spring(view)
    size = balance.least(balance["way"], ("delta", "cubed", "rate", "one"))
    if size <= RELATIVE * balance.level:
        return Seen(size, view.torque_unit)
    why = only_from(size, view.torque_unit)
    return Unseen(why, "Load and unload the spring many times, slowly.")


def backlash(view: View) -> Verdict:
    """Judge backlash, which requires zero crossings of the torque and a fine deflection."""
    if view.wound and view.load is not None:
        load, wide = view.load, max(float(np.ptp(deflection(view, x))) for x in view.stretches)
        crossings = _changes_of_sign(load.y, 3.0 * load.scatter)
        size = RELIABLE * load.scatter / view.value("k_b") / np.sqrt(max(crossings, 1))
        if crossings >= CROSSINGS and size <= PLAY * wide:
            return Seen(float(size), view.angle_unit)
    if (none := no_spring(view)) is not None:
        return none
    instead = "Record motion in which the torque passes through zero, slowly and often."
    crossings = _crossings(view)
    if crossings < CROSSINGS:
        return Unseen(f"the torque passes through zero {crossings} times", instead)
    balance = spring(view)
    found = abs(slope(balance["delta"], balance.y))
    size = RELIABLE * balance.scatter / max(found, 1e-300) / np.sqrt(crossings)
    if size <= PLAY * float(np.ptp(balance["delta"])):
        return Seen(float(size), view.angle_unit)
    why = only_from(size, view.angle_unit)
    return Unseen(why, "Record larger torques in both directions.")


def _crossings(view: View) -> int:
    noise = 3.0 * view.channels["tau"].noise
    return sum(_changes_of_sign(piece["tau"], noise) for piece in view.stretches)


def _changes_of_sign(x: Floats, noise: float) -> int:
    """Return how often a signal passes through a band of noise around zero."""
    way = np.sign(x[np.abs(x) > noise])
    return int(np.count_nonzero(np.diff(way)))


def gear_stiffness(view: View) -> Verdict:
    """Judge the gearbox's stiffness, which shows near its resonance or between its two angles."""
    if not view.structure.has_gear:
        why = f"the gearbox of the structure {view.structure.name} is rigid"
        return Unseen(why, RIGID)
    if "q_g" in view and "q_m" in view and "tau" in view:
        return Seen(RELATIVE * 0.1, "-")
    if "tau" not in view:
        why = "without the joint torque tau, gearbox and spring act as one in series"
        return Unseen(why, BESIDE)
    if view.load_angle is None and not view.structure.output_fixed:
        why = "without the load's angle q_l, a load that is off looks like a soft gearbox"
        return Unseen(why, BESIDE)
    swing, nyquist = gear_resonance(view), 0.5 / view.dt
    quick = f"Record at {max(1e3, 5.0 * swing):.2g} Hz or more, with a chirp up to {swing:.2g} Hz."
    if view.drive is None or view.motor_angle is None:
        return Unseen("motion or current are not recorded", "Record q_m and i.")
    if swing <= 0.0:
        return Unseen("the joint file gives no stiffness of the gearbox", "Give k_g, I_m and I_g.")
    if swing >= nyquist:
        why = f"motor and gear resonate at {swing:.3g} Hz, above Nyquist at {nyquist:.3g} Hz"
        return Unseen(why, quick)
    reach = excited_to(view)
    if reach < NEAR * swing:
        why = (
            f"the excitation ends at {reach:.2g} Hz, and motor and gear resonate at {swing:.3g} Hz"
        )
        return Unseen(why, quick)
    return Seen((NEAR * swing / max(reach, 1e-9)) ** 2 * 0.1, "-")


def excited_to(view: View) -> float:
    """Return the highest frequency at which the joint's input exceeds its noise [Hz]."""
    from scipy.signal import welch

    assert view.drive is not None
    x = max(view.stretches, key=lambda piece: len(piece["t"]))[view.drive]
    f, power = welch(x - x.mean(), 1.0 / view.dt, nperseg=min(1024, len(x)))
    noise = 2.0 * view.dt * view.channels[view.drive].noise ** 2
    strong = f[power > ABOVE * noise]
    return float(strong.max()) if strong.size else 0.0
