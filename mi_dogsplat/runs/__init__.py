"""A training as a folder: run to the end, stopped, resumed, measured."""
