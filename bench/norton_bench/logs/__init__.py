"""Logs that were made elsewhere: read by a column map, checked, converted to SI, fitted and predicted."""
