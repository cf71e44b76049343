"""The same data trained under several presets, and the table that compares them."""
