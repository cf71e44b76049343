"""What our render engine asks of the package for a frame, and the passes that it makes of the answer."""
