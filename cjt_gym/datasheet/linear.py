"""The linear analysis of joints as a sheet: Bode, Nyquist, poles and zeros, step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cjt_gym import __version__
from cjt_gym.analysis import Identified
from cjt_gym.analysis.open_loop import Mode, Step, frequency_response, poles, step, zeros
from cjt_gym.analysis.system import Floats
from cjt_gym.datasheet.blocks import Block, Figure, Heading, Paragraph, Sheet, Table
from cjt_gym.datasheet.drawing import COLOURS, HALF, canvas
from cjt_gym.datasheet.notation import drawn, named, number
from cjt_gym.joint import Joint

UNITS = {"tau_m": "N m", "i": "A", "v": "V", "tau": "N m", "q": "rad", "dq": "rad/s"}
DECADES = 1.3  # drawn around all poles and zeros, where phases have settled


@dataclass(frozen=True)
class Case:
    """One joint in the comparison.

    Attributes:
        label: What it is called.
        joint: The joint.
        identified: Its measured response, drawn over the linear one; None for none.
    """

    label: str
    joint: Joint
    identified: Identified | None = None


@dataclass(frozen=True)
class Analysis:
    """The linear figures of one case."""

    poles: tuple[Mode, ...]
    zeros: tuple[Mode, ...]
    step: Step

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data; None for what is not finite."""
        return {
            "poles": [_plain(mode) for mode in self.poles],
            "zeros": [_plain(mode) for mode in self.zeros],
            "step": {
                name: _finite(getattr(self.step, name))
                for name in ("final", "rise_s", "overshoot", "settling_s")
            },
        }


def _plain(mode: Mode) -> dict[str, Any]:
    return {
        "name": mode.name,
        "real": mode.value.real,
        "imag": mode.value.imag,
        "frequency_hz": mode.frequency,
        "damping": _finite(mode.damping),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def analyse_case(case: Case, input: str, output: str) -> Analysis:
    """Return poles, zeros and step of a case.

    Raises:
        UnknownNameError, ConfigurationError: As for `cjt_gym.analysis.open_loop.matrices`.
    """
    joint = case.joint
    return Analysis(poles(joint, input), zeros(joint, input, output), step(joint, input, output))


def linear_sheet(
    cases: Sequence[Case], input: str = "tau_m", output: str = "tau", dt: float | None = None
) -> Sheet:
    """Return the sheet of one case, or of several laid over each other.

    Args:
        cases: What is analysed.
        input: See `cjt_gym.analysis.open_loop.matrices`.
        output: Likewise.
        dt: Sample time of an input that is held, for the frequency response [s].

    Raises:
        UnknownNameError, ConfigurationError: As for `cjt_gym.analysis.open_loop.matrices`.
    """
    found = {case.label: analyse_case(case, input, output) for case in cases}
    name = {"load": "load"}.get(input, f"${input.replace('tau', 'τ')}$")
    title = f"Linear analysis, {name} to ${output.replace('tau', 'τ').replace('dq', 'ω')}$"
    subtitle = " · ".join(named(case.label) for case in cases)
    footer = f"Computed by cjt-gym {__version__}; link side, SI units."
    blocks = [
        Figure(_draw(cases, found, input, output, dt), _caption(cases, dt), whole=True),
        *_tables(found),
        *_distortion(cases),
    ]
    return Sheet(title, subtitle, blocks, footer)


def _caption(cases: Sequence[Case], dt: float | None) -> str:
    held = "" if dt is None else f" for an input that is held for {1e3 * dt:g} ms"
    points = (
        " Points: the best linear approximation of the simulated joint with its effects, by "
        "multisines; plus signs: its nonlinear distortion."
    )
    return (
        f"Frequency response{held}, its Nyquist curve, poles (crosses) and zeros (circles), and "
        "the answer to a step; effects left out."
        f"{points if any(case.identified for case in cases) else ''}"
    )


def _grid(cases: Sequence[Case], found: Mapping[str, Analysis], dt: float | None) -> Floats:
    """Return frequencies around all oscillations and measurements, dense at the former."""
    modes = [m for one in found.values() for m in (*one.poles, *one.zeros) if m.value != 0.0]
    centres = np.array([m.frequency for m in modes]) if modes else np.array([1.0])
    low, high = centres.min() / 10.0**DECADES, centres.max() * 10.0**DECADES
    low = min([low, *(float(case.identified.f[0]) for case in cases if case.identified)])
    near = [m.frequency * (1.0 + np.linspace(-0.05, 0.05, 101)) for m in modes if m.value.imag > 0]
    f = np.unique(np.concatenate([np.geomspace(low, high, 800), *near]))
    return f if dt is None else f[f < 0.45 / dt]


def _draw(
    cases: Sequence[Case],
    found: Mapping[str, Analysis],
    input: str,
    output: str,
    dt: float | None,
) -> str:
    f = _grid(cases, found, dt)
    with canvas(2.0 * HALF, 5.4) as (figure, written):
        axes = figure.subplot_mosaic([["gain", "nyquist"], ["phase", "plane"], ["step", "plane"]])
        for case, colour in zip(cases, COLOURS, strict=False):
            one = found[case.label]
            response = frequency_response(case.joint, f, input, output, dt)
            gain = np.maximum(np.abs(response), 1e-300)
            axes["gain"].semilogx(f, 20.0 * np.log10(gain), color=colour, label=drawn(case.label))
            phase = np.degrees(np.unwrap(np.angle(response)))
            axes["phase"].semilogx(f, phase, color=colour)
            axes["nyquist"].plot(response.real, response.imag, color=colour, lw=0.9)
            axes["step"].plot(one.step.t, one.step.y, color=colour)
            for modes, mark in ((one.poles, "x"), (one.zeros, "o")):
                values = np.array([v for m in modes for v in (m.value, m.value.conjugate())])
                axes["plane"].plot(values.real, values.imag, mark, color=colour, mfc="none", ms=5)
            if case.identified is not None:
                _draw_identified(axes, case.identified, colour)
        _finish(axes, input, output)
        handles, labels = axes["gain"].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        return written()


def _draw_identified(axes: Mapping[str, Any], seen: Identified, colour: str) -> None:
    gain = 20.0 * np.log10(np.abs(seen.response))
    distortion = 20.0 * np.log10(np.maximum(np.hypot(seen.odd, seen.even), 1e-6)) + gain
    axes["gain"].plot(seen.f, gain, "o", color=colour, ms=2.5, label="with its effects")
    axes["gain"].plot(seen.f, distortion, "+", color=colour, ms=3, label="distortion")
    turns = np.degrees(np.unwrap(np.angle(seen.response)))
    axes["phase"].plot(seen.f, turns, "o", color=colour, ms=2.5)
    axes["nyquist"].plot(seen.response.real, seen.response.imag, "o", color=colour, ms=2)


def _finish(axes: Mapping[str, Any], input: str, output: str) -> None:
    top = max(line.get_ydata().max() for line in axes["gain"].lines)
    bottom = min(line.get_ydata().min() for line in axes["gain"].lines)
    axes["gain"].set_ylim(max(bottom, top - 120.0) - 5.0, top + 5.0)
    unit = f"{UNITS[output.split('_')[0]]}/{UNITS.get(input, 'unit')}"
    axes["gain"].set_ylabel(f"gain [dB re {unit}]" if unit != "N m/N m" else "gain [dB]")
    axes["phase"].set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    axes["nyquist"].set(xlabel="real", ylabel="imaginary")
    axes["plane"].set(xlabel="real [rad/s]", ylabel="imaginary [rad/s]")
    axes["nyquist"].set_aspect("equal", adjustable="datalim")
    ends = np.concatenate([line.get_xdata() for line in axes["plane"].lines] or [np.zeros(1)])
    axes["plane"].set_xscale("symlog", linthresh=1.0)
    axes["plane"].set_yscale("symlog", linthresh=1.0)
    axes["plane"].set_xlim(3.0 * min(float(ends.min()), -1.0), 3.0 * max(float(ends.max()), 0.3))
    axes["step"].set(xlabel="time [s]", ylabel="step")


def _tables(found: Mapping[str, Analysis]) -> Iterator[Block]:
    yield Heading("Poles, zeros and step")
    rows: list[tuple[str, ...]] = []
    for label, one in found.items():
        rows.append((named(label),))
        for kind, modes in (("pole", one.poles), ("zero", one.zeros)):
            for mode in modes:
                pair = "pair of " if mode.value.imag > 0.0 else ""
                place = number(mode.value.real)
                place += f" ± {number(mode.value.imag)} j" if pair else ""
                ratio = number(mode.damping) if pair else ""
                what = f"{pair}{kind}{'s' if pair else ''}"
                rows.append((mode.name, what, place, number(mode.frequency), ratio))
    head = ("Name", "What", "Place [rad/s]", "Frequency [Hz]", "Damping")
    yield Table(head, rows, "llrrr", wide=(0,))
    steps = []
    for label, one in found.items():
        s = one.step
        values = (number(s.final), number(1e3 * s.rise_s), number(100.0 * s.overshoot, 3))
        steps.append((named(label), *values, number(1e3 * s.settling_s)))
    head = ("Step", "Final value", "Rise [ms]", "Overshoot [%]", "Settling [ms]")
    yield Table(head, steps, "lrrrr", wide=(0,))


def _distortion(cases: Sequence[Case]) -> Iterator[Block]:
    for case in cases:
        if case.identified is not None:
            seen = case.identified
            yield Paragraph(
                f"{named(case.label)}: best linear approximation at "
                f"{number(seen.amplitude, 3)} N m rms; nonlinear distortion "
                f"{number(100.0 * seen.distortion, 3)} % of the output.",
                small=True,
            )
