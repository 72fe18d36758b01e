"""The page of effects, docs/effects.md, with one figure per effect, from the effect table.

python -m tools.effects_page            write the page and all figures
python -m tools.effects_page coulomb    write the page and these figures
python -m tools.effects_page --check    fail if the page is not what the table says
"""
