"""Evaluation: what a controller or a policy is asked to do, its episodes, and figures of merit."""
