"""The rows of the candidates, by the stage in which the effect table has them."""
