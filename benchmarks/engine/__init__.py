"""What the engine takes: its passes, what is left out of them, and how they grow."""
