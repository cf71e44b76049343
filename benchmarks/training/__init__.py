"""Recipes and rules of the training, and what becomes of models afterwards."""
