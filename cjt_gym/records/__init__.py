"""Records: the one time series that simulation, hardware, evaluation and diagnosis exchange.

A file in order is a record (:func:`read_record`); a log as machines write it becomes one or several
(:func:`read_log`), with a list of everything that was repaired.
"""

from cjt_gym.records.checks import FloatArray
from cjt_gym.records.columns import COLUMNS, TRUE_PREFIX, Column, default_units
from cjt_gym.records.files import (
    is_record,
    joint_of,
    read_record,
    record_names,
    write_record,
)
from cjt_gym.records.formats import FORMATS
from cjt_gym.records.logs import draft_mapping, iter_record, read_log
from cjt_gym.records.mapping import load_mapping
from cjt_gym.records.record import JOINT_FILE, Record, concat, joints_of, one_joint, part_of
from cjt_gym.records.repair import clean, clean_pieces
from cjt_gym.records.repair_notes import Repair
from cjt_gym.records.units import UNITS, units_of
from cjt_gym.records.windows import informative_windows

__all__ = [
    "COLUMNS",
    "FORMATS",
    "JOINT_FILE",
    "TRUE_PREFIX",
    "UNITS",
    "Column",
    "FloatArray",
    "Record",
    "Repair",
    "clean",
    "clean_pieces",
    "concat",
    "default_units",
    "draft_mapping",
    "informative_windows",
    "is_record",
    "iter_record",
    "joint_of",
    "joints_of",
    "load_mapping",
    "one_joint",
    "part_of",
    "read_log",
    "read_record",
    "record_names",
    "units_of",
    "write_record",
]
