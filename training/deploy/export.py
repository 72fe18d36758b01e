"""Write a policy in one of its forms, and try the file against the policy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cjt_gym.disk import write_text
from cjt_gym.export.c_files import Checked, ExportError
from cjt_gym.export.c_text import identifier
from cjt_gym.records import Record
from cjt_gym.training.deploy.c_header import c_header
from cjt_gym.training.deploy.check import TOLERANCE, check
from cjt_gym.training.deploy.exported import save_exported
from cjt_gym.training.deploy.fast_policy import exported
from cjt_gym.training.deploy.onnx_file import write_onnx
from cjt_gym.training.deploy.shipped import load_agent


@dataclass(frozen=True)
class Written:
    """An exported policy."""

    path: Path
    form: str  # "onnx", "numpy" or "c"
    checked: Checked  # how it compares with the policy

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data; what is not known is None."""
        numbers = {name: getattr(self.checked, name) for name in ("error", "microseconds")}
        known = {name: x if math.isfinite(x) else None for name, x in numbers.items()}
        steps, note = self.checked.steps, self.checked.note
        return {"file": str(self.path), "form": self.form, "steps": steps, **known, "note": note}

    def summary(self) -> str:
        """Return it in words."""
        c = self.checked
        if not c.steps:
            return f"{self.path}: not tried. {c.note}"
        return (
            f"{self.path}: the whole controller; commands as the run to {c.error:.1e} of the "
            f"policy's largest torque, over {c.steps} steps; {c.microseconds:.1f} us a step"
        )


def export_policy(
    run: str | Path, form: str, path: Path, records: Sequence[Record] = ()
) -> Written:
    """Write a policy in another form, and try the file on an episode of its training task.

    Args:
        run: The run folder, the file of an exported policy, or the name of one that ships.
        form: "onnx", "numpy" or "c".
        path: The file to write. Names in a C header begin with its name.
        records: Recorded signals on which the file is to be compared with the policy, too.

    Raises:
        UnknownNameError: It looks like a name, and no policy of that name ships.
        MissingFileError: There is no such path.
        ConfigurationError: It is not a run of cjt-gym, its network or its base controller cannot be
            exported, a record does not fit, or a package is missing.
        ExportError: The file gives other actions than the policy.
    """
    agent = load_agent(run)
    policy, header = exported(agent), ""
    if form == "onnx":
        write_onnx(policy, path)
    elif form == "numpy":
        save_exported(policy, path)
    else:
        header = c_header(policy)
        prefix = identifier(path.stem, "policy")
        named = header if prefix == "policy" else c_header(policy, prefix)
        write_text(path, named)
    checked = check(agent, path, form, header, records)
    if checked.steps and not checked.error <= TOLERANCE:
        raise ExportError(
            f"{path} gives torques that differ from those of {run} by {checked.error:.2g} of the "
            f"policy's largest one, more than {TOLERANCE:g}. Do not use it."
        )
    return Written(path, form, checked)
