"""Encoders and decoders of the devices' protocols: pure functions between bytes and values, in both
directions.

Those of one make are in `devices`; here is what several share.
"""
