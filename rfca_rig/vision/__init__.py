"""Hinge angles from photos of the leg: red marks are detected, identified and fitted; what the
photo does not determine is reported.
"""
