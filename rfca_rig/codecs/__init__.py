"""Encoders and decoders of the devices' protocols: pure functions between bytes and values, in both directions."""
