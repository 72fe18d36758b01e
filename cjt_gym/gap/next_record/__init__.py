"""What to record next, so that explanations that are still open come apart.

=========  ============================================
`menu`     the inputs to choose from
`design`   which of them separates the rivals best
`suggest`  the advice in words, and its excitation file
=========  ============================================
"""
