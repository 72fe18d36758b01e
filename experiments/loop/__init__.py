"""Closing the loop: does a diagnosis make a policy better on the joint that was diagnosed?

Policies learn on a joint as its datasheet describes it, and then run on joints of another simulator
(`cjt_gym.blind`) that hide one or two effects. Each of those joints is recorded and diagnosed, and
the policy goes on learning on the joint that the diagnosis gives. What that is worth is seen beside
a policy that learnt on widely randomised joints, and one that went on learning on the true joint.

    python -m experiments.loop --out loop
"""
