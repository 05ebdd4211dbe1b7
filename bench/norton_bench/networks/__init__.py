"""Equivalent networks as objects: a source and a connection, in two types and two operational forms (paper, II–III)."""
