"""Tables as MATLAB files: vectors, and vectors within structures, by the names they have there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.tables import hdf5_table
from cjt_gym.records.tables.flat import flat_arrays
from cjt_gym.records.tables.mat5 import HEADER, is_mat5, read_mat5

HDF5_MARK = b"MATLAB 7.3"


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return every vector of a MATLAB file, those of a structure as ``log.q_m``.

    Numbers that stand alone are left out. Files of version 7.3, which are HDF5, need h5py.
    """
    with path.open("rb") as file:
        head = file.read(HEADER)
    if head.startswith(HDF5_MARK):
        return hdf5_table.read(path)
    if is_mat5(head):
        content = read_mat5(path)
    else:
        from scipy.io import loadmat

        content = loadmat(path)
    named = {name: value for name, value in content.items() if not name.startswith("__")}
    found = dict(flat_arrays("", named))
    longest = max(map(len, found.values()), default=0)
    columns = {name: values for name, values in found.items() if len(values) > 1 or longest == 1}
    if not columns:
        raise RecordError(
            f"{path} must hold vectors of numbers, found only {', '.join(named) or 'nothing'}. "
            "Objects such as timeseries and tables are not readable outside MATLAB: save their "
            "data as plain vectors, such as  q = ts.Data; save('log.mat', 'q')."
        )
    return columns


def write(columns: Mapping[str, FloatArray], path: Path) -> None:
    """Write columns as column vectors, in version 5, compressed."""
    from scipy.io import savemat

    savemat(path, dict(columns), do_compression=True, oned_as="column", long_field_names=True)
