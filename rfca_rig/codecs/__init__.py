"""Encoders and decoders of the devices' protocols: pure functions between bytes and values, in both directions.

Those of motors are in `devices`.
"""
