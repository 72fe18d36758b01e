"""Score the diagnosis on blind cases: `python benchmarks/score_blind.py FOLDER [CASE...]`.

FOLDER holds one folder per case (nominal.toml, diagnose.npz, validate.npz) and labels.json. The
command `cjt-gym blind-test` draws cases of its own; this one also takes those of other simulators,
whose labels need no more than `effects` and `outside_the_table`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from cjt_gym.blind.score import score_case, summarise
from cjt_gym.blind.table import table
from cjt_gym.gap.blind_case import diagnose_files

OTHER_SYMBOLS: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("coulomb", "Fc"): ("d_cm", "d_cg"),
    ("coulomb_asym", "Fp"): ("d_cm", "d_cg"),
    ("coulomb_asym", "Fn"): ("d_cm_n", "d_cg_n"),
    ("load_coulomb", "Fc"): ("d_cl",),
    ("stribeck", "Fc"): ("d_cm", "d_cg"),
    ("stribeck", "rise"): ("d_sm", "d_sg"),
    ("stribeck", "vs"): ("v_s",),
    ("presliding", "Fc"): ("d_cm", "d_cg"),
    ("load_friction", "mu"): ("mu_m", "mu_g"),
    ("current_saturation", "isat"): ("i_p",),
    ("command_delay", "delay"): ("delay",),
    ("torque_bias", "b"): ("bias",),
    ("torque_gain", "g"): ("gain",),
    ("current_lag", "bw"): ("bandwidth",),
    ("thermal_derating", "tau"): ("T_thw",),
    ("cogging", "f"): ("f",),
    ("gear_ripple", "f"): ("f",),
}
"""Numbers of labels without `true` values, by effect and name, with their names in a diagnosis."""


def other_numbers(label: Mapping[str, Any], result: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the numbers of a diagnosis that a label of another simulator knows."""
    for effect in result.get("effects", []):
        known = dict(label["parameters"].get(effect["name"], {}))
        if "Fs" in known:
            known["rise"] = known["Fs"] - known["Fc"]
        for key, true in known.items():
            for symbol in OTHER_SYMBOLS.get((effect["name"], key), ()):
                if given := effect["parameters"].get(symbol):
                    covered = given["low"] <= true <= given["high"]
                    yield {"effect": effect["name"], "parameter": symbol, "covered": covered}


def main() -> int:
    folder = Path(sys.argv[1])
    labels = json.loads((folder / "labels.json").read_text(encoding="utf-8"))
    rows = []
    for name in sys.argv[2:] or sorted(labels):
        result = diagnose_files(folder / name)
        row = score_case(name, labels[name], result)
        if "true" not in labels[name]:
            row["numbers"] = list(other_numbers(labels[name], result))
        rows.append(row)
        good = row["exact"] and row["recognised"] == bool(row["outside"])
        print(
            f"{'  ' if good else '* '}{name}  {'+'.join(row['truth'] + row['outside']) or '-':40s} "
            f"{'+'.join(row['named']) or '-':40s} {row['error'] or row['verdict']}",
            flush=True,
        )
    print(table(summarise(rows)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
