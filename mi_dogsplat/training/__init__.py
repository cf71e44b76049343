"""From a data set to a trained scene: initialisation, loss, optimiser, densification, the training loop."""
