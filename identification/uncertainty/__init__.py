"""Prediction with standard uncertainty, uncertainty budget (GUM), and the value of further poses."""
