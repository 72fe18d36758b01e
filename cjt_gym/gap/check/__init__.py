"""What a record can and cannot identify, before any fit; the entry point is `examine`."""

from cjt_gym.gap.check.examination import CannotTell, Examination
from cjt_gym.gap.check.examine import examination_of, examine

__all__ = ["CannotTell", "Examination", "examination_of", "examine"]
