"""Records: the one time series that simulation, hardware, evaluation and diagnosis exchange."""

from cjt_gym.records.checks import FloatArray
from cjt_gym.records.columns import COLUMNS, TRUE_PREFIX, Column, default_units
from cjt_gym.records.files import FORMATS, read_record, record_names, write_record
from cjt_gym.records.record import Record

__all__ = [
    "COLUMNS",
    "FORMATS",
    "TRUE_PREFIX",
    "Column",
    "FloatArray",
    "Record",
    "default_units",
    "read_record",
    "record_names",
    "write_record",
]
