"""Score the diagnosis on blind cases: `python benchmarks/score_blind.py FOLDER [CASE...]`.

FOLDER holds one folder per case (nominal.toml, diagnose.npz, validate.npz) and labels.json.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.errors import CjtGymError
from cjt_gym.gap import diagnose
from cjt_gym.records import read_record


def run_case(folder: Path) -> dict[str, Any]:
    record = read_record(folder / "diagnose.npz")
    validate = [read_record(folder / "validate.npz")] if (folder / "validate.npz").is_file() else []
    return diagnose(record, validate=validate).to_dict()


def score(name: str, label: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    truth = set(label["effects"])
    outside = bool(label.get("outside_the_table"))
    named = [effect["name"] for effect in result["effects"]]
    confirmed = {e["name"] for e in result["effects"] if e["status"] == "confirmed"}
    found = set(named)
    hits = len(found & truth)
    f1 = 1.0 if not truth and not found else 2.0 * hits / (len(truth) + len(found))
    return {
        "case": name,
        "truth": sorted(truth) + label.get("outside_the_table", []),
        "named": named,
        "verdict": result["verdict"],
        "outside": outside,
        "first": named[0] in truth if named and truth else None if not truth else False,
        "f1": f1,
        "false_alarm": not truth and not outside and bool(found),
        "recognised": result["verdict"] in ("unexplained", "partly_explained"),
        "wrong_confirmed": bool(confirmed - truth),
        "covered": coverage(label, result),
        "seconds": result["seconds"],
        "gap": result["gap"],
    }


def coverage(label: dict[str, Any], result: dict[str, Any]) -> list[bool]:
    """Return for each number that can be compared directly whether its interval covers it."""
    pairs = {
        ("coulomb", "Fc"): ("d_cm", "d_cg"),
        ("coulomb_asym", "Fp"): ("d_cm", "d_cg"),
        ("coulomb_asym", "Fn"): ("d_cm_n", "d_cg_n"),
        ("load_coulomb", "Fc"): ("d_cl",),
        ("stribeck", "Fc"): ("d_cm", "d_cg"),
        ("stribeck", "Fs"): ("d_s",),
        ("stribeck", "vs"): ("v_s",),
        ("presliding", "Fc"): ("d_cm", "d_cg"),
        ("load_friction", "mu"): ("mu",),
        ("current_saturation", "isat"): ("i_max",),
        ("command_delay", "delay"): ("delay",),
        ("torque_bias", "b"): ("bias",),
        ("torque_gain", "g"): ("gain",),
        ("current_lag", "bw"): ("bandwidth",),
        ("thermal_derating", "tau"): ("time_constant",),
        ("cogging", "f"): ("f",),
        ("gear_ripple", "f"): ("f",),
        ("viscous_asym", "add"): ("d_m_n", "d_g_n"),
    }
    covered = []
    for effect in result["effects"]:
        for key, value in label["parameters"].get(effect["name"], {}).items():
            for symbol in pairs.get((effect["name"], key), ()):
                if symbol in effect["parameters"]:
                    p = effect["parameters"][symbol]
                    covered.append(p["low"] <= value <= p["high"])
    return covered


def table(rows: Sequence[dict[str, Any]]) -> str:
    def rate(values: list[Any]) -> str:
        good = [v for v in values if v is not None]
        return f"{sum(good)}/{len(good)} = {np.mean(good):.3f}" if good else "-"

    known = [r for r in rows if r["truth"] and not r["outside"]]
    none = [r for r in rows if not r["truth"]]
    outside = [r for r in rows if r["outside"]]
    seconds = [r["seconds"] for r in rows]
    return "\n".join(
        [
            f"first name right    {rate([r['first'] for r in known])}",
            f"set exact           {rate([r['f1'] == 1.0 for r in known])}",
            f"set F1              {np.mean([r['f1'] for r in known] or [0]):.3f}",
            f"false alarms        {rate([r['false_alarm'] for r in none])}",
            f"known, called left  {rate([r['recognised'] for r in known + none])}",
            f"outside recognised  {rate([r['recognised'] for r in outside])}",
            f"no wrong confirmed  {rate([not r['wrong_confirmed'] for r in outside])} (outside)",
            f"intervals cover     {rate([c for r in rows for c in r['covered']])}",
            f"seconds             median {np.median(seconds):.1f}, largest {max(seconds):.1f}",
        ]
    )


def main() -> int:
    folder = Path(sys.argv[1])
    labels = json.loads((folder / "labels.json").read_text(encoding="utf-8"))
    rows = []
    for name in sys.argv[2:] or sorted(labels):
        try:
            result = run_case(folder / name)
        except CjtGymError as error:
            print(f"{name}  failed: {error}", flush=True)
            continue
        row = score(name, labels[name], result)
        rows.append(row)
        gap = row["gap"]
        good = row["f1"] == 1.0 and row["recognised"] == row["outside"]
        print(
            f"{'  ' if good else '* '}{name}  {'+'.join(row['truth']) or 'none':40s} "
            f"{'+'.join(row['named']) or '-':40s} {row['verdict']:16s} {row['seconds']:5.1f} s  "
            f"gap {gap['before']:.3f} -> {gap['after']:.3f} (floor {gap['floor']:.3f})",
            flush=True,
        )
    print(table(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
