"""Fits parameters of the nominal model to recordings."""
