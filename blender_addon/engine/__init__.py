"""The exact picture: a render engine that calls the package."""
