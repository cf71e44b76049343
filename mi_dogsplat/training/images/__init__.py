"""Training images as the loss sees them, what cameras did to them, and the loss itself."""
