"""From a trained scene to a compact one: the scheduler (RPS), the spatio-spectral score (SPS), DoG control."""
