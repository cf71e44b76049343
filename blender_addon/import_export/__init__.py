"""File > Import and File > Export of models."""
