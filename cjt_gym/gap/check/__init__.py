"""What a record can and cannot tell, before any fit: `examine` is the way in."""

from cjt_gym.gap.check.examination import CannotTell, Examination
from cjt_gym.gap.check.examine import examine

__all__ = ["CannotTell", "Examination", "examine"]
