"""The model in training: arrays with Adam's moments and step sizes, and rows that only some primitives have."""
