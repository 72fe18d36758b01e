"""Learning: configurations, algorithms, run folders, and the policies that come of them."""
