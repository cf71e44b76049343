"""Model files of others: how arrays become the bytes of a format, and back."""
