"""The fast lanes: the most common joints, sixteen side by side in vector registers.

`advance` moves joints by one control step. What it cannot move it leaves, and says how many: these
take `cjt_gym.joint.kernel`, which moves every joint there is. That kernel is the reference: the
lanes solve the same equations by the same scheme, and `tests/physics/test_blocks.py` compares them.

==============  ====================================================================
`blocks`        who may use the lanes; what goes into them and comes back: `advance`
`substeps`      the substeps of a control step, written as if for one joint
`vectors`       vectors of numbers that compiled code computes with like floats
`vector_math`   their sine, cosine and exponential function
==============  ====================================================================
"""

from cjt_gym.joint.lanes.blocks import Blocks, advance, advance_blocks, kind_of, make_blocks
from cjt_gym.joint.lanes.substeps import Kind

__all__ = ["Blocks", "Kind", "advance", "advance_blocks", "kind_of", "make_blocks"]
