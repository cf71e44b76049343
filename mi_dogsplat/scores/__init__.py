"""What a primitive contributes to the training views: who goes first when a model is pruned."""
