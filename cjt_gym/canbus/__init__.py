"""Real joints over CAN: what drives speak, and the plant that commands them."""
